# SPDX-License-Identifier: Apache-2.0
"""The learned methods of the table: trained by torch, scored through the run-time stage, labels given and not."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.learning.data.baseline import GIVEN, RECOGNISED, STARTED
from mild_core.learning.data.windows import PROTOCOLS, cut
from mild_core.learning.evaluation.cross_validation import Job, run_job
from mild_core.learning.evaluation.methods import METHODS
from mild_core.learning.training import presets
from mild_core.learning.training.learned_model import learn
from test.core.learning.made_trials import made_trials, smooth_track
from test.core.learning.small_settings import SMALL, SMALL_PAPER
from test.core.learning.test_buetepage_hr import one_hot, write

TRIALS = made_trials(each=3)


@pytest.fixture(autouse=True)
def small_presets(monkeypatch):
    small = {"paper": SMALL_PAPER, "same": SMALL, "ahead": SMALL, "next": SMALL}
    monkeypatch.setattr(presets, "PRESETS", small)
    monkeypatch.setattr("mild_core.learning.evaluation.methods.PRESETS", small)


@pytest.mark.parametrize("small", [SMALL, SMALL_PAPER], ids=["ours", "the paper's"])
def test_a_learned_model_answers_as_torch_says_and_never_looks_at_the_answer(small):
    protocol = PROTOCOLS["same"]
    predictor = learn(TRIALS, protocol, small, seed=0)
    trial = TRIALS[1]
    predicted = predictor.predict(trial)
    assert predicted.shape == cut(trial, protocol).controlled.shape
    blinded = replace(trial, controlled=np.zeros_like(trial.controlled))
    np.testing.assert_array_equal(predictor.predict(blinded), predicted)
    np.testing.assert_array_equal(learn(TRIALS, protocol, small, seed=0).predict(trial), predicted)


@pytest.mark.parametrize("method", ["mild", "mild_paper"])
def test_one_training_gives_the_row_with_labels_and_the_row_without(tmp_path, method):
    tracks = [smooth_track(index, 120) for index in range(8)]
    path = write(tmp_path / "a.npz", tracks, [one_hot(index // 4, 120) for index in range(8)])
    result = run_job(Job("buetepage_hr", path, "ahead", method, fold=1, seed=0))
    assert set(result.errors) == {GIVEN, RECOGNISED} | ({STARTED} if method == "mild" else set())
    for errors in result.errors.values():
        assert [one.trial for one in errors] == [1, 5]
        assert all(len(one.squared) == 120 - 79 and np.isfinite(one.squared).all() for one in errors)
    assert METHODS[method].seeded


def test_a_fold_that_no_trial_falls_into_has_rows_without_errors(tmp_path):
    tracks = [smooth_track(index, 120) for index in range(6)]
    path = write(tmp_path / "a.npz", tracks, [one_hot(index // 3, 120) for index in range(6)])
    result = run_job(Job("buetepage_hr", path, "ahead", "mild", fold=3, seed=0))
    assert result.errors == {GIVEN: (), RECOGNISED: (), STARTED: ()}
    assert result.held_out == ()

# SPDX-License-Identifier: Apache-2.0
"""A model is measured by the stage that runs it, and never on what it was not made for."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.errors import ModelError
from mild_core.inference.model import build_model
from mild_core.inference.stage import Inference
from mild_core.learning.data.windows import PROTOCOLS, cut, feature_windows
from mild_core.learning.training.model_predictor import AUTO, ModelPredictor, require_fit
from test.core.inference.random_model import INTERACTIONS, YUMI_JOINTS, manifest, paper_member, random_arrays
from test.core.learning.made_trials import made_trial

AHEAD = PROTOCOLS["ahead"]


@pytest.fixture(scope="module")
def model():
    described = manifest((paper_member(),), components=3)
    return build_model(described, random_arrays(described))


def yumi_trial(frames=100):
    made = made_trial(0, INTERACTIONS[1], frames)
    return replace(made, controlled_names=YUMI_JOINTS, controlled=np.zeros((frames, 7)))


def test_answers_are_those_of_inference_stepped_from_the_start_of_the_trial(model):
    trial = yumi_trial()
    answers = ModelPredictor(model, AHEAD).answers(trial, INTERACTIONS[1])
    stage = Inference(model, INTERACTIONS[1])
    state, motions = stage.init(), []
    for window in feature_windows(trial, AHEAD):
        state, made = stage.step(state, window, 0)
        motions += made
    np.testing.assert_array_equal(answers.predicted, [motion.positions for motion in motions])
    assert answers.predicted.shape == cut(trial, AHEAD).controlled.shape == (100 - 80 + 1, 40, 7)
    assert set(answers.interactions) == {INTERACTIONS[1]}


def test_recognising_does_not_look_at_the_label(model):
    predictor, trial = ModelPredictor(model, AHEAD), yumi_trial()
    other = replace(trial, interaction=INTERACTIONS[2])
    free, other_free = (predictor.answers(one, AUTO).predicted for one in (trial, other))
    np.testing.assert_array_equal(free, other_free)
    assert not np.array_equal(predictor.predict(trial), predictor.predict(other))
    assert set(predictor.answers(trial, AUTO).interactions) <= {"", *INTERACTIONS}


def test_a_trial_too_short_for_a_window_has_no_answers(model):
    answers = ModelPredictor(model, AHEAD).answers(yumi_trial(60), AUTO)
    assert answers.predicted.shape == (0, 40, 7)
    assert answers.interactions == ()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"controlled_names": tuple("abcdefg")}, "moves yumi_joint_1_r"),
        ({"observed_names": ("a", "b", "c")}, "observes shoulder"),
        ({"rate_hz": 30.0}, "runs at 40 Hz, the recording at 30 Hz"),
        ({"interaction": "hug"}, "does not know 'hug'"),
    ],
)
def test_a_recording_of_something_else_is_refused(model, change, said):
    with pytest.raises(ModelError, match=said):
        require_fit(model.manifest, AHEAD, [replace(yumi_trial(), **change)])


def test_another_protocol_is_refused_by_name(model):
    require_fit(model.manifest, AHEAD, [yumi_trial()])
    with pytest.raises(ModelError, match="trained for protocol 'ahead', so its error by 'same' means nothing"):
        require_fit(model.manifest, PROTOCOLS["same"], ())

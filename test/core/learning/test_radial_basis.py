# SPDX-License-Identifier: Apache-2.0
"""The radial-basis network answers left-out trials, runs as it was learned, and keeps nobody's window."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.errors import ModelError
from mild_core.inference.model import build_model
from mild_core.inference.radial_basis import RadialBasis
from mild_core.learning.export import ModelFacts, export
from mild_core.learning.learned_model import finished
from mild_core.learning.model_predictor import ModelPredictor
from mild_core.learning.radial_basis import fit_radial_basis, pasts
from mild_core.learning.settings import PAPER, RadialBasisSettings
from mild_core.learning.training import train
from mild_core.learning.windows import PROTOCOLS, cut
from test.core.learning.made_trials import made_trial, made_trials
from test.core.learning.small_settings import SMALL, TWO

SAME_SECOND = PROTOCOLS["same"]
SETTINGS = replace(SMALL, radial_basis=RadialBasisSettings(share=0.4, centres=12, coordinates=8), past_s=(0.5, 2.0))
TRIALS = made_trials(each=4, frames=130)


@pytest.fixture(name="basis", scope="module")
def _basis() -> RadialBasis:
    found = fit_radial_basis(TRIALS, SAME_SECOND, TWO, SETTINGS, 0)
    assert found is not None
    return found


def answers(basis: RadialBasis, trial, label) -> np.ndarray:
    observed, past = cut(trial, SAME_SECOND).observed, pasts(trial, SAME_SECOND, SETTINGS.past_s)
    return np.array([basis.answer(*seen, label) for seen in zip(observed, past, strict=True)])


@pytest.mark.parametrize("number", [0, 1])
def test_it_answers_a_new_trial_much_better_than_the_mean_answer(basis, number):
    trial, label = made_trial(50, TWO[number], 130, gain=1.0 + number), np.eye(2)[number]
    true = cut(trial, SAME_SECOND).controlled
    own = [cut(t, SAME_SECOND).controlled for t in TRIALS if t.interaction == TWO[number]]
    mean = np.concatenate(own).mean(axis=0)
    error = ((answers(basis, trial, label).reshape(true.shape) - true) ** 2).mean()
    assert error < 0.3 * ((mean - true) ** 2).mean()


def test_between_two_interactions_it_answers_between_their_answers(basis):
    trial = made_trial(51, TWO[0], 130)
    both = [answers(basis, trial, label) for label in np.eye(2)]
    np.testing.assert_allclose(answers(basis, trial, np.array([0.25, 0.75])), 0.25 * both[0] + 0.75 * both[1])


def test_no_centre_is_a_recorded_window(basis):
    rows = []
    for trial in TRIALS:
        observed, past = cut(trial, SAME_SECOND).observed, pasts(trial, SAME_SECOND, SETTINGS.past_s)
        rows.append(np.hstack([observed.reshape(len(observed), -1), past.reshape(len(past), -1)]))
    points = np.concatenate(rows) @ basis.weight + basis.bias
    nearest = np.linalg.norm(points[:, None] - basis.centres, axis=2).min(axis=0)
    assert nearest.min() > 1e-6


def test_the_stage_blends_it_with_the_members_and_a_folder_keeps_it():
    trained = finished(train(TRIALS, SAME_SECOND, SETTINGS, 0))
    manifest, arrays = export(trained, TRIALS, 0.01 * np.eye(3), ModelFacts("small"))
    assert manifest.past_s == SETTINGS.past_s
    model = build_model(manifest, arrays)
    predicted = ModelPredictor(model, SAME_SECOND).predict(TRIALS[1])
    # Members run in single precision at run time, and the network's arrays are stored in it.
    np.testing.assert_allclose(predicted, trained.predict(TRIALS[1]), atol=1e-3)
    alone = ModelPredictor(replace(model, radial_basis=None), SAME_SECOND).answers(TRIALS[1], TRIALS[1].interaction)
    label = np.eye(2)[TWO.index(TRIALS[1].interaction)]
    beside = answers(model.radial_basis, TRIALS[1], label).reshape(predicted.shape)
    np.testing.assert_allclose(predicted, 0.6 * alone.predicted + 0.4 * beside, atol=1e-6)
    wider = ModelPredictor(model, SAME_SECOND).answers(TRIALS[1], TRIALS[1].interaction).covariances
    assert (np.linalg.eigvalsh(wider - alone.covariances).min(axis=1) > -1e-12).all()
    assert wider.trace(axis1=1, axis2=2).mean() > alone.covariances.trace(axis1=1, axis2=2).mean()


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("owners", np.full(24, 7.0)),
        ("width", np.zeros(1)),
        ("share", np.full(1, 1.5)),
        ("bias", np.zeros(3)),
        ("mean", np.full(120, np.nan)),
    ],
)
def test_arrays_that_do_not_fit_are_named(basis, name, wrong):
    bare = replace(SETTINGS, radial_basis=None, recogniser=None, epochs=1)
    manifest, arrays = export(finished(train(TRIALS, SAME_SECOND, bare, 0)), TRIALS, np.eye(3), ModelFacts("x"))
    with pytest.raises(ModelError, match=r"radial_basis\."):
        build_model(manifest, {**arrays, **basis.to_arrays(), f"radial_basis.{name}": wrong})
    assert build_model(manifest, {**arrays, **basis.to_arrays()}).radial_basis is not None


@pytest.mark.parametrize("moving", [0, 1])
def test_people_who_stand_perfectly_still_are_learned_from_too(moving):
    def still(trial):
        return replace(trial, observed_m=np.repeat(trial.observed_m[:1], trial.frames, axis=0))

    trials = [trial if k % 4 < moving else still(trial) for k, trial in enumerate(TRIALS)]
    basis = fit_radial_basis(trials, SAME_SECOND, TWO, SETTINGS, 0)
    assert basis is not None
    assert all(np.isfinite(array).all() for array in basis.to_arrays().values())
    found = answers(basis, trials[2], np.eye(2)[0])
    assert np.abs(found).max() < 2.0  # what the robot did there is between 0 and 1


def test_the_papers_model_has_none():
    assert PAPER.radial_basis is None
    assert PAPER.past_s == ()
    assert fit_radial_basis(TRIALS, SAME_SECOND, TWO, PAPER, 0) is None

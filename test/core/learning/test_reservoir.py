# SPDX-License-Identifier: Apache-2.0
"""The reservoir answers left-out trials, after any rest, runs as it was learned, and is kept by a model folder."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.errors import ModelError
from mild_core.inference.model import build_model
from mild_core.inference.reservoir import Reservoir
from mild_core.inference.stage import Inference
from mild_core.learning.data.windows import PROTOCOLS, cut, feature_windows, onset_frame
from mild_core.learning.training.algorithm import train
from mild_core.learning.training.export import ModelFacts, export
from mild_core.learning.training.learned_model import finished
from mild_core.learning.training.model_predictor import ModelPredictor
from mild_core.learning.training.presets import PAPER
from mild_core.learning.training.reservoir import fit_reservoir
from mild_core.learning.training.reservoir_trials import STRIDE
from mild_core.learning.training.settings import ReservoirSettings
from test.core.learning.made_trials import made_trial, made_trials
from test.core.learning.small_settings import SMALL, TWO

SAME_SECOND = PROTOCOLS["same"]
SETTINGS = replace(SMALL, reservoir=ReservoirSettings(share=0.4, count=2, units=60, copies=1))
TRIALS = made_trials(each=4, frames=130)


@pytest.fixture(name="learned", scope="module")
def _learned() -> tuple[Reservoir, list[np.ndarray]]:
    found = fit_reservoir(TRIALS, SAME_SECOND, TWO, SETTINGS, 0)
    assert found is not None
    return found


@pytest.fixture(name="reservoir")
def _reservoir(learned) -> Reservoir:
    return learned[0]


def answers(reservoir: Reservoir, trial, label, rested: int = 0) -> np.ndarray:
    """(N, W J) to every window of a trial, before which the person has stood still for some frames."""
    track = trial.observed_m.reshape(trial.frames, -1)
    track = np.vstack([np.repeat(track[:1], rested, axis=0), track])
    states = reservoir.listen(track, trial.rate_hz, None, 0)[rested + 39 :]
    windows = np.lib.stride_tricks.sliding_window_view(track[rested:], 40, axis=0).swapaxes(1, 2)
    return np.array([reservoir.answer(*seen, label) for seen in zip(states, windows, strict=True)])


def error(reservoir: Reservoir, number: int, rested: int = 0) -> float:
    """Of a new trial, as a share of what the mean answer errs."""
    trial, label = made_trial(50, TWO[number], 130, gain=1.0 + number), np.eye(2)[number]
    true = cut(trial, SAME_SECOND).controlled
    own = [cut(t, SAME_SECOND).controlled for t in TRIALS if t.interaction == TWO[number]]
    mean = np.concatenate(own).mean(axis=0)
    found = answers(reservoir, trial, label, rested).reshape(true.shape)
    return float(((found - true) ** 2).mean() / ((mean - true) ** 2).mean())


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("rested", [0, 300, 4000])
def test_it_answers_a_new_trial_much_better_than_the_mean_answer_after_any_rest(reservoir, number, rested):
    assert error(reservoir, number, rested) < 0.3


def aside(trial):
    """The same movement to the side instead of forward: the difference of `push` from `reach` here."""
    return replace(trial, observed_m=trial.observed_m[..., [1, 0, 2]]) if trial.interaction == "push" else trial


@pytest.fixture(name="telling", scope="module")
def _telling() -> Reservoir:
    found = fit_reservoir([aside(t) for t in made_trials(each=4, frames=300)], SAME_SECOND, TWO, SETTINGS, 0)
    assert found is not None
    return found[0]


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("rested", [0, 4000])
def test_it_classifies_new_trials_once_the_hand_has_moved_and_until_the_end(telling, number, rested):
    trial = aside(made_trial(50, TWO[number], 300))
    track = trial.observed_m.reshape(trial.frames, -1)
    states = telling.listen(np.vstack([np.repeat(track[:1], rested, axis=0), track]), trial.rate_hz, None, 0)[rested:]
    logits = np.array([telling.classify(states[n], track[n - 39 : n + 1]) for n in range(39, trial.frames)])
    probability = np.exp(logits[:, number] - np.logaddexp(*logits.T))
    started = onset_frame(trial) - 39
    assert started > 10
    # A resting person shows nothing: one of two, give or take what regression makes of another person's posture.
    assert abs(probability[0] - 0.5) < 0.2
    assert probability[started + 20 :].min() > 0.8


@pytest.mark.parametrize("network", [True, False])
def test_it_and_the_networks_have_equal_say_in_which_interaction_it_is(network):
    settings = SETTINGS if network else replace(SETTINGS, recogniser=None)
    trials = [aside(trial) for trial in TRIALS]
    model = build_model(
        *export(finished(train(trials, SAME_SECOND, settings, 0)), trials, np.eye(3), ModelFacts("small"))
    )
    window = list(feature_windows(trials[5], SAME_SECOND))[60]
    stage, values = Inference(model), window.features.ravel()
    state, _ = stage.step(stage.init(), window, window.stamp_ns)
    wanted = model.reservoir.classify(model.reservoir.listen(window.features, 40.0, None, 0)[-1], window.features)
    if network:
        run = model.members[0].networks["recogniser"].run
        logits = run(values.astype(np.float32), np.zeros(0, np.float32))[0].astype(np.float64)
        wanted = 0.5 * (wanted + logits - np.logaddexp(*logits))
    np.testing.assert_allclose(state.recognition.evidence, model.temper * (wanted - wanted.max()), atol=1e-6)
    assert np.ptp(state.recognition.evidence) > 1e-3


@pytest.mark.parametrize(("gain", "forgets"), [(1.2, True), (2.5, False)])
def test_units_forget_what_was_long_ago_unless_they_hear_each_other_too_loudly(gain, forgets):
    louder = replace(SETTINGS, reservoir=ReservoirSettings(count=1, units=100, gain=gain))
    found = fit_reservoir(TRIALS, SAME_SECOND, TWO, louder, 0)
    assert found is not None
    rest = np.repeat(TRIALS[0].observed_m[:1].reshape(1, -1), 6000, axis=0)
    pasts = [np.vstack([trial.observed_m.reshape(trial.frames, -1), rest]) for trial in (TRIALS[0], TRIALS[5])]
    ends = [found[0].listen(track, 40.0, None, 0)[-1] for track in pasts]
    assert (np.abs(ends[0] - ends[1]).max() < 1e-3) == forgets


@pytest.mark.parametrize("passed", [1, 3, 40])
def test_frame_by_frame_is_as_all_at_once(reservoir, passed):
    track = made_trial(52, TWO[0], 80).observed_m.reshape(80, -1)
    state, newest = reservoir.listen(track[:40], 40.0, None, 0)[-1], 40
    while newest + passed <= 80:  # with more than one, windows were missed: the next one holds their frames
        newest += passed
        state = reservoir.listen(track[newest - 40 : newest], 40.0, state, passed)[-1]
    # A gap as long as the window leaves the velocity of its first frame unknown.
    tolerance = 1e-12 if passed < 40 else 0.05
    np.testing.assert_allclose(state, reservoir.listen(track[:newest], 40.0, None, 0)[-1], atol=tolerance)


def test_between_two_interactions_it_answers_between_their_answers(reservoir):
    trial = made_trial(51, TWO[0], 130)
    both = [answers(reservoir, trial, label) for label in np.eye(2)]
    between = answers(reservoir, trial, np.array([0.25, 0.75]))
    np.testing.assert_allclose(between, 0.25 * both[0] + 0.75 * both[1], atol=1e-12)


def test_trials_left_out_are_answered_by_what_has_not_learned_from_them(learned):
    reservoir, left_out = learned
    known, unknown = [], []
    for trial, without in zip(TRIALS, left_out, strict=True):
        label = np.eye(2)[TWO.index(trial.interaction)]
        true = cut(trial, SAME_SECOND).controlled.reshape(-1, reservoir.mean.size)[::STRIDE]
        known.append(((answers(reservoir, trial, label)[::STRIDE] - true) ** 2).mean())
        unknown.append(((without - true) ** 2).mean())
    assert np.mean(known) < 0.9 * np.mean(unknown)


def test_the_stage_blends_it_with_the_members_and_a_folder_keeps_it():
    trained = finished(train(TRIALS, SAME_SECOND, SETTINGS, 0))
    model = build_model(*export(trained, TRIALS, 0.01 * np.eye(3), ModelFacts("small")))
    predicted = ModelPredictor(model, SAME_SECOND).predict(TRIALS[1])
    # Members run in single precision at run time, and the readouts are stored in it.
    np.testing.assert_allclose(predicted, trained.predict(TRIALS[1]), atol=1e-3)
    alone = ModelPredictor(replace(model, reservoir=None), SAME_SECOND).answers(TRIALS[1], TRIALS[1].interaction)
    label = np.eye(2)[TWO.index(TRIALS[1].interaction)]
    beside = answers(model.reservoir, TRIALS[1], label).reshape(predicted.shape)
    np.testing.assert_allclose(predicted, 0.6 * alone.predicted + 0.4 * beside, atol=1e-6)
    wider = ModelPredictor(model, SAME_SECOND).answers(TRIALS[1], TRIALS[1].interaction).covariances
    assert (np.linalg.eigvalsh(wider - alone.covariances).min(axis=1) > -1e-12).all()
    assert wider.trace(axis1=1, axis2=2).mean() > alone.covariances.trace(axis1=1, axis2=2).mean()


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("sources", np.full((10, 120), 120.0)),
        ("leak", np.full(120, 1.5)),
        ("share", np.full(1, 1.5)),
        ("bias", np.zeros((2, 3))),
        ("label_weight", np.zeros((120, 2))),
        ("mean", np.full(120, np.nan)),
    ],
)
def test_arrays_that_do_not_fit_are_named(reservoir, name, wrong):
    bare = replace(SETTINGS, reservoir=None, start_pose=False, recogniser=None, epochs=1)
    manifest, arrays = export(finished(train(TRIALS, SAME_SECOND, bare, 0)), TRIALS, np.eye(3), ModelFacts("x"))
    with pytest.raises(ModelError, match=r"reservoir\."):
        build_model(manifest, {**arrays, **reservoir.to_arrays(), f"reservoir.{name}": wrong})
    assert build_model(manifest, {**arrays, **reservoir.to_arrays()}).reservoir is not None


@pytest.mark.parametrize("moving", [0, 1])
def test_people_who_stand_perfectly_still_are_learned_from_too(moving):
    def still(trial):
        return replace(trial, observed_m=np.repeat(trial.observed_m[:1], trial.frames, axis=0))

    trials = [trial if k % 4 < moving else still(trial) for k, trial in enumerate(TRIALS)]
    found = fit_reservoir(trials, SAME_SECOND, TWO, SETTINGS, 0)
    assert found is not None
    assert all(np.isfinite(array).all() for array in found[0].to_arrays().values())
    assert np.abs(answers(found[0], trials[2], np.eye(2)[0])).max() < 2.0  # what the robot did is between 0 and 1


def test_the_papers_model_has_none():
    assert PAPER.reservoir is None
    assert fit_reservoir(TRIALS, SAME_SECOND, TWO, PAPER, 0) is None

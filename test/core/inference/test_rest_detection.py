# SPDX-License-Identifier: Apache-2.0
"""A rest of any length before a motion does not change the prediction; a rest after it resets the state."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.inference.model import build_model
from mild_core.inference.rest_detection import BACK_M, first_seen, is_back, is_waiting, rests, watch
from mild_core.inference.stage import Inference
from mild_core.learning.data.windows import PROTOCOLS, feature_windows
from mild_core.learning.training.algorithm import train
from mild_core.learning.training.export import ModelFacts, export
from mild_core.learning.training.learned_model import finished
from test.core.learning.made_trials import made_trial, made_trials
from test.core.learning.small_settings import SMALL, TWO

SAME_SECOND = PROTOCOLS["same"]
TRIALS = made_trials(each=2, frames=130)


@pytest.fixture(name="model", scope="module")
def _model():
    trained = finished(train(TRIALS, SAME_SECOND, replace(SMALL, recogniser=None, epochs=4), 0))
    manifest, arrays = export(trained, TRIALS, 0.01 * np.eye(3), ModelFacts("small"))
    return build_model(replace(manifest, rest_s=1.5), arrays)


def rested(trial, before: int, after: int = 0):
    """The trial with the person at rest before it and after it, for so many frames."""

    def longer(track):
        return np.concatenate([np.repeat(track[:1], before, axis=0), track, np.repeat(track[-1:], after, axis=0)])

    return replace(
        trial,
        observed_m=longer(trial.observed_m),
        controlled=longer(trial.controlled),
        active=np.ones(trial.frames + before + after),
    )


def run(model, trial):
    stage = Inference(model, trial.interaction)
    state, answers = stage.init(), []
    for window in feature_windows(trial, SAME_SECOND):
        state, motions = stage.step(state, window, window.stamp_ns)
        answers += [motion.positions for motion in motions]
    return state, np.array(answers)


def moving(trial) -> int:
    """The frame at which the hand is MOVED_M from its first place."""
    hand = trial.observed_m[:, -1]
    return int((np.linalg.norm(hand - hand[0], axis=1) > 0.05).argmax())


def test_after_a_minute_of_rest_answers_are_those_after_the_rest_that_was_learned(model):
    trial = made_trial(80, TWO[0], 130)
    assert moving(trial) < 60
    short, long = (run(model, rested(trial, frames))[1][-70:] for frames in (200, 2400))
    np.testing.assert_array_equal(short, long)
    forgetful = replace(model, manifest=replace(model.manifest, rest_s=0.0))
    short, long = (run(forgetful, rested(trial, frames))[1][-70:] for frames in (200, 2400))
    assert np.abs(short - long).max() > 1e-4


def test_what_comes_after_a_rest_is_as_if_nothing_had_been_before(model):
    trial = made_trial(81, TWO[1], 130)
    twice = replace(
        rested(trial, 0, 260),
        observed_m=np.concatenate([rested(trial, 0, 260).observed_m, trial.observed_m]),
        controlled=np.concatenate([rested(trial, 0, 260).controlled, trial.controlled]),
        active=np.ones(2 * trial.frames + 260),
    )
    state, answers = run(model, twice)
    assert state.counts["reset_at_rest"] == 1
    assert state.counts["accepted"] == len(answers)
    kept = replace(model, manifest=replace(model.manifest, rest_s=0.0))
    apart = {}
    for name, one in (("reset", model), ("kept", kept)):
        again, alone = run(one, twice)[1][-70:], run(one, rested(trial, 200))[1][-70:]
        apart[name] = np.abs(again - alone).max()
    assert apart["reset"] < 0.5 * apart["kept"]


def hand(rest, path):
    for place in path:
        rest = watch(rest, np.array(place, dtype=float), 1)
    return rest


def test_a_hand_that_trembles_waits_and_one_that_leaves_does_not():
    rest = first_seen(np.zeros((1, 3)))
    trembling = hand(rest, 0.02 * np.random.default_rng(0).uniform(-1, 1, (100, 3)))
    assert is_waiting(trembling, 60)
    assert not is_waiting(trembling, 100)
    assert not is_waiting(hand(trembling, [(0.06, 0, 0)]), 60)
    assert not is_back(trembling, 10)
    assert rests(trembling, np.array([0.0, 0.01, 0.0])) == pytest.approx(0.8)
    assert rests(trembling, np.zeros(3)) == 1.0
    assert rests(hand(trembling, [(0.06, 0, 0)]), np.zeros(3)) == 0.0  # for good
    assert rests(None, np.zeros(3)) == 0.0  # the place of rest is unknown


def test_frames_that_were_missed_are_time_too():
    rest = watch(first_seen(np.zeros((1, 3))), np.zeros(3), 50)
    assert (rest.frames, rest.still_frames) == (50, 50)
    assert is_waiting(rest, 49)
    assert not is_waiting(rest, 50)
    back = watch(watch(rest, np.array([0.0, 0.0, 0.4]), 1), np.zeros(3), 1)
    assert is_back(watch(back, np.zeros(3), 80), 80)


def test_a_hand_that_moves_in_the_first_window_does_not_wait():
    rising = np.linspace(0.0, 0.2, 40)[:, None] * np.array([0.0, 0.0, 1.0])
    assert first_seen(rising).moved
    assert not is_waiting(first_seen(rising), 0)
    assert is_waiting(first_seen(0.2 * rising), 38)
    assert not is_waiting(first_seen(0.2 * rising), 39)


@pytest.mark.parametrize(("height_m", "back"), [(0.1, True), (BACK_M + 0.05, False)])
def test_a_hand_that_is_held_still_in_another_hand_is_not_back(height_m, back):
    away = hand(first_seen(np.zeros((1, 3))), [(0, 0, 0.4)] * 5)
    assert is_back(hand(away, [(0, 0, height_m)] * 81), 80) == back
    assert not is_back(hand(away, [(0, 0, height_m)] * 79), 80)

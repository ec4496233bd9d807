# SPDX-License-Identifier: Apache-2.0
"""The robot's start pose predicts how its motion will be displaced: learned, run, kept, and never from afar."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.errors import ModelError
from mild_core.inference.model import build_model
from mild_core.inference.rest_detection import rests
from mild_core.inference.stage import Inference
from mild_core.learning.data.windows import PROTOCOLS, cut, feature_windows
from mild_core.learning.training.algorithm import train
from mild_core.learning.training.export import ModelFacts, export
from mild_core.learning.training.learned_model import finished
from mild_core.learning.training.model_predictor import ModelPredictor
from mild_core.learning.training.presets import PAPER
from mild_core.learning.training.start_pose import REACH, fit_start_pose
from mild_core.signals import JointMeasurement
from test.core.learning.made_trials import made_trial, made_trials
from test.core.learning.small_settings import SMALL, TWO

SAME_SECOND = PROTOCOLS["same"]


def displaced(trial, offset_rad: np.ndarray):
    """The robot stood elsewhere at the start, and did all of the motion half as far beside."""
    fading = np.exp(-np.arange(trial.frames) / 20.0)[:, None]
    return replace(trial, controlled=trial.controlled + offset_rad * (0.5 + 0.5 * fading))


OFFSETS = np.random.default_rng(3).normal(scale=0.1, size=(12, 3))
TRIALS = [displaced(trial, offset) for trial, offset in zip(made_trials(each=6, frames=130), OFFSETS, strict=True)]


@pytest.fixture(name="trained", scope="module")
def _trained():
    return finished(train(TRIALS, SAME_SECOND, SMALL, 0))


@pytest.fixture(name="model", scope="module")
def _model(trained):
    return build_model(*export(trained, TRIALS, 0.01 * np.eye(3), ModelFacts("small")))


@pytest.mark.parametrize("number", [0, 1])
def test_a_start_that_is_known_makes_a_new_trial_better_answered(number):
    plain = made_trials(each=6, frames=130)  # what is predicted without knowledge of the offsets
    left_out = [cut(trial, SAME_SECOND).controlled.reshape(-1, 120)[::4] for trial in plain]
    learned = fit_start_pose(TRIALS, SAME_SECOND, TWO, left_out, 4)
    assert learned is not None
    new = made_trial(70, TWO[number], 130, gain=1.0 + number)
    elsewhere = displaced(new, np.array([0.12, -0.1, 0.08]))
    predicted, true = cut(new, SAME_SECOND).controlled, cut(elsewhere, SAME_SECOND).controlled
    label, start = np.eye(2)[number], elsewhere.controlled[0]
    moved = np.array([learned.displaced(motion, start, label, 0.0) for motion in predicted])
    assert ((moved - true) ** 2).mean() < 0.5 * ((predicted - true) ** 2).mean()


def test_torch_and_the_stage_displace_alike(trained, model):
    predicted = ModelPredictor(model, SAME_SECOND).answers(TRIALS[3], TWO[0], started=True).predicted
    np.testing.assert_allclose(predicted, trained.predict(TRIALS[3], started=True), atol=1e-3)


def test_the_further_a_pose_is_from_the_start_the_less_it_is_displaced_as_the_start_is(model):
    start_pose = model.start_pose
    label, start = np.eye(2)[0], start_pose.mean[0] + np.array([0.1, 0.0, 0.0])
    poses = start_pose.mean[0] + np.linspace(0.0, 3.0, 40)[:, None] * np.array([0.0, 1.0, 0.0])
    shifts = (start_pose.displaced(poses, start, label, 0.0) - poses)[:, 0]
    assert 0.05 < shifts[0] < 0.11
    assert (np.diff(shifts) < 0.0).all()
    assert np.abs(np.diff(shifts)).max() < 0.01  # nothing jumps


@pytest.mark.parametrize(("times_reach", "used"), [(0.99, True), (1.01, False)])
def test_a_start_beyond_all_that_was_seen_is_ignored(model, times_reach, used):
    start_pose = model.start_pose
    far = start_pose.mean[1] + times_reach * start_pose.reach[0] * np.array([0.0, 0.6, 0.8])
    poses = np.tile(start_pose.mean[1], (40, 1))
    for resting in (0.0, 1.0):
        assert (start_pose.displaced(poses, far, np.eye(2)[1], resting) != poses).any() == used


def test_while_the_person_rests_the_robot_stands_where_it_stood(model):
    start_pose, label = model.start_pose, np.eye(2)[0]
    start = start_pose.mean[0] + np.array([0.1, -0.1, 0.05])
    poses = start_pose.mean[0] + np.linspace(0.0, 3.0, 300)[:, None] * np.array([0.0, 1.0, 0.0])
    gone, half, resting = (start_pose.displaced(poses, start, label, share) for share in (0.0, 0.5, 1.0))
    np.testing.assert_allclose(half, 0.5 * (gone + resting))
    assert np.linalg.norm(resting[0] - start) < 0.05 * np.linalg.norm(gone[0] - start)
    np.testing.assert_allclose(resting[200:], gone[200:], atol=1e-6)  # what is meant to move, moves
    assert np.linalg.norm(np.diff(resting - gone, axis=0), axis=1).max() < 0.02  # and nothing jumps


def test_who_rests_less_and_less_ends_the_standing_without_a_jump(model):
    stage, trial = Inference(model, TWO[0]), TRIALS[0]
    still = {name: np.repeat(getattr(trial, name)[:1], 60, axis=0) for name in ("observed_m", "controlled", "active")}
    rested = replace(trial, **{name: np.concatenate([rest, getattr(trial, name)]) for name, rest in still.items()})
    informed, _ = stage.step(stage.init(), measured(trial.controlled[0]), 0)
    both = []
    for state in (stage.init(), informed):
        answers = []
        for window in feature_windows(rested, SAME_SECOND):
            state, motions = stage.step(state, window, window.stamp_ns)
            answers.append((motions[0].positions, rests(state.rest, window.features[-1, 6:9])))
        both.append(answers)
    shares = np.array([share for _, share in both[1]])
    assert shares[0] == 1.0
    assert shares[-1] == 0.0
    assert np.abs(np.diff(shares)).max() < 0.5
    drawn = np.array([after - before for (before, _), (after, _) in zip(*both, strict=True)])[:, 0]
    assert np.abs(np.diff(drawn, axis=0)).max() < 0.5 * np.abs(drawn).max()
    near = [np.abs(motion[0] - trial.controlled[0]).max() for (motion, _) in (both[0][0], both[1][0])]
    assert near[1] < near[0]


def measured(positions, stamp_ns=0, names=None):
    return JointMeasurement(stamp_ns, names or TRIALS[0].controlled_names, np.asarray(positions))


def test_the_start_is_taken_while_no_interaction_runs(model):
    stage = Inference(model, TWO[0])
    state, _ = stage.step(stage.init(), measured([0.1, 0.2, 0.3]), 0)
    np.testing.assert_array_equal(state.start, [0.1, 0.2, 0.3])
    windows = list(feature_windows(TRIALS[0], SAME_SECOND))
    for window in windows[:3]:
        state, motions = stage.step(state, window, window.stamp_ns)
        assert len(motions) == 1
    during, _ = stage.step(state, measured([0.5, 0.5, 0.5], windows[2].stamp_ns + 20_000_000), 0)
    np.testing.assert_array_equal(during.start, [0.1, 0.2, 0.3])
    later, _ = stage.step(during, measured([0.5, 0.5, 0.5], windows[2].stamp_ns + 2_000_000_000), 0)
    np.testing.assert_array_equal(later.start, [0.5, 0.5, 0.5])
    assert later.counts == state.counts


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (measured([0.9, 0.2], names=TRIALS[0].controlled_names[:2]), "joints_missing"),
        (measured([0.1, np.nan, 0.2]), "not_finite"),
        (measured([0.1, 0.2, 2.3]), "doubted"),
    ],
)
def test_what_holds_no_pose_is_counted_and_changes_nothing(model, given, reason):
    stage = Inference(model, TWO[0])
    before, _ = stage.step(stage.init(), measured([0.1, 0.2, 0.3]), 0)
    state, motions = stage.step(before, given, 10**10 if reason == "joints_missing" else 0)
    assert (state.outcome, motions, dict(state.counts)) == (reason, (), {reason: 1})
    np.testing.assert_array_equal(state.start, before.start)


@pytest.mark.parametrize(("name", "wrong"), [("reach", np.zeros(1)), ("mean", np.zeros((2, 4)))])
def test_arrays_that_do_not_fit_are_named(trained, model, name, wrong):
    manifest, arrays = export(trained, TRIALS, np.eye(3), ModelFacts("x"))
    with pytest.raises(ModelError, match=r"start_pose\."):
        build_model(manifest, {**arrays, f"start_pose.{name}": wrong})
    assert np.isclose(model.start_pose.reach[0], REACH * np.linalg.norm(unusual(), axis=1).max())


def unusual() -> np.ndarray:
    """Starts of all trials less the mean one of their interaction."""
    starts = np.array([trial.controlled[0] for trial in TRIALS])
    names = np.array([trial.interaction for trial in TRIALS])
    return starts - np.array([starts[names == name].mean(axis=0) for name in names])


def test_a_robot_that_always_starts_at_one_place_and_a_partner_have_none():
    still = [replace(t, controlled=t.controlled - t.controlled[0]) for t in TRIALS]
    answers = [np.zeros((len(cut(t, SAME_SECOND).controlled[::4]), 120)) for t in TRIALS]
    assert fit_start_pose(still, SAME_SECOND, TWO, answers, 4) is None
    assert fit_start_pose(TRIALS, SAME_SECOND, TWO, answers, 4) is not None
    arms = [replace(t, controlled=np.zeros((t.frames, 3, 3))) for t in TRIALS]
    assert fit_start_pose(arms, SAME_SECOND, TWO, answers, 4) is None
    assert not PAPER.start_pose

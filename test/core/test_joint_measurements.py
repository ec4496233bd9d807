# SPDX-License-Identifier: Apache-2.0
"""Where the robot is: merged over messages, bounded by what joints can do, and never by two voices at once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mild_core.joint_measurements import BELIEVE_AFTER_S, DISAGREE_WITHIN_S, JointMerger, JointTracks
from mild_core.retargeting.limiter import JointMotion
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.shapes import FloatArray
from mild_core.signals import JointMeasurement
from test.core.retargeting.perfect import START_NS
from test.core.retargeting.run import AWAY, Run

MS = 1_000_000
NAMES = YUMI.joint_names
MERGER = JointMerger(NAMES, tuple(YUMI.velocity_rad_s.tolist()))
HOME, ZERO = YUMI.home_rad, np.clip(np.zeros(7), YUMI.lower_rad, YUMI.upper_rad)


def said(names: tuple[str, ...], positions: object, stamp_ns: int = 0) -> JointMeasurement:
    return JointMeasurement(stamp_ns, names, np.asarray(positions, dtype=np.float64))


def take(*messages: tuple[float, JointMeasurement]) -> tuple[JointTracks, list[str]]:
    """The tracks after messages that came at these times [s], and all outcomes."""
    tracks, outcomes = JointTracks(), []
    for time_s, message in messages:
        tracks = MERGER.take(tracks, message, START_NS + round(time_s * 1e9))
        outcomes.append(tracks.outcome)
    return tracks, outcomes


def swinging(time_s: float) -> FloatArray:
    """A pose of a robot in motion, at 0.9 of its speed limits at most."""
    return HOME + 0.9 * YUMI.velocity_rad_s * 0.3 * np.sin(time_s / 0.3)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.randoms(use_true_random=False), st.integers(1, 7), st.booleans())
def test_any_split_of_joints_over_messages_gives_the_same_pose(rng: object, parts: int, gripper: bool) -> None:
    """Each joint in some message of each round, in any order, with joints of others whose values are anything."""
    tracks, complete = JointTracks(), False
    for step in range(40):
        places = list(range(7))
        rng.shuffle(places)  # type: ignore[attr-defined]
        cuts = [places[start::parts] for start in range(parts)]
        pose = swinging(step * 0.02)
        for number, cut in enumerate(cuts):
            names, values = tuple(NAMES[place] for place in cut), [pose[place] for place in cut]
            if gripper:
                names, values = ("gripper", *names), [rng.choice([np.nan, np.inf, 99.0]), *values]  # type: ignore[attr-defined]
            tracks = MERGER.take(tracks, said(names, values, step), START_NS + step * 20 * MS + number * MS)
            complete = complete or number == len(cuts) - 1
            assert tracks.outcome == ("measured" if complete else "joints_missing")
        np.testing.assert_array_equal(tracks.positions_rad, pose)
        assert not tracks.disagree(START_NS + step * 20 * MS)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.integers(0, 120), min_size=20, max_size=60), st.integers(0, 2**32 - 1))
def test_late_messages_of_a_moving_robot_are_believed(latencies_ms: list[int], seed: int) -> None:
    """Measured every 20 ms, delivered up to 120 ms later, in order, so that several may come at one time."""
    rng, came_ns = np.random.default_rng(seed), START_NS
    tracks = JointTracks()
    for number, latency_ms in enumerate(latencies_ms):
        came_ns = max(came_ns, START_NS + (number * 20 + latency_ms) * MS)
        pose = swinging(number * 0.02) + rng.normal(0.0, 0.002, 7)
        tracks = MERGER.take(tracks, said(NAMES, pose, START_NS + number * 20 * MS), came_ns)
        assert tracks.outcome == "measured"


def test_joints_of_others_are_no_word_of_ours() -> None:
    _, outcomes = take((0.0, said(("gripper",), [0.0])), (0.1, said(NAMES, HOME)), (0.2, said(("gripper",), [np.nan])))
    assert outcomes == ["joints_missing", "measured", "other_joints"]


def test_a_joint_that_falls_silent_leaves_the_pose_incomplete() -> None:
    rest = [(0.1 * step, said(NAMES[1:], HOME[1:])) for step in range(1, 8)]
    tracks, outcomes = take((0.0, said(NAMES, HOME)), *rest)
    assert outcomes == ["measured"] * 6 + ["joints_missing"] * 2
    assert NAMES[0] in tracks.detail
    assert NAMES[1] not in tracks.detail


@pytest.mark.parametrize(
    ("names", "positions", "reason"),
    [
        (NAMES, [*HOME[:6], np.nan], "not_finite"),
        ((*NAMES, NAMES[0]), [*HOME, 0.5], "wrong_layout"),
        (NAMES, ZERO, "doubted"),
    ],
)
def test_a_bad_message_changes_nothing(names: tuple[str, ...], positions: object, reason: str) -> None:
    tracks, outcomes = take((0.0, said(NAMES, HOME)), (0.02, said(names, positions)))
    assert outcomes[-1] == reason
    np.testing.assert_array_equal(tracks.positions_rad, HOME)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(("speed", "outcome"), [(1.8, "measured"), (2.4, "doubted")])
def test_a_hand_moves_a_joint_up_to_twice_as_fast_as_its_motor_either_way(
    way: float, speed: float, outcome: str
) -> None:
    moved = HOME + way * speed * 0.4 * YUMI.velocity_rad_s * (np.arange(7) == 2)
    _, outcomes = take((0.0, said(NAMES, HOME)), (0.4, said(NAMES, moved)))
    assert outcomes == ["measured", outcome]


@pytest.mark.parametrize(("beyond_rad", "outcome"), [(-0.01, "measured"), (0.01, "outside_limits")])
@pytest.mark.parametrize("upper", [False, True])
def test_a_joint_beyond_either_limit_is_not_believed(upper: bool, beyond_rad: float, outcome: str) -> None:
    lower_rad, upper_rad = tuple(YUMI.lower_rad.tolist()), tuple(YUMI.upper_rad.tolist())
    pose = HOME.copy()
    pose[3] = upper_rad[3] + beyond_rad if upper else lower_rad[3] - beyond_rad
    merger = JointMerger(NAMES, MERGER.velocity_rad_s, lower_rad, upper_rad)
    assert merger.take(JointTracks(), said(NAMES, pose), START_NS).outcome == outcome


def test_a_late_stamp_does_not_undo_a_newer_one_but_another_clock_is_no_late_stamp() -> None:
    newer, older = said(NAMES, HOME + 0.02, START_NS), said(NAMES, HOME, START_NS - 20 * MS)
    tracks, outcomes = take((0.0, newer), (0.01, older), (0.02, said(NAMES, HOME, START_NS - 10**10)))
    assert outcomes == ["measured", "late_joints", "measured"]
    np.testing.assert_array_equal(tracks.positions_rad, HOME)


def test_one_glitch_is_not_believed_and_holds_nothing() -> None:
    messages = [(0.02 * step, said(NAMES, ZERO if step == 10 else HOME)) for step in range(20)]
    tracks, outcomes = take(*messages)
    assert outcomes == ["measured"] * 10 + ["doubted"] + ["measured"] * 9
    assert not tracks.disagree(START_NS + 400 * MS)


def test_a_wrong_first_message_is_outlived() -> None:
    messages = [(0.02 * step, said(NAMES, ZERO if step == 0 else HOME)) for step in range(60)]
    tracks, outcomes = take(*messages)
    believed = outcomes.index("measured", 1)
    assert believed * 0.02 <= BELIEVE_AFTER_S + 0.05
    assert set(outcomes[believed:]) == {"measured"}
    assert not tracks.disagree(START_NS + 1200 * MS)
    np.testing.assert_array_equal(tracks.positions_rad, HOME)


def test_two_voices_are_never_believed_in_turn() -> None:
    both = [
        (0.02 * step + 0.001 * late, said(NAMES, pose)) for step in range(200) for late, pose in enumerate((HOME, ZERO))
    ]
    tracks, outcomes = take(*both)
    assert outcomes == ["measured", "doubted"] * 200
    end_ns = START_NS + 4 * 10**9
    assert tracks.disagree(end_ns)
    assert not tracks.disagree(end_ns + round(DISAGREE_WITHIN_S * 1e9))


def test_a_clock_that_goes_back_starts_over() -> None:
    tracks, outcomes = take((10.0, said(NAMES, HOME)), (1.0, said(NAMES, ZERO)))
    assert outcomes == ["measured", "measured"]
    np.testing.assert_array_equal(tracks.positions_rad, ZERO)


def give(run: Run, names: tuple[str, ...], positions: FloatArray) -> None:
    run.give(JointMeasurement(run.now_ns, names, positions))


def test_nan_of_a_gripper_stops_nothing() -> None:
    run = Run(at_rad=None)
    for _ in range(100):
        here = HOME if run.state.motion is None else np.array(run.state.motion.position_rad)
        give(run, (*NAMES, "gripper"), np.array([*here, np.nan]))
        run.wait(0.02, AWAY)
    assert run.last.mode == "following"
    np.testing.assert_allclose(run.last.positions_rad, AWAY, atol=0.02)


def following(run: Run, other: FloatArray | None, seconds: float) -> None:
    """The robot says where it is; between its messages another publisher says something else."""
    for _ in range(round(seconds / 0.02)):
        assert run.state.motion is not None
        give(run, NAMES, np.array(run.state.motion.position_rad))
        run.wait(0.01, AWAY)
        if other is not None:
            give(run, NAMES, other)
        run.wait(0.01, AWAY)


def test_two_publishers_that_disagree_hold_the_robot_until_one_is_gone() -> None:
    run = Run()
    following(run, None, 0.2)
    assert run.last.mode == "following"
    following(run, ZERO, 2.0)
    assert run.last.mode == "holding"
    assert not run.last.velocities_rad_s.any()
    assert run.state.counts["joint_states_disagree"] == 1
    assert "displaced" not in run.state.counts
    following(run, None, DISAGREE_WITHIN_S + 0.2)
    assert run.last.mode == "following"


def test_a_robot_that_came_up_elsewhere_is_not_held_for_ever() -> None:
    run = Run()
    following(run, None, 0.2)
    for _ in range(200):
        give(run, NAMES, ZERO)
        run.wait(0.02)
    assert run.state.counts["displaced"] == 1
    assert isinstance(run.state.motion, JointMotion)
    np.testing.assert_allclose(run.state.motion.position_rad, ZERO, atol=0.35)


def test_contradicting_publishers_get_no_first_command() -> None:
    run = Run(at_rad=None)
    for pose in (HOME, ZERO) * 3:
        give(run, NAMES, pose)
    run.wait(0.5)
    assert run.commands == []


def test_a_slow_joint_that_really_is_elsewhere_is_believed_after_a_while() -> None:
    slow = JointMerger(NAMES, (0.2,) * 7)
    tracks, outcomes = JointTracks(), []
    for step in range(60):
        pose = HOME if step == 0 else HOME + 2.0
        tracks = slow.take(tracks, said(NAMES, pose), START_NS + step * 20 * MS)
        outcomes.append(tracks.outcome)
    believed = outcomes.index("measured", 1)
    assert BELIEVE_AFTER_S <= (believed - 1) * 0.02 <= BELIEVE_AFTER_S + 0.05
    assert set(outcomes[believed:]) == {"measured"}

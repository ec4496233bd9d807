# SPDX-License-Identifier: Apache-2.0
"""The stage from messages to windows: known motions at every rate, what is refused and why, what resets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mild_core.perception.stage import Perception
from mild_core.signals import SkeletonFrame
from test.core.perception.scene import (
    FASTEST_M_S,
    PERSON,
    SECOND,
    SETTINGS,
    SHARPEST_M_S2,
    People,
    at_rate,
    changed,
    newest_arms,
    run,
    seen,
    stamps_s,
    swing,
    truth,
)
from test.faults.people import TrackerFault, left_is_right, turned
from test.faults.table import MIRROR

EXACT_M = 1e-9
"""Positions are rotated and scaled in float64 at the scale of metres: about 1e-15 of them is lost."""

OUTCOMES = {
    *("accepted", "calibrating", "moving", "interrupted", "no_person", "other_person", "duplicate", "out_of_order"),
    "unknown_frame",
    *("missing_joint", "not_finite", "zeroed", "out_of_range", "low_confidence", "bone_length"),
    *("flat_torso", "wrong_up_axis", "wrong_forward_axis", "mirrored"),
}


def test_a_tracker_at_the_models_rate_gives_one_exact_window_per_message() -> None:
    state, windows = run(seen(at_rate(40.0, 4.0)))
    assert dict(state.counts) == {"calibrating": 40, "calibrated": 1, "accepted": 120, "windows": 120}
    assert [window.stamp_ns for window in windows] == [SECOND + index * SECOND // 40 for index in range(120)]
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=EXACT_M)
    rows = np.stack([*np.repeat(truth(windows)[:1], 39, axis=0), *truth(windows)]).reshape(-1, 9)
    for index, window in enumerate(windows):
        np.testing.assert_allclose(window.features, rows[index : index + 40], atol=EXACT_M)
        assert window.joint_names == ("shoulder", "elbow", "hand")
        assert window.frame_id == "arm"


@pytest.mark.parametrize("rate_hz", [5.0, 12.0, 15.0, 25.0, 30.0, 40.0, 60.0, 100.0, 250.0])
def test_every_rate_shows_the_same_motion(rate_hz: float) -> None:
    messages = seen(at_rate(rate_hz, 6.0))
    state, windows = run(messages)
    # Linear interpolation is off by a dt^2 / 8; 1.5 because the adult's bones that are interpolated are longer.
    tolerance_m = 1.5 * SHARPEST_M_S2 / rate_hz**2 / 8.0
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=tolerance_m)
    grid_s = stamps_s(windows)[0] + np.arange(len(windows)) / 40.0
    # A frame that snaps shows the arm up to a fifth of a period, of either, before its grid point.
    early_s = 0.2 * min(0.025, 1.0 / rate_hz)
    assert -1e-9 <= (grid_s - stamps_s(windows)).min() <= (grid_s - stamps_s(windows)).max() <= early_s + 1e-9
    at_grid = swing(grid_s - 1.0)
    np.testing.assert_allclose(newest_arms(windows), at_grid, atol=tolerance_m + FASTEST_M_S * early_s)
    newest_s = messages[-1][0].stamp_ns / SECOND
    assert -early_s - 1e-9 <= newest_s - grid_s[-1] < 0.025
    assert not {"filled", "missed", "gap_reset"} & set(state.counts)


def test_a_jittering_tracker_gives_one_window_per_message_without_waiting() -> None:
    jitter = np.random.default_rng(3).uniform(-0.002, 0.002, 400)
    jitter[:41] = 0.0  # the grid starts at an even stamp
    messages = seen(at_rate(40.0, 10.0) + jitter)
    perception, made = Perception(SETTINGS), []
    state = perception.init()
    for people in messages:
        state, windows = perception.step(state, people, people[0].stamp_ns)
        if state.calibration:
            assert len(windows) == 1
        made += windows
    # Interpolation between frames up to 29 ms apart at 2.8 m/s^2: 0.0003 m.
    np.testing.assert_allclose(newest_arms(made), truth(made), atol=0.0004)


def test_velocities_are_metres_per_second() -> None:
    _, windows = run(seen(at_rate(40.0, 4.0)), replace(SETTINGS, features="positions_velocities"))
    positions = truth(windows).reshape(-1, 9)
    velocities = np.diff(positions, axis=0, prepend=positions[:1]) * 40.0
    assert np.abs(velocities).max() > 0.3
    for index, window in enumerate(windows):
        np.testing.assert_allclose(window.features[-1], [*positions[index], *velocities[index]], atol=1e-7)
        assert not window.features[: max(0, 40 - index), 9:].any()  # at rest before the first frame


def _broken(joint: str, **values: object) -> object:
    return lambda frame: changed(frame, joint, **values)


REFUSED = {
    "not_finite": _broken("right_hand", position=(np.nan, 0.0, 1.0)),
    "zeroed": _broken("right_elbow", position=(0.0, 0.0, 0.0)),
    "out_of_range": _broken("right_shoulder", position=(120.0, 300.0, 2000.0)),
    "low_confidence": _broken("right_hand", confidence=0.3),
    "bone_length": _broken("right_hand", position=(1.0, 1.0, 2.0)),
    "missing_joint": lambda frame: replace(
        frame, joint_names=frame.joint_names[:13], positions_m=frame.positions_m[:13], confidence=frame.confidence[:13]
    ),
    "unknown_frame": lambda frame: replace(frame, frame_id="another_camera"),
    "no_person": lambda frame: None,
}


def test_a_confidence_that_is_no_number_is_none() -> None:
    messages = seen(at_rate(40.0, 1.1))
    messages[-1] = (changed(messages[-1][0], "right_elbow", confidence=np.nan),)
    state, _ = run(messages)
    assert state.outcome == "low_confidence"


@pytest.mark.parametrize("infinite", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_no_coordinate_may_be_infinite(infinite: float, axis: int) -> None:
    position = [0.1, 0.1, 2.0]
    position[axis] = infinite
    messages = seen(at_rate(40.0, 1.1))
    messages.append((changed(seen([1.1])[0][0], "right_elbow", position=position),))
    state, _ = run(messages)
    assert state.outcome == "not_finite"


@pytest.mark.parametrize("reason", REFUSED)
def test_what_cannot_be_believed_is_refused_by_name_and_bridged(reason: str) -> None:
    clean = seen(at_rate(40.0, 3.0))
    spoilt = list(clean)
    for index in (60, 61, 62, 80):
        frame = REFUSED[reason](clean[index][0])
        spoilt[index] = () if frame is None else (frame,)
    state, windows = run(spoilt)
    assert state.counts[reason] == 4
    assert state.counts["filled"] == 4
    assert state.counts["accepted"] == 76
    assert "missed" not in state.counts
    _, expected = run(clean)
    assert [window.stamp_ns for window in windows] == [window.stamp_ns for window in expected]
    # Bridging 100 ms at 2.8 m/s^2 by a straight line: 2.8 * 0.1^2 / 8 = 0.0035 m.
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=0.004)
    assert np.abs(newest_arms(windows) - newest_arms(expected)).max() > 1e-5


def test_messages_that_never_came_are_counted_from_the_stamps() -> None:
    messages = seen(at_rate(40.0, 3.0))
    del messages[60:64], messages[90]
    state, windows = run(messages)
    assert (state.counts["missed"], state.counts["filled"], len(windows)) == (5, 5, 80)


@pytest.mark.parametrize(("gap_s", "bridged"), [(0.45, True), (0.5, True), (0.525, False), (3.0, False)])
def test_a_long_gap_empties_the_window_and_a_short_one_does_not(gap_s: float, bridged: bool) -> None:
    times = np.concatenate([at_rate(40.0, 2.0), 1.975 + gap_s + at_rate(40.0, 1.0)])
    state, windows = run(seen(times))
    assert ("gap_reset" in state.counts) is not bridged
    first = next(window for window in windows if window.stamp_ns >= round((1.975 + gap_s) * SECOND))
    at_rest = bool((first.features == first.features[-1]).all())
    assert at_rest is not bridged
    assert stamps_s(windows)[-1] == pytest.approx(times[-1])
    if bridged:
        assert state.counts["filled"] == round(gap_s * 40) - 1
        assert np.diff(stamps_s(windows)).max() < 0.0251


def test_the_same_stamp_twice_and_a_late_message_are_counted_and_change_nothing() -> None:
    messages = seen(at_rate(40.0, 2.0))
    _, expected = run(messages)
    messages.insert(60, messages[59])
    messages.insert(70, messages[64])
    state, windows = run(messages)
    assert (state.counts["duplicate"], state.counts["out_of_order"]) == (1, 1)
    assert len(windows) == len(expected)
    for one, other in zip(windows, expected, strict=True):
        assert one.stamp_ns == other.stamp_ns
        np.testing.assert_array_equal(one.features, other.features)


def test_a_bag_that_loops_resets() -> None:
    messages = seen(at_rate(40.0, 3.0))
    state, once = run(messages)
    state, twice = run(messages, state=state)
    assert state.counts["time_reset"] == 1
    assert state.counts["calibrated"] == 2
    for one, other in zip(once, twice, strict=True):
        assert one.stamp_ns == other.stamp_ns
        np.testing.assert_array_equal(one.features, other.features)


def test_every_message_has_one_outcome() -> None:
    messages = seen(at_rate(40.0, 3.0))
    messages[50:53] = [(), (changed(messages[51][0], "right_hand", confidence=0.1),), ()]
    messages.insert(70, messages[69])
    state, _ = run(messages)
    assert sum(number for reason, number in state.counts.items() if reason in OUTCOMES) == len(messages)
    assert state.outcome == "accepted"
    assert state.detail == ""


def test_states_do_not_change_and_steps_repeat() -> None:
    messages = seen(at_rate(40.0, 1.5))
    state, _ = run(messages[:-1])
    before = dict(state.counts)
    perception = Perception(SETTINGS)
    results = [perception.step(state, messages[-1], 0) for _ in range(2)]
    assert dict(state.counts) == before
    np.testing.assert_array_equal(results[0][1][0].features, results[1][1][0].features)
    with pytest.raises(ValueError, match="read-only"):
        results[0][1][0].features[0, 0] = 1.0


def test_four_joints_and_the_persons_own_bones() -> None:
    settings = replace(SETTINGS, joint_names=("shoulder", "elbow", "wrist", "hand"), bone_lengths_m=())
    _, windows = run(seen(at_rate(40.0, 2.0)), settings)
    arm = windows[-1].features[-1].reshape(4, 3)
    np.testing.assert_allclose(np.linalg.norm(np.diff(arm, axis=0), axis=1), [0.29, 0.75 * 0.335, 0.25 * 0.335])


def test_a_wrist_stands_in_for_a_hand() -> None:
    def handless(people: People) -> People:
        (frame,) = people
        kept = [index for index, name in enumerate(frame.joint_names) if "hand" not in name]
        names = tuple(frame.joint_names[index] for index in kept)
        shown = SkeletonFrame(
            frame.stamp_ns, frame.frame_id, PERSON, names, frame.positions_m[kept], frame.confidence[kept]
        )
        return (shown,)

    _, windows = run([handless(people) for people in seen(at_rate(40.0, 2.0))])
    np.testing.assert_allclose(newest_arms(windows), truth(windows, swing), atol=EXACT_M)


@pytest.mark.parametrize(
    ("reason", "fault"),
    [
        ("mirrored", turned(MIRROR)),
        ("mirrored", left_is_right),
        ("wrong_up_axis", turned(((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)))),
    ],
)
def test_axes_that_turn_all_of_a_sudden_move_nothing(reason: str, fault: TrackerFault) -> None:
    messages = seen(at_rate(40.0, 3.0))
    spoilt = [message for (frame,) in messages[60:100] for message in fault(frame, 0.0)]
    state, windows = run(messages[:60] + spoilt + messages[100:])
    # Upside down the person seems to be elsewhere at first.
    assert state.counts[reason] + state.counts.get("other_person", 0) == 40
    assert state.counts["gap_reset"] == 1
    assert state.counts["accepted"] == 40
    assert state.lock is not None
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=EXACT_M)

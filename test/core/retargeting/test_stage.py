# SPDX-License-Identifier: Apache-2.0
"""What retargeting does when input starts, stops or is bad."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Mode, RetargetingSettings
from mild_core.shapes import FloatArray
from mild_core.signals import JointMeasurement
from test.core.retargeting.limits import check_limits
from test.core.retargeting.perfect import START_NS, TICK_NS, measurement, window
from test.core.retargeting.run import AWAY, SECOND_NS, Run


def test_nothing_is_commanded_before_the_robot_says_where_it_is() -> None:
    run = Run(at_rad=None)
    run.wait(0.5, AWAY)
    assert run.commands == []
    assert run.state.mode is Mode.WAITING
    assert run.state.counts == {"tick": 50, "no_joint_states": 17}


def test_the_first_command_is_where_the_robot_is() -> None:
    run = Run(at_rad=AWAY)
    run.wait(0.5)
    np.testing.assert_array_equal(run.commands[0].positions_rad, AWAY)
    np.testing.assert_array_equal(run.last.positions_rad, AWAY)
    assert {command.mode for command in run.commands} == {"idle"}
    run.wait(1.0, YUMI.home_rad)
    check_limits(YUMI, run.commands)
    assert run.last.mode == "following"
    assert START_NS < run.last.motion_stamp_ns <= run.now_ns


def test_one_command_per_time() -> None:
    run = Run()
    run.now_ns += TICK_NS
    far = window(np.tile(AWAY, (40, 1)), run.now_ns)
    assert [run.give(each) for each in (far, far, None, None)] == ["accepted", "accepted", "tick", "tick"]
    assert [command.stamp_ns for command in run.commands] == [run.now_ns]


@pytest.mark.parametrize("reason", ["held_stale", "held_unknown"])
def test_without_a_usable_motion_it_holds_then_goes_home_slowly_and_is_ready_again(reason: str) -> None:
    run = Run()
    run.wait(1.0, AWAY)
    assert run.last.mode == "following"
    moving = len(run.commands)
    if reason == "held_stale":
        run.wait(0.7)
    else:
        run.wait(0.4, YUMI.home_rad - 0.5, interaction="")
    assert run.last.mode == "holding"
    assert run.state.counts[reason] == 1
    assert run.last.motion_stamp_ns == 0
    held = run.last.positions_rad
    run.wait(1.5)
    np.testing.assert_array_equal(run.last.positions_rad, held)
    np.testing.assert_array_equal(run.last.velocities_rad_s, np.zeros(7))
    run.wait(6.0)
    returning = [command for command in run.commands[moving:] if command.mode == "returning"]
    assert np.abs([command.velocities_rad_s for command in returning]).max() <= 0.5 + 1e-9
    assert run.last.mode == "idle"
    np.testing.assert_allclose(run.last.positions_rad, YUMI.home_rad, atol=1e-6)
    run.wait(2.0, AWAY)
    assert run.last.mode == "following"
    np.testing.assert_allclose(run.last.positions_rad, AWAY, atol=1e-6)
    check_limits(YUMI, run.commands)


def test_a_motion_on_the_way_home_is_followed_at_once() -> None:
    run = Run()
    run.wait(1.0, AWAY)
    run.wait(2.8)
    assert run.last.mode == "returning"
    run.wait(1.5, AWAY)
    assert run.last.mode == "following"
    np.testing.assert_allclose(run.last.positions_rad, AWAY, atol=1e-6)
    check_limits(YUMI, run.commands)


def test_old_motions_that_still_arrive_do_not_count_as_fresh() -> None:
    run = Run()
    run.wait(0.5, AWAY)
    stamp_ns = run.now_ns
    for _ in range(150):
        run.now_ns += TICK_NS
        run.give(window(np.tile(AWAY, (40, 1)), stamp_ns), None)
    assert run.state.mode is Mode.HOLDING
    assert run.state.counts["too_old"] == 50
    assert run.state.counts["held_stale"] == 1


def test_a_blink_of_the_model_is_bridged_and_a_score_near_its_bound_does_not_flicker() -> None:
    run = Run()
    run.wait(1.0, AWAY)
    run.wait(0.15, AWAY, interaction="")
    run.wait(0.5, AWAY, out_of_distribution=0.95)
    assert {command.mode for command in run.commands[5:]} == {"following"}
    run.wait(0.5, AWAY, out_of_distribution=1.05)
    run.wait(0.5, AWAY, out_of_distribution=0.95)
    assert run.last.mode == "holding"
    run.wait(0.1, AWAY, out_of_distribution=0.75)
    assert run.last.mode == "following"


def _not_finite(row: int) -> FloatArray:
    rows = np.tile(AWAY, (40, 1))
    rows[row, 3] = np.inf if row else np.nan
    return rows


@pytest.mark.parametrize(
    ("reason", "rows", "fields"),
    [
        ("not_finite", _not_finite(0), {}),
        ("not_finite", _not_finite(39), {}),
        ("not_finite", np.tile(AWAY, (40, 1)), {"out_of_distribution": np.nan}),
        ("wrong_joints", np.tile(AWAY[:6], (40, 1)), {"joint_names": YUMI.joint_names[:6]}),
        ("wrong_joints", np.tile(AWAY, (40, 1)), {"joint_names": (*YUMI.joint_names[:6], "yumi_joint_6_l")}),
        ("wrong_joints", np.tile(AWAY, (40, 1)), {"joint_names": (*YUMI.joint_names[:6], "yumi_joint_1_r")}),
        ("wrong_joints", np.zeros((40, 7, 3)), {}),
        ("too_old", np.tile(AWAY, (40, 1)), {"stamp_ns": START_NS - 2 * SECOND_NS}),
        ("from_future", np.tile(AWAY, (40, 1)), {"stamp_ns": START_NS + 5 * SECOND_NS}),
        ("out_of_order", np.tile(AWAY, (40, 1)), {"stamp_ns": START_NS + 4 * TICK_NS}),
    ],
)
def test_a_bad_motion_is_counted_and_changes_nothing(reason: str, rows: FloatArray, fields: dict[str, object]) -> None:
    run, clean = Run(), Run()
    for each in (run, clean):
        each.wait(0.5, YUMI.home_rad)
    bad = window(rows, **({"stamp_ns": run.now_ns} | fields))  # type: ignore[arg-type]
    assert run.give(bad) == reason
    assert run.state.counts[reason] == 1
    for each in (run, clean):
        each.wait(0.1)
    assert len(run.commands) == len(clean.commands)
    np.testing.assert_array_equal(run.last.positions_rad, clean.last.positions_rad)


def test_joints_may_come_in_another_order() -> None:
    run = Run()
    run.wait(2.0, AWAY[::-1].copy(), joint_names=YUMI.joint_names[::-1])
    np.testing.assert_allclose(run.last.positions_rad, AWAY, atol=1e-6)


@pytest.mark.parametrize(
    ("reason", "names", "positions"),
    [
        ("joints_missing", YUMI.joint_names[:5], YUMI.home_rad[:5]),
        ("not_finite", YUMI.joint_names, np.full(7, np.nan)),
        ("outside_limits", YUMI.joint_names, np.rad2deg(YUMI.home_rad)),
    ],
)
def test_a_bad_measurement_is_counted_and_does_not_start_anything(
    reason: str, names: tuple[str, ...], positions: FloatArray
) -> None:
    run = Run(at_rad=None)
    assert run.give(JointMeasurement(START_NS, names, positions)) == reason
    run.wait(0.1)
    assert run.commands == []


def test_other_joints_may_be_measured_too() -> None:
    run = Run(at_rad=None)
    names = ("yumi_joint_1_l", *YUMI.joint_names[::-1])
    assert run.give(JointMeasurement(START_NS, names, np.array([9.0, *AWAY[::-1]]))) == "measured"
    run.wait(0.1)
    np.testing.assert_array_equal(run.last.positions_rad, AWAY)


def test_a_robot_that_falls_silent_is_stopped_until_it_speaks_again() -> None:
    run = Run()
    for _ in range(10):
        run.wait(0.1, AWAY)
        run.give(measurement(run.last.positions_rad))
    run.wait(0.4, AWAY)
    assert run.last.mode == "following"
    run.wait(3.0, YUMI.home_rad)
    assert run.last.mode == "holding"
    assert not run.last.velocities_rad_s.any()
    assert run.state.counts["robot_silent"] == 1
    run.give(measurement(run.last.positions_rad))
    run.wait(0.1, AWAY)
    assert run.last.mode == "following"
    check_limits(YUMI, run.commands)


@pytest.mark.parametrize(
    ("name", "value"),
    [("stale_after_s", 0.0), ("home_velocity_rad_s", -1.0), ("look_ahead_s", np.nan), ("known_below", 1.5)],
)
def test_settings_out_of_range_are_one_clear_line(name: str, value: float) -> None:
    with pytest.raises(SetupError, match=name):
        RetargetingSettings(**{name: value})

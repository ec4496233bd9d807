# SPDX-License-Identifier: Apache-2.0
"""A motion window as retargeting reads it: which row belongs to which time, and to which joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mild_core.errors import DataError
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.target import RampIn, checked_plan
from test.core.retargeting.perfect import START_NS, window

JOINTS = len(YUMI.joint_names)
PERIOD_NS, LEAD_NS = 25_000_000, 75_000_000
ROWS = np.cumsum(np.random.default_rng(3).normal(0.0, 0.05, (40, JOINTS)), axis=0)
MOTION = replace(window(ROWS, START_NS), lead_ns=LEAD_NS, period_ns=PERIOD_NS)
"""Rows of random walks; the first of them lies 75 ms after the stamp."""


@pytest.mark.parametrize("row", [0, 1, 17, 39])
def test_a_row_is_read_at_its_own_time(row):
    plan = checked_plan(MOTION, YUMI, START_NS + 5)
    np.testing.assert_array_equal(plan.at(START_NS + LEAD_NS + row * PERIOD_NS), ROWS[row])
    assert (plan.stamp_ns, plan.received_ns) == (START_NS, START_NS + 5)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_between_rows_a_plan_is_a_straight_line(share):
    time_ns = START_NS + LEAD_NS + 11 * PERIOD_NS + round(share * PERIOD_NS)
    wanted = (1.0 - share) * ROWS[11] + share * ROWS[12]
    np.testing.assert_allclose(checked_plan(MOTION, YUMI, START_NS).at(time_ns), wanted, atol=1e-12)


def test_before_its_beginning_a_plan_is_its_first_row_and_after_its_end_the_last():
    plan = checked_plan(MOTION, YUMI, START_NS)
    for time_ns, row in ((START_NS, 0), (START_NS + LEAD_NS - 1, 0), (START_NS + 10**10, -1)):
        np.testing.assert_array_equal(plan.at(time_ns), ROWS[row])


def test_a_motion_that_lies_in_the_past_is_read_backwards_from_its_stamp():
    same = replace(MOTION, lead_ns=-39 * PERIOD_NS)
    np.testing.assert_array_equal(checked_plan(same, YUMI, START_NS).at(START_NS), ROWS[-1])


def test_joints_are_taken_by_name_and_not_by_place():
    order = np.random.default_rng(1).permutation(JOINTS)
    assert not np.array_equal(order[order], np.arange(JOINTS))  # no order that is its own inverse
    shuffled = replace(MOTION, joint_names=tuple(YUMI.joint_names[i] for i in order), positions=ROWS[:, order])
    np.testing.assert_array_equal(checked_plan(shuffled, YUMI, START_NS).rows, ROWS)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"joint_names": (*YUMI.joint_names[:-1], "x")}, "wrong_joints"),
        ({"period_ns": 0}, "wrong_shape"),
        ({"positions": ROWS[:0]}, "wrong_shape"),
        ({"positions": np.where(np.arange(40)[:, None] == 39, np.nan, ROWS)}, "not_finite"),
        ({"out_of_distribution": np.nan}, "not_finite"),
    ],
)
def test_what_is_no_plan_is_refused_by_its_reason(changes, reason):
    if "positions" in changes and not len(changes["positions"]):
        motion = replace(MOTION)
        object.__setattr__(motion, "positions", changes["positions"])
    else:
        motion = replace(MOTION, **changes)
    with pytest.raises(DataError) as refused:
        checked_plan(motion, YUMI, START_NS)
    assert refused.value.reason == reason


def test_the_way_onto_a_plan_begins_where_the_robot_is_never_exceeds_its_speed_and_ends_on_the_plan():
    aimed, here, peak, step_s = np.full(JOINTS, 0.4), (0.0,) * JOINTS, 0.5, 0.01
    pursuit = RampIn.onto(aimed, here)
    targets = [np.array(here)]
    for _ in range(300):
        pursuit, target = pursuit.nearer(aimed, peak, 0.0, step_s)
        pursuit = pursuit.at(target, aimed)
        targets.append(target)
    speeds = np.abs(np.diff(targets, axis=0)) / step_s
    assert speeds.max() <= peak * (1.0 + 1e-9)
    assert speeds[0].max() < 0.1 * peak  # it comes up to its speed
    assert (np.diff(np.array(targets)[:, 0]) >= 0.0).all()
    np.testing.assert_allclose(targets[-1], aimed, atol=1e-12)


def test_hands_that_are_to_meet_may_hurry_and_a_plan_that_moves_takes_the_rest_of_the_way_along():
    onto = [RampIn(tuple([0.0] * JOINTS), tuple([-0.4] * JOINTS), 0.5) for _ in range(2)]
    calm, hurried = (
        one.nearer(np.zeros(JOINTS), 0.5, hurry, 0.01)[0] for one, hurry in zip(onto, (0.0, 1.0), strict=True)
    )
    assert hurried.speed_rad_s > calm.speed_rad_s
    _, target = onto[0].nearer(np.full(JOINTS, 1.0), 0.5, 0.0, 0.01)
    np.testing.assert_allclose(target, 1.0 - 0.4 + 0.5 * 0.01, atol=1e-9)


def test_joints_that_were_held_back_set_off_from_where_they_are_and_the_others_go_on():
    pursuit = RampIn((1.0, 2.0), (-0.1, -0.2), 0.3)
    held = pursuit.held((0.5, 1.7), (True, False))
    assert held.target_rad == (1.0, 1.7)
    np.testing.assert_allclose(held.behind_rad, (-0.1, -0.5))

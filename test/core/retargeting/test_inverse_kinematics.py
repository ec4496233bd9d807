# SPDX-License-Identifier: Apache-2.0
"""Links come to where they shall be, inside the limits, and what is left free goes to the posture."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.inverse_kinematics import InverseKinematics, Reach
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.shapes import FloatArray

MARGIN_RAD = 0.01


@pytest.fixture(scope="module")
def solver() -> InverseKinematics:
    return InverseKinematics(YUMI, (YUMI.tool_link, "yumi_link_4_r"), MARGIN_RAD)


def place(joints_rad: FloatArray, link: str = YUMI.tool_link) -> FloatArray:
    position: FloatArray = forward_kinematics(YUMI, joints_rad, link)[:3, 3]
    return position


def some_poses(number: int, spread_rad: float) -> FloatArray:
    walk = np.random.default_rng(3).normal(0.0, spread_rad, (number, 7))
    poses: FloatArray = np.clip(YUMI.home_rad + walk, YUMI.lower_rad + 0.05, YUMI.upper_rad - 0.05)
    return poses


def test_a_hand_within_reach_is_met_to_a_millimetre_and_the_posture_kept(solver: InverseKinematics) -> None:
    for start, other in zip(some_poses(30, 0.4), some_poses(60, 0.1)[30:] - YUMI.home_rad, strict=True):
        target = place(np.clip(start + other, YUMI.lower_rad + 0.05, YUMI.upper_rad - 0.05))  # some 5 cm away
        joints = solver.step(start, [Reach(YUMI.tool_link, target)], start, steps=4)
        # The posture pulls back: see POSTURE_COST.
        assert np.linalg.norm(place(joints) - target) < 1e-3
        assert np.abs(joints - start).max() < np.deg2rad(25)


def test_from_where_it_was_a_step_before_one_step_is_enough_for_a_moving_hand(solver: InverseKinematics) -> None:
    joints, centre = np.array(YUMI.home_rad), place(YUMI.home_rad)
    errors = []
    for tick in range(300):  # a circle of 8 cm at 0.5 m/s, 10 ms a step
        angle = tick * 0.01 * 0.5 / 0.08
        target = centre + 0.08 * np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
        joints = solver.step(joints, [Reach(YUMI.tool_link, target)], YUMI.home_rad)
        errors.append(np.linalg.norm(place(joints) - target))
    assert max(errors) < 2e-3


def test_limits_hold_and_joints_stay_finite_when_the_hand_is_out_of_reach(solver: InverseKinematics) -> None:
    rng = np.random.default_rng(4)
    joints = np.array(YUMI.lower_rad)  # on the limits themselves
    for _ in range(200):
        joints = solver.step(joints, [Reach(YUMI.tool_link, rng.uniform(-3.0, 3.0, 3))], YUMI.home_rad)
        assert np.isfinite(joints).all()
        assert (joints >= YUMI.lower_rad + MARGIN_RAD).all()
        assert (joints <= YUMI.upper_rad - MARGIN_RAD).all()


def test_two_links_are_placed_at_once_and_equal_calls_give_equal_bits(solver: InverseKinematics) -> None:
    start, goal = some_poses(2, 0.1)
    reaches = [Reach(link, place(goal, link)) for link in (YUMI.tool_link, "yumi_link_4_r")]
    joints = solver.step(start, reaches, start, steps=6)
    for reach in reaches:
        assert np.linalg.norm(place(joints, reach.link) - reach.point_m) < 1e-3
    solver.step(goal, reaches[:1], goal)
    np.testing.assert_array_equal(solver.step(start, reaches, start, steps=6), joints)


def test_an_unknown_link_is_one_clear_line() -> None:
    with pytest.raises(SetupError, match="is unknown"):
        InverseKinematics(YUMI, ("yumi_hand",))


def test_far_targets_are_reached_and_none_is_circled() -> None:
    """From the wanted posture, which is worth more where a hand does not come to its place."""
    drawn = InverseKinematics(YUMI, (YUMI.tool_link,), MARGIN_RAD, relent=1.0)
    left, circling = [], []
    for posture, end in zip(some_poses(24, 0.3), some_poses(72, 0.8)[48:], strict=True):
        target, joints, last = place(end), posture, posture
        for _ in range(120):
            last, joints = joints, drawn.step(joints, [Reach(YUMI.tool_link, target)], posture)
        left.append(float(np.linalg.norm(place(joints) - target)))
        circling.append(float(np.abs(joints - last).max()))
    assert np.median(left) < 2e-3
    assert sum(one > 0.1 for one in left) <= 1
    assert max(circling) < 2e-3

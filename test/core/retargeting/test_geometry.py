# SPDX-License-Identifier: Apache-2.0
"""The compiled arm against geometry by brute force: the tool, how it moves, distances, joint order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from mild_core.retargeting.robot_model.chain import NOTHING_NEAR_M, chain_of, least_clearance
from mild_core.retargeting.robot_model.inverse_kinematics import InverseKinematics, Reach
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robots.pepper import PEPPER
from mild_core.retargeting.robots.yumi import YUMI

POSES, STEP_RAD = 5, 1e-6


def poses(robot: RobotModel) -> np.ndarray:
    return np.random.default_rng(5).uniform(robot.lower_rad, robot.upper_rad, (POSES, len(robot.joint_names)))


def in_order(robot: RobotModel, order: np.ndarray) -> RobotModel:
    """The same robot with its joints listed in another order."""
    arrays = ("lower_rad", "upper_rad", "velocity_rad_s", "acceleration_rad_s2", "jerk_rad_s3", "home_rad")
    names = tuple(robot.joint_names[place] for place in order)
    return replace(robot, joint_names=names, **{name: getattr(robot, name)[order] for name in arrays})


@pytest.mark.parametrize("robot", [YUMI, PEPPER], ids=lambda robot: robot.name)
def test_the_tool_is_where_forward_kinematics_says(robot: RobotModel) -> None:
    for pose in poses(robot):
        wanted = forward_kinematics(robot, pose, robot.tool_link)[:3, 3]
        np.testing.assert_allclose(chain_of(robot).tool(pose), wanted, atol=1e-12)


@pytest.mark.parametrize("robot", [YUMI, PEPPER], ids=lambda robot: robot.name)
def test_the_jacobian_is_how_the_tool_moves(robot: RobotModel) -> None:
    for pose in poses(robot):
        moved = pose + STEP_RAD * np.vstack([np.eye(len(pose)), -np.eye(len(pose))])
        tools = forward_kinematics(robot, moved, robot.tool_link)[:, :3, 3]
        wanted = (tools[: len(pose)] - tools[len(pose) :]).T / (2.0 * STEP_RAD)
        np.testing.assert_allclose(chain_of(robot).jacobian(pose), wanted, atol=1e-8)


def capsule(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    return np.stack([start, end, (start + end) / 2.0])


def brute_force_m(one: np.ndarray, other: np.ndarray) -> float:
    """Distance of two segments (2 or more, 3): the least over shares of both, from several starts."""

    def apart(shares: np.ndarray) -> float:
        a, b = (ends[0] + share * (ends[1] - ends[0]) for ends, share in zip((one, other), shares, strict=True))
        return float(((a - b) ** 2).sum())

    starts = [(0.1, 0.1), (0.1, 0.9), (0.9, 0.1), (0.9, 0.9)]
    return min(np.sqrt(minimize(apart, start, bounds=[(0, 1)] * 2, tol=1e-14).fun) for start in starts)


@pytest.mark.parametrize("kind", ["any", "parallel", "crossing", "point and segment", "two points", "in one line"])
def test_clearance_is_the_distance_of_the_axes_less_both_radii(kind: str) -> None:
    rng = np.random.default_rng(sorted(kind)[0].encode()[0] + len(kind))
    sizes = np.array([[0.02, 0.0], [0.03, 0.0]])
    for _ in range(5):
        a, b = rng.normal(0.0, 0.1, (2, 2, 3))
        if kind == "parallel":
            b = a + rng.normal(0.0, 0.1, 3) + 0.3 * (a[1] - a[0])
        elif kind == "crossing":
            b = b + (a.mean(axis=0) - b.mean(axis=0))
        elif kind == "point and segment":
            a[1] = a[0]
        elif kind == "two points":
            a[1], b[1] = a[0], b[0]
        elif kind == "in one line":
            b = a[0] + np.array([[1.5], [2.5]]) * (a[1] - a[0])
        for first, second in ((a, b), (b, a), (a[::-1], b)):
            placed = np.stack([capsule(*first), capsule(*second)])
            halves = np.linalg.norm(placed[:, 1] - placed[:, 0], axis=1) / 2.0
            known = np.stack([sizes[:, 0], halves], axis=1)
            found = least_clearance(placed, known, placed, known, np.array([[0.0, 1.0]]), NOTHING_NEAR_M)
            wanted = brute_force_m(first, second) - 0.05
            assert found == pytest.approx(min(wanted, NOTHING_NEAR_M), abs=1e-6)


def test_the_least_of_several_pairs_counts_and_far_ones_are_far() -> None:
    balls = np.array([[0.0, 0, 0], [0.5, 0, 0], [0.2, 0, 0], [0.9, 0, 0]])
    placed, sizes = np.repeat(balls[:, None], 3, axis=1), np.tile([0.05, 0.0], (4, 1))
    pairs = np.array([[0.0, 1.0], [0.0, 2.0], [0.0, 3.0]])
    for order in (pairs, pairs[::-1]):
        assert least_clearance(placed, sizes, placed, sizes, np.ascontiguousarray(order), 0.3) == pytest.approx(0.1)
    assert least_clearance(placed, sizes, placed, sizes, pairs[2:], 0.3) == 0.3
    assert least_clearance(placed, sizes, placed, sizes, pairs[:0], 0.3) == 0.3


def test_joints_may_be_listed_in_any_order() -> None:
    order = np.array([3, 0, 6, 1, 5, 2, 4])
    shuffled = in_order(YUMI, order)
    start = np.clip(YUMI.home_rad + 0.2, YUMI.lower_rad + 0.1, YUMI.upper_rad - 0.1)
    np.testing.assert_allclose(chain_of(shuffled).tool(start[order]), chain_of(YUMI).tool(start), atol=1e-12)
    np.testing.assert_allclose(
        chain_of(shuffled).jacobian(start[order]), chain_of(YUMI).jacobian(start)[:, order], atol=1e-12
    )
    target = chain_of(YUMI).tool(start) + np.array([0.03, -0.02, 0.04])
    both = []
    for robot, at in ((YUMI, start), (shuffled, start[order])):
        solver = InverseKinematics(robot, (robot.tool_link,))
        both.append(solver.step(at, [Reach(robot.tool_link, target)], robot.home_rad, steps=3))
    np.testing.assert_allclose(both[1], both[0][order], atol=1e-9)


def test_what_a_target_leaves_free_goes_to_the_posture_and_not_away_from_it() -> None:
    solver, posture = InverseKinematics(YUMI, (YUMI.tool_link,)), np.array(YUMI.home_rad)
    start = np.clip(posture + 0.3, YUMI.lower_rad + 0.1, YUMI.upper_rad - 0.1)
    place = chain_of(YUMI).tool(start)
    found = solver.step(start, [Reach(YUMI.tool_link, place)], posture, steps=30)
    assert np.linalg.norm(chain_of(YUMI).tool(found) - place) < 5e-3
    assert np.linalg.norm(found - posture) < 0.8 * np.linalg.norm(start - posture)


def test_of_two_links_the_weightier_one_comes_nearer() -> None:
    elbow = "yumi_link_4_r"
    solver = InverseKinematics(YUMI, (YUMI.tool_link, elbow))
    places = {
        link: forward_kinematics(YUMI, YUMI.home_rad, link)[:3, 3] + [0.0, 0.1 * sign, 0.1]
        for link, sign in ((YUMI.tool_link, 1.0), (elbow, -1.0))
    }
    missed = []
    for weight in (0.3, 3.0):
        reaches = (Reach(YUMI.tool_link, places[YUMI.tool_link], weight), Reach(elbow, places[elbow]))
        found = solver.step(YUMI.home_rad, reaches, YUMI.home_rad, steps=20)
        missed.append(np.linalg.norm(chain_of(YUMI).tool(found) - places[YUMI.tool_link]))
    assert missed[1] < 0.5 * missed[0]

# SPDX-License-Identifier: Apache-2.0
"""The arm gives way: away from whom comes too near, no faster than is allowed near people, and not without reason."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.retargeting.chain import chain_of
from mild_core.retargeting.guard import PACE, Guard
from mild_core.retargeting.limiter import JointMotion
from mild_core.retargeting.obstacles import NO_ONE, Obstacles
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.yielding import Yielding

SETTINGS = RetargetingSettings()
GUARD = Guard(YUMI, SETTINGS)
YIELDING = Yielding(YUMI, SETTINGS, GUARD)
HOME = tuple(YUMI.home_rad.tolist())
TOOL_M = chain_of(YUMI).tool(YUMI.home_rad)
AXES = {"x": 0, "y": 1, "z": 2}


def ball(away_m: np.ndarray, velocity_m_s: np.ndarray, keep_m: float = 0.05, offered: int = -1) -> Obstacles:
    """A person's ball of 5 cm, so far from the robot's hand."""
    ends, moving = np.tile(TOOL_M + away_m, (1, 2, 1)), np.tile(velocity_m_s, (1, 2, 1))
    return Obstacles(
        (1,), ("head",), ends, moving, np.array([0.05]), np.array([keep_m]), np.array([0.32]), 0.4, offered
    )


def retreat(among: Obstacles, at: tuple[float, ...] = HOME) -> np.ndarray | None:
    here = GUARD.here(JointMotion.at_rest(at), among)
    found = YIELDING.retreat(at, at, here, among)
    return None if found is None else np.array(found)


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
def test_a_head_that_comes_at_the_hand_is_given_way_to(direction: list[float]) -> None:
    away = np.array(direction)
    rates = retreat(ball(0.2 * away, -1.0 * away))
    assert rates is not None
    people = ball(0.2 * away, np.zeros(3))
    step = 1e-3
    now, then = (
        GUARD.here(JointMotion.at_rest(tuple((YUMI.home_rad + share * step * rates).tolist())), people)
        for share in (0.0, 1.0)
    )
    assert (then.clear_m[0, 0] - now.clear_m[0, 0]) / step > 0.1


@pytest.mark.parametrize("away_m", [0.15, 0.3, 1.0])
def test_a_person_who_stands_still_outside_of_the_kept_distance_moves_nothing(away_m: float) -> None:
    assert retreat(ball(np.array([away_m + 0.15, 0.0, 0.0]), np.zeros(3))) is None
    assert retreat(NO_ONE) is None


def test_a_person_who_leaves_moves_nothing_and_one_who_is_too_near_does() -> None:
    assert retreat(ball(np.array([0.25, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))) is None
    assert retreat(ball(np.array([0.05, 0.0, 0.0]), np.zeros(3))) is not None


def test_the_nearer_and_the_faster_a_person_comes_the_faster_the_arm_goes() -> None:
    speeds = []
    for away_m, speed in ((0.25, 0.5), (0.25, 0.7), (0.2, 0.7)):
        rates = retreat(ball(np.array([away_m, 0.0, 0.0]), np.array([-speed, 0.0, 0.0])))
        speeds.append(0.0 if rates is None else GUARD.arm_speed(YUMI.home_rad, rates, NO_ONE))
    assert speeds[0] < speeds[1] < speeds[2]


def test_no_point_of_the_arm_gives_way_faster_than_is_allowed_near_people() -> None:
    rates = retreat(ball(np.array([0.1, 0.0, 0.0]), np.array([-5.0, 0.0, 0.0])))
    assert rates is not None
    assert GUARD.arm_speed(YUMI.home_rad, rates, NO_ONE) <= PACE * SETTINGS.near_speed_m_s + 1e-6
    assert (np.abs(rates) <= YUMI.velocity_rad_s + 1e-9).all()


def test_a_hand_that_comes_to_be_taken_pushes_nothing() -> None:
    coming = (np.array([0.25, 0.0, 0.0]), np.array([-0.7, 0.0, 0.0]))
    assert retreat(ball(*coming)) is not None
    assert retreat(ball(*coming, offered=0)) is None
    assert retreat(ball(*coming, keep_m=-np.inf)) is None


@pytest.mark.parametrize("end", ["lower_rad", "upper_rad"])
def test_a_joint_at_its_limit_goes_no_further(end: str) -> None:
    for joint in range(len(HOME)):
        at = YUMI.home_rad.copy()
        at[joint] = getattr(YUMI, end)[joint]
        tool = chain_of(YUMI).tool(at)
        for axis in np.vstack([np.eye(3), -np.eye(3)]):
            people = Obstacles(
                *((1,), ("head",), np.tile(tool + 0.15 * axis, (1, 2, 1)), np.tile(-0.8 * axis, (1, 2, 1))),
                *(np.array([0.05]), np.array([0.05]), np.array([0.32])),
            )
            rates = retreat(people, tuple(at.tolist()))
            if rates is not None:
                assert rates[joint] >= -1e-9 if end == "lower_rad" else rates[joint] <= 1e-9

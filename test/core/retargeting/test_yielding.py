# SPDX-License-Identifier: Apache-2.0
"""The arm gives way: away from whom comes too near, no faster than is allowed near people, and not without reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mild_core.retargeting.evasion import (
    AHEAD_S,
    BETTER,
    BETTER_VARIED,
    COLLIDES,
    KINDS,
    LOOKED_AT,
    LOOKS,
    PER_S_M2,
    REACTS_S,
    SLIGHT_M2_S,
    Evasion,
    Refuge,
)
from mild_core.retargeting.guard import PACE, Guard
from mild_core.retargeting.limiter import JointMotion
from mild_core.retargeting.obstacles import NO_ONE, Obstacles
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robots.pepper import PEPPER
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.yielding import Yielding

SETTINGS = RetargetingSettings()
GUARD = Guard(YUMI, SETTINGS)
YIELDING = Yielding(YUMI, SETTINGS, GUARD)
EVASION = YIELDING.evasion
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
    found, _ = YIELDING.retreat(at, at, at, here, among, None, meets_watched=True)
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
    for away_m, speed in ((0.14, 0.05), (0.14, 0.12), (0.12, 0.12)):
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
        tool, speed = chain_of(YUMI).tool(at), 0.8 if joint == 0 else 0.12  # who walks is looked ahead for
        for axis in np.vstack([np.eye(3), -np.eye(3)]):
            people = Obstacles(
                *((1,), ("head",), np.tile(tool + 0.15 * axis, (1, 2, 1)), np.tile(-speed * axis, (1, 2, 1))),
                *(np.array([0.05]), np.array([0.05]), np.array([0.32])),
            )
            rates = retreat(people, tuple(at.tolist()))
            if rates is not None:
                assert rates[joint] >= -1e-9 if end == "lower_rad" else rates[joint] <= 1e-9


def passing(people: int = 1, part: str = "trunk", far_m: float = 0.5, speed_m_s: float = 0.8) -> Obstacles:
    """Someone who walks along the robot's front through where its hand is, and their trunk."""
    way = np.array([0.0, 1.0, 0.0])
    start = TOOL_M + np.array([0.05, 0.0, 0.0]) - far_m * way
    ends, speed = np.tile(start, (1, 2, 1)), np.tile(speed_m_s * way, (1, 2, 1))
    return Obstacles((people,), (part,), ends, speed, np.array([0.1]), np.array([0.05]), np.array([0.32]))


def made_way(among: Obstacles, meets_watched: bool) -> bool:
    here = GUARD.here(JointMotion.at_rest(HOME), among)
    return YIELDING.retreat(HOME, HOME, HOME, here, among, None, meets_watched)[0] is not None


def test_way_is_made_in_time_for_everyone_but_for_who_is_to_be_met() -> None:
    far, near = (passing(person, far_m=far_m) for person, far_m in ((1, 1.0), (1, 0.6)))
    assert made_way(far, False)
    assert made_way(near, True)
    assert not made_way(passing(far_m=1.0, speed_m_s=0.4), False)
    watched_far, watched_near = passing(0, far_m=1.0), passing(0, far_m=0.6)
    assert not made_way(watched_far, False)
    assert made_way(watched_near, False)
    assert not made_way(watched_near, True)
    # Closer by, way is made for them too: no more than it takes.
    close = passing(0, far_m=0.35)
    here = GUARD.here(JointMotion.at_rest(HOME), close)
    met, flees = (YIELDING.retreat(HOME, HOME, HOME, here, close, None, meets_watched=meets) for meets in (True, False))
    assert met[0] is not None
    assert met[1] is None
    assert flees[1] is not None


def test_the_way_is_made_for_where_a_bystander_is_going_and_not_for_a_swinging_arm() -> None:
    walker, still = passing(), passing(speed_m_s=0.0)
    arm = passing(part="left_forearm")
    both = [np.concatenate([getattr(each, name) for each in (still, arm)]) for name in FIELDS]
    standing = Obstacles((1, 1), ("trunk", "left_forearm"), *both)
    assert EVASION.walking(standing) is None
    assert EVASION.walking(still) is None
    assert EVASION.walking(passing(speed_m_s=0.1)) is None, "who shifts about walks nowhere"
    shifting = [np.concatenate([getattr(each, name) for each in (walker, passing(speed_m_s=0.1))]) for name in FIELDS]
    among = EVASION.walking(Obstacles((1, 2), ("trunk", "trunk"), *shifting))
    assert among is not None
    assert among.velocities_m_s.any(axis=(1, 2)).tolist() == [True, False], "nor beside who does"
    here = GUARD.here(JointMotion.at_rest(HOME), walker)
    rates, refuge = YIELDING.retreat(HOME, HOME, HOME, here, walker, None, meets_watched=False)
    assert rates is not None
    assert refuge is not None
    way = np.array(refuge.posture_rad) - YUMI.home_rad
    assert np.array(rates) @ way > 0.9 * np.linalg.norm(rates) * np.linalg.norm(way)
    walking = EVASION.walking(walker)
    assert walking is not None
    goal = tuple((YUMI.home_rad + np.array([0.0, 0.3, 0.5, 0.0, 0.0, 0.0, 0.0])).tolist())
    assert EVASION.threatens(YUMI.home_rad, np.array(goal), walking, False)


FIELDS = ("ends_m", "velocities_m_s", "radii_m", "keep_m", "zones_m")


@pytest.mark.parametrize("robot", [YUMI, PEPPER], ids=lambda robot: robot.name)
def test_the_refuge_is_out_of_the_way_of_who_walks_through_the_stretched_arm(robot: RobotModel) -> None:
    evasion = EVASION if robot is YUMI else Evasion(robot, SETTINGS, Guard(robot, SETTINGS))
    guard, rng, better = evasion.guard, np.random.default_rng(3), 0
    assert guard.own_clearance_m(evasion.postures_rad).min() > 0.0
    for _ in range(5):
        at = robot.home_rad + 0.4 * rng.normal(size=len(robot.home_rad))
        at = np.clip(at, robot.lower_rad + 0.01, robot.upper_rad - 0.01)
        if guard.own_clearance_m(at[None])[0] < 0.0:
            continue
        hand = chain_of(robot).tool(at)
        ends, way = np.array([[hand - 0.6 * AHEAD, hand - 0.6 * AHEAD]]), np.tile(0.7 * AHEAD, (1, 2, 1))
        coming = Obstacles((1,), ("trunk",), ends, way, np.array([0.12]), np.array([0.05]), np.array([0.32]))
        walking = evasion.walking(coming)
        assert walking is not None
        refuge = evasion.refuge(at, walking, None)
        stays, goes = (evasion.in_the_way(at, to, walking) for to in (at, np.array(refuge.posture_rad)))
        assert goes <= stays
        assert goes < COLLIDES
        table = min(evasion.in_the_way(at, to, walking) for to in evasion.postures_rad)
        assert BETTER * goes <= table + SLIGHT_M2_S + PER_S_M2 * AHEAD_S
        better += goes < 0.2 * stays
        kept = evasion.refuge(at, walking, refuge)
        assert kept.turn == refuge.turn + LOOKED_AT
        assert evasion.in_the_way(at, np.array(kept.posture_rad), walking) <= goes
        if kept.posture_rad != refuge.posture_rad:
            least = BETTER_VARIED * cost_of(evasion, at, refuge, walking) - SLIGHT_M2_S
            assert cost_of(evasion, at, kept, walking) < least, "it changes for what is clearly better alone"
        lasts_s = evasion.duration_s(at, np.array(refuge.posture_rad))
        rate = (np.array(refuge.posture_rad) - at) / lasts_s
        assert (np.abs(rate) <= robot.velocity_rad_s + 1e-9).all()
        assert guard.arm_speed(at, rate, NO_ONE) < 1.5 * SETTINGS.near_speed_m_s
    assert better >= 2


AHEAD = np.array([0.0, 1.0, 0.0])


def cost_of(evasion: Evasion, at: np.ndarray, refuge: Refuge, walking: Obstacles) -> float:
    """How much a refuge is in the way, with its time."""
    to = np.array(refuge.posture_rad)
    return evasion.in_the_way(at, to, walking) + PER_S_M2 * evasion.duration_s(at, to)


def test_of_refuges_that_are_out_of_the_way_the_arm_goes_to_a_near_one() -> None:
    walking = EVASION.walking(walks_past(chain_of(YUMI).tool(REACHED_OUT), 0.75, 0.5, 0.1))
    assert walking is not None
    found = EVASION.refuge(REACHED_OUT, walking, None)
    for _ in range(20):
        found = EVASION.refuge(REACHED_OUT, walking, found)
    to = np.array(found.posture_rad)
    free = [to for to in EVASION.postures_rad if EVASION.in_the_way(REACHED_OUT, to, walking) == 0.0]
    assert EVASION.in_the_way(REACHED_OUT, to, walking) < 1e-5
    assert free
    nearest_s = min(EVASION.duration_s(REACHED_OUT, each) for each in free)
    assert EVASION.duration_s(REACHED_OUT, to) < 0.9 * nearest_s


def test_a_way_through_the_robot_itself_is_no_way() -> None:
    rng, through = np.random.default_rng(5), 0
    walking = EVASION.walking(passing())
    assert walking is not None
    for to in rng.uniform(YUMI.lower_rad, YUMI.upper_rad, (30, len(HOME))):
        way = YUMI.home_rad + np.linspace(0.0, 1.0, 9)[:, None] * (to - YUMI.home_rad)
        if EVASION.duration_s(YUMI.home_rad, to) < 1.3 and GUARD.own_clearance_m(to[None])[0] < 0.0:
            through += 1
            assert EVASION.in_the_way(YUMI.home_rad, to, walking) >= COLLIDES
        elif GUARD.own_clearance_m(way).min() > 0.01:
            assert EVASION.in_the_way(YUMI.home_rad, to, walking) < COLLIDES
    assert through >= 1


REACHED_OUT = YUMI.home_rad + np.array([-0.3, 0.6, 0.9, -1.2, 0.0, 0.4, 0.0])
"""A posture with the hand high, half a metre before the robot and far to the right."""


def walks_past(hand_m: np.ndarray, from_m: float, speed_m_s: float, radius_m: float = 0.15) -> Obstacles:
    """A trunk that walks along the robot's front to where a hand is, from so far beside it."""
    start, way = hand_m - from_m * AHEAD, np.tile(speed_m_s * AHEAD, (1, 2, 1))
    ends = np.array([[start - 0.2 * UP, start + 0.2 * UP]])
    return Obstacles((1,), ("trunk",), ends, way, np.array([radius_m]), np.array([0.05]), np.array([0.35]))


UP = np.array([0.0, 0.0, 1.0])


def test_way_is_made_where_the_arm_is_going_before_it_is_there() -> None:
    goal = REACHED_OUT
    hand = chain_of(YUMI).tool(goal)
    assert hand[0] - TOOL_M[0] > 0.25
    walking = EVASION.walking(walks_past(hand, 0.8, 0.5, 0.1))
    assert walking is not None
    assert not EVASION.threatens(YUMI.home_rad, YUMI.home_rad, walking, False)
    assert EVASION.threatens(YUMI.home_rad, goal, walking, False)
    soon = EVASION.walking(walks_past(hand, 0.5, 1.0, 0.1))
    assert soon is not None
    assert not EVASION.threatens(YUMI.home_rad, YUMI.home_rad, soon, False)
    assert EVASION.threatens(goal, goal, soon, False), "and where it is"


def test_an_arm_needs_time_to_set_off() -> None:
    look_s = AHEAD_S / LOOKS
    assert 0.5 * look_s < REACTS_S
    hand, away = chain_of(YUMI).tool(REACHED_OUT), chain_of(YUMI).tool(YUMI.home_rad)
    assert np.linalg.norm(hand - away) > 0.2
    at_once = walks_past(hand, 10.0 * look_s, 10.0, 0.05)
    walking = EVASION.walking(at_once)
    assert walking is not None
    stays, goes = (EVASION.in_the_way(REACHED_OUT, to, walking) for to in (REACHED_OUT, YUMI.home_rad))
    assert goes > 0.6 * stays > 0.0


@pytest.mark.parametrize("speed_m_s", [0.0, 1.0])
def test_on_a_way_towards_who_comes_fast_the_arm_waits(speed_m_s: float) -> None:
    comes = walks_past(chain_of(YUMI).tool(REACHED_OUT), 0.45, speed_m_s, 0.1)
    for_no_one, longer = replace(comes, zones_m=np.array([-1.0])), 0
    for to in EVASION.postures_rad:
        waiting, going = (EVASION.in_the_way(REACHED_OUT, to, each) for each in (comes, for_no_one))
        longer += waiting > 1.2 * going + 1e-5
        assert speed_m_s or waiting == going
    assert (longer > 2) is (speed_m_s > 0.0)


def test_from_who_walks_fast_a_stretched_arm_is_drawn_straight_back() -> None:
    hand, better = chain_of(YUMI).tool(REACHED_OUT) - np.array([0.1, 0.0, 0.0]), []
    for speed_m_s in (0.8, 1.0):
        walking = EVASION.walking(walks_past(hand, 0.8, speed_m_s))
        assert walking is not None
        refuge = EVASION.refuge(REACHED_OUT, walking, None)
        assert refuge.turn == KINDS * len(EVASION.postures_rad)
        goes = EVASION.in_the_way(REACHED_OUT, np.array(refuge.posture_rad), walking)
        better.append(goes / min(EVASION.in_the_way(REACHED_OUT, to, walking) for to in EVASION.postures_rad))
    assert max(better) < 0.15


def test_nothing_that_gives_way_comes_faster_towards_a_person_than_the_guard_allows() -> None:
    comes = walks_past(TOOL_M, 0.6, 0.6)
    rates = retreat(comes)
    assert rates is not None
    rows, clear, coming, _ = GUARD.rows_away(YUMI.home_rad, comes, 0.5)
    near = (clear < 0.35) & (np.linalg.norm(rows, axis=1) > 0.1)
    assert near.any()
    allowed = np.maximum(PACE * SETTINGS.near_speed_m_s - coming[near], 0.0)
    assert (rows[near] @ rates + allowed).min() > -0.01

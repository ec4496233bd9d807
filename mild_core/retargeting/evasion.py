# SPDX-License-Identifier: Apache-2.0
"""Where the arm is out of the way of people who walk: postures of refuge, and how much each is in their way.

Giving way at the last moment and straight away from a person ends where a joint does, or between two people. So
people who walk are looked ahead for, and of a few postures the arm goes to the one that is least in their way.

Source: rollouts of a few candidate motions against predicted obstacles, as in D. Fox et al., "The dynamic window
approach to collision avoidance", IEEE RAM 1997.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mild_core.compiled import compiled
from mild_core.retargeting.guard import APART_M, PACE, Guard
from mild_core.retargeting.limiter import Joints
from mild_core.retargeting.obstacles import NO_ONE, Obstacles
from mild_core.retargeting.robot_model.chain import frames_of, least_clearance, nearest_points, place_capsules
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import WATCHED_PERSON

AHEAD_S, LOOKS = 1.6, 12
"""People are expected to walk on for so long: a stretched arm needs as long to come home as slowly as near people."""

WATCHED_AHEAD_S = 0.8
"""The watched person is for so long: who comes to the robot stops before it."""

WALKS_M_S = 0.15
"""Who moves faster than this goes somewhere."""

REACTS_S = 0.15
"""Time in which the arm comes up to speed."""

PIECES = 4
"""A way is measured as so many straight ones."""

ROOM_M = 0.05
"""A place counts as in the way while it is nearer than this beyond the distance that is kept."""

LOOKED_AT = 2
"""Other postures that are looked at in every command."""

BETTER = 0.8
"""A new refuge is taken where it is in the way by less than this share of what the one before is."""

SLIGHT_M2_S, PER_S_M2 = 1e-4, 2e-4
"""And by more than the first; a way that takes a second is worth the second: 3 cm too near for a second."""

REFUGES, TRIED, SHARE, SEED = 10, 1000, 0.2, 11
"""Postures that are kept, of so many random ones, of which the share counts that is the most compact."""

STEPS_RAD = (0.3, -0.3, 0.1, -0.1)
"""How a refuge is varied, one joint at a time."""

COLLIDES = 1e3
"""Worse than any person: the way there leads through the robot itself."""

OWN_BODY = ("head", "trunk")
"""These parts are expected where they go themselves; the others, which swing, where the trunk goes."""


Segments = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Of S segments: ends and their velocities (S, 2, 3), radii (S,), distances that are kept (S,)."""


class Refuge(NamedTuple):
    """Where the arm is out of the way.

    Attributes:
        posture_rad: J joints.
        turn: Which other posture is looked at next.
    """

    posture_rad: Joints
    turn: int


@dataclass(frozen=True, eq=False)
class Evasion:
    """What is looked ahead for, for one robot.

    Attributes:
        robot: Whose arm.
        settings: What is kept, and how fast it may be near people.
        guard: Which knows its shape.
        postures_rad: (R, J) refuges, the first at home.
    """

    robot: RobotModel
    settings: RetargetingSettings
    guard: Guard
    postures_rad: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "postures_rad", read_only(_spread_postures(self.robot, self.settings, self.guard)))

    def walking(self, among: Obstacles) -> Obstacles | None:
        """Everyone as they are expected to walk on; None where no one walks."""
        if not len(among.people) or float(among.speeds_m_s.max()) < WALKS_M_S:
            return None
        means = 0.5 * (among.velocities_m_s[:, 0] + among.velocities_m_s[:, 1])
        bodies = {
            person: means[place]
            for place, (person, part) in enumerate(zip(among.people, among.parts, strict=True))
            if part == "trunk"
        }
        pairs = enumerate(zip(among.people, among.parts, strict=True))
        goes = np.array([means[at] if part in OWN_BODY else bodies.get(who, means[at]) for at, (who, part) in pairs])
        goes[np.linalg.norm(goes, axis=1) < WALKS_M_S] = 0.0
        if not goes.any():
            return None
        keep = among.keep_m.copy()
        if among.offered >= 0:
            keep[among.offered] = -math.inf  # a hand that comes to be taken is no one's way
        return replace(among, velocities_m_s=np.repeat(goes[:, None], 2, axis=1), keep_m=keep, horizon_s=AHEAD_S)

    def threatens(
        self, position_rad: FloatArray, goal_rad: FloatArray, walking: Obstacles, meets_watched: bool
    ) -> bool:
        """Whether someone walks where the arm is, or where it is on its way to.

        The watched person is looked ahead for less far, as they come to stand before it, and not at all while it is on
        its way to meet them.

        Args:
            position_rad: (J,) where the joints are.
            goal_rad: (J,) where they are on their way to.
            walking: Of `walking`.
            meets_watched: Whether the arm is on its way to meet the watched person.
        """
        goes = walking.velocities_m_s.any(axis=(1, 2))
        watched = np.array(walking.people) == WATCHED_PERSON
        for who, ahead_s in ((goes & ~watched, AHEAD_S), (goes & watched, WATCHED_AHEAD_S)):
            if not who.any() or (meets_watched and ahead_s == WATCHED_AHEAD_S):
                continue
            segments = (walking.ends_m[who], walking.velocities_m_s[who], walking.radii_m[who], walking.keep_m[who])
            if any(self._rollout(position_rad, to, segments, ahead_s)[0] > 0.0 for to in (position_rad, goal_rad)):
                return True
        return False

    def refuge(self, position_rad: FloatArray, walking: Obstacles, before: Refuge | None) -> Refuge:
        """Where to go; the one before while it is about as good as any.

        Of the postures all are looked at first, then a few with every command, and what the best one varies into.

        Args:
            position_rad: (J,) where the joints are.
            walking: Of `walking`.
            before: The last choice.
        """
        turn, tried = 0, [*self.postures_rad, position_rad]
        found, least = self.postures_rad[0], math.inf
        if before is not None:
            found = np.array(before.posture_rad)
            least = BETTER * self._cost(position_rad, found, walking) - SLIGHT_M2_S
            turn = before.turn + LOOKED_AT
            tried = [self._candidate(number, found) for number in range(before.turn, turn)] if least > 0.0 else []
        for posture in tried:
            cost = self._cost(position_rad, posture, walking)
            if cost < least:
                found, least = posture, cost
        return Refuge(tuple(found.tolist()), turn)

    def _cost(self, from_rad: FloatArray, to_rad: FloatArray, walking: Obstacles) -> float:
        """What a refuge costs: the nearer ones are preferred a little [m^2 s]."""
        in_the_way, lasts_s = self._rollout(from_rad, to_rad, _segments(walking), AHEAD_S)
        return in_the_way + PER_S_M2 * lasts_s

    def _candidate(self, number: int, best: FloatArray) -> FloatArray:
        """(J,) a posture to look at: of the refuges, or a variation of the best one."""
        refuges, joints = len(self.postures_rad), len(best)
        number %= refuges + len(STEPS_RAD) * joints
        if number < refuges:
            chosen: FloatArray = self.postures_rad[number]
            return chosen
        step, joint = divmod(number - refuges, joints)
        varied = best.copy()
        varied[joint] += STEPS_RAD[step]
        margin = self.settings.position_margin_rad
        inside: FloatArray = np.clip(varied, self.robot.lower_rad + margin, self.robot.upper_rad - margin)
        return inside

    def in_the_way(self, from_rad: FloatArray, to_rad: FloatArray, walking: Obstacles) -> float:
        """How much the arm is in people's way while it goes from a posture to another and stays there [m^2 s].

        Squares of how much nearer people are than they should be, over time.
        """
        return self._rollout(from_rad, to_rad, _segments(walking), AHEAD_S)[0]

    def duration_s(self, from_rad: FloatArray, to_rad: FloatArray) -> float:
        """How long a straight way in joint space takes inside the speeds that are allowed near people [s]."""
        return self._rollout(from_rad, to_rad, _segments(NO_ONE), AHEAD_S)[1]

    def _rollout(
        self, from_rad: FloatArray, to_rad: FloatArray, segments: Segments, ahead_s: float
    ) -> tuple[float, float]:
        chain, capsules = self.guard.chain, self.guard.capsules
        in_the_way, lasts_s = rollout(
            *(from_rad, to_rad, chain.columns, chain.offsets, chain.axes),
            *(capsules.mounted, capsules.ends_m, capsules.sizes_m, capsules.outer_m, capsules.pairs, capsules.moving),
            *segments,
            *(self.robot.velocity_rad_s, PACE * self.settings.near_speed_m_s, ahead_s),
        )
        return float(in_the_way), float(lasts_s)


def _segments(among: Obstacles) -> Segments:
    return among.ends_m, among.velocities_m_s, among.radii_m, among.keep_m


@compiled
def rollout(
    from_rad: FloatArray,
    to_rad: FloatArray,
    columns: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    mounted: FloatArray,
    ends_m: FloatArray,
    sizes_m: FloatArray,
    outer_m: FloatArray,
    pairs: FloatArray,
    moving: FloatArray,
    people_m: FloatArray,
    people_m_s: FloatArray,
    radii_m: FloatArray,
    keep_m: FloatArray,
    velocity_rad_s: FloatArray,
    speed_m_s: float,
    ahead_s: float,
) -> tuple[float, float]:
    """What a straight way in joint space, and staying where it ends, is like among S segments that move on.

    Args:
        from_rad: (J,) where it begins ...
        to_rad: (J,) ... and ends.
        columns: Of `Chain`.
        offsets: Of `Chain`.
        axes: Of `Chain`.
        mounted: Of `Capsules`.
        ends_m: Of `Capsules`.
        sizes_m: Of `Capsules`.
        outer_m: Of `Capsules`.
        pairs: Of `Capsules`.
        moving: (M,) places of those that are kept away from people.
        people_m: (S, 2, 3) ends of the segments' axes ...
        people_m_s: (S, 2, 3) ... and how they move ...
        radii_m: (S,) ... and their radii.
        keep_m: (S,) what is kept from each.
        velocity_rad_s: (J,) largest speeds of the joints.
        speed_m_s: Largest speed of the ends of the moving capsules.
        ahead_s: How far to look ahead.

    Returns:
        The integral of the square of how much nearer than `ROOM_M` beyond the kept distance the worst segment is, with
            `COLLIDES` added where the robot meets itself [m^2 s];
        how long the way takes [s].
    """
    way, at = to_rad - from_rad, np.empty(len(from_rad))
    placed, before = np.empty((len(mounted), 3, 3)), np.empty((len(mounted), 3, 3))
    lasts_s = 1e-3
    for joint in range(len(way)):
        lasts_s = max(lasts_s, abs(way[joint]) / velocity_rad_s[joint])
    for piece in range(PIECES + 1):
        place_capsules(frames_of(from_rad + piece / PIECES * way, columns, offsets, axes), mounted, ends_m, placed)
        for number in range(len(moving) if piece else 0):
            part = int(moving[number])
            for end in range(2):
                x = placed[part, end, 0] - before[part, end, 0]
                y = placed[part, end, 1] - before[part, end, 1]
                z = placed[part, end, 2] - before[part, end, 2]
                lasts_s = max(lasts_s, PIECES * np.sqrt(x * x + y * y + z * z) / speed_m_s)
        before[:] = placed
    cost, moved, each_s = 0.0, -1.0, ahead_s / LOOKS
    start, end_m = np.empty(3), np.empty(3)
    for look in range(1, LOOKS + 1 if len(radii_m) else 1):
        time_s = look * each_s
        share = min(max((time_s - REACTS_S) / lasts_s, 0.0), 1.0)
        if share != moved:
            at[:] = from_rad + share * way
            place_capsules(frames_of(at, columns, offsets, axes), mounted, ends_m, placed)
            if share > 0.0 and least_clearance(placed, sizes_m, placed, sizes_m, pairs, APART_M) < APART_M:
                return COLLIDES, lasts_s
            moved = share
        deepest = 0.0
        for other in range(len(radii_m)):
            half = 0.0
            for i in range(3):
                start[i] = people_m[other, 0, i] + time_s * people_m_s[other, 0, i]
                end_m[i] = people_m[other, 1, i] + time_s * people_m_s[other, 1, i]
                half += (0.5 * (end_m[i] - start[i])) ** 2
            half = np.sqrt(half)
            for number in range(len(moving)):
                part = int(moving[number])
                room = outer_m[part] + radii_m[other] + keep_m[other] + ROOM_M - deepest
                x = placed[part, 2, 0] - 0.5 * (start[0] + end_m[0])
                y = placed[part, 2, 1] - 0.5 * (start[1] + end_m[1])
                z = placed[part, 2, 2] - 0.5 * (start[2] + end_m[2])
                reach = room + sizes_m[part, 1] + half
                if reach > 0.0 and x * x + y * y + z * z < reach * reach:
                    apart = nearest_points(placed[part, 0], placed[part, 1], start, end_m)[0]
                    deepest = max(deepest, deepest + room - apart)
        cost += deepest * deepest * each_s
    return cost, lasts_s


def _spread_postures(robot: RobotModel, settings: RetargetingSettings, guard: Guard) -> FloatArray:
    """(R, J) home and compact postures whose hands are far from each other's, in none of which the robot meets itself.

    Compact is an arm that stays near its base.
    """
    lower, upper = robot.lower_rad + settings.position_margin_rad, robot.upper_rad - settings.position_margin_rad
    home, chain = np.clip(robot.home_rad, lower, upper), guard.chain
    tried = np.random.default_rng(SEED).uniform(lower, upper, (TRIED, len(lower)))
    joints = np.array([frames_of(each, chain.columns, chain.offsets, chain.axes)[:, :2, 3] for each in tried])
    hands = np.array([chain.tool(each) for each in tried])
    wide = np.maximum(np.linalg.norm(joints, axis=2).max(axis=1), np.linalg.norm(hands[:, :2], axis=1))
    compact = np.argsort(wide)[: round(SHARE * TRIED)]
    compact = compact[guard.own_clearance_m(tried[compact]) > 0.0]
    found = [home]
    apart = np.linalg.norm(hands[compact] - chain.tool(home), axis=1)
    while len(found) < REFUGES and len(apart):
        farthest = compact[int(apart.argmax())]
        found.append(tried[farthest])
        apart = np.minimum(apart, np.linalg.norm(hands[compact] - hands[farthest], axis=1))
    return np.array(found)

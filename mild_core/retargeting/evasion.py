# SPDX-License-Identifier: Apache-2.0
"""Where the arm is out of the way of people who walk: postures of refuge, and how much each is in their way.

Giving way at the last moment and straight away from a person ends where a joint does, or between two people. So
people who walk are looked ahead for, and of a few postures the arm goes to the one that is least in their way. Those
who walk fast leave the time for a short way only: so postures count that are drawn straight back from where the arm is,
and ways on which it would have to wait, as the guard lets it go no faster towards people who come, do not.

Source: rollouts of a few candidate motions against predicted obstacles, as in D. Fox et al., "The dynamic window
approach to collision avoidance", IEEE RAM 1997.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mild_core.compiled import compiled
from mild_core.retargeting.clearance import LEAST_M_S
from mild_core.retargeting.guard import APART_M, PACE, Guard
from mild_core.retargeting.limiter import Joints
from mild_core.retargeting.obstacles import NO_ONE, Obstacles
from mild_core.retargeting.robot_model.chain import frames_of, least_clearance, nearest_points, place_capsules
from mild_core.retargeting.robot_model.inverse_kinematics import InverseKinematics, Reach
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import WATCHED_PERSON

AHEAD_S, LOOKS = 1.6, 8
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

LOOKED_AT, KINDS = 10, 4
"""Other postures that are looked at in every command. Of so many that follow each other one is a refuge, one is drawn
back from where the arm is, and the others are variations of the best one."""

DRAWN, ASIDE_M, STEPS = (0.3, 0.7), 0.12, 4
"""A hand is drawn back to such a share of its way from the shoulder, give or take this standard deviation, in so many
steps of inverse kinematics."""

VARIED_RAD, SIZES = (0.8, 0.1), 5
"""A posture is varied in half of its joints by such standard deviations, of so many different ones."""

DRAWS = 199
"""Random draws of either kind, one after the other: a prime number, for every kind to come by all of them."""

BETTER, BETTER_VARIED = 0.8, 0.95
"""A new refuge is taken where it is in the way by less than the first share of what the one before is, a variation of
that, which changes the way little, by the second."""

SLIGHT_M2_S, PER_S_M2 = 1e-4, 2e-4
"""And by more than the first; a way that takes a second is worth the second: 3 cm too near for a second."""

REFUGES, TRIED, SHARE, SEED = 12, 1000, 0.2, 11
"""Postures that are kept, of so many random ones, of which the share counts that is the most compact."""

COLLIDES = 1e3
"""Worse than any person: the way there leads through the robot itself."""

OWN_BODY = ("head", "trunk")
"""These parts are expected where they go themselves; the others, which swing, where the trunk goes."""


EVERYONE = slice(None)

Segments = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Of S segments: ends and their velocities (S, 2, 3), radii, distances that are kept, zones of limited speed (S,)."""


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
        varied_rad: (DRAWS, J) what is added to a posture to vary it.
        drawn: (DRAWS, 4) where a hand is drawn back to: how far aside [m], and the share of its way from the shoulder.
    """

    robot: RobotModel
    settings: RetargetingSettings
    guard: Guard
    postures_rad: FloatArray = field(init=False, repr=False)
    varied_rad: FloatArray = field(init=False, repr=False)
    drawn: FloatArray = field(init=False, repr=False)
    _solver: InverseKinematics = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "postures_rad", read_only(_spread_postures(self.robot, self.settings, self.guard)))

        rng, shape = np.random.default_rng(SEED), (DRAWS, len(self.robot.home_rad))
        sizes_rad = np.geomspace(*VARIED_RAD, SIZES)[np.arange(DRAWS) % SIZES, None]
        varied = np.where(rng.random(shape) < 0.5, rng.normal(size=shape), 0.0)
        object.__setattr__(self, "varied_rad", read_only(sizes_rad * varied))
        drawn = np.hstack([rng.normal(0.0, ASIDE_M, (DRAWS, 3)), rng.uniform(*DRAWN, (DRAWS, 1))])
        object.__setattr__(self, "drawn", read_only(drawn))
        solver = InverseKinematics(self.robot, (self.robot.tool_link,), self.settings.position_margin_rad)
        object.__setattr__(self, "_solver", solver)

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
            segments = _segments(walking, who)
            if any(self._rollout(position_rad, to, segments, ahead_s, 0.0)[0] > 0.0 for to in (position_rad, goal_rad)):
                return True
        return False

    def refuge(self, position_rad: FloatArray, walking: Obstacles, before: Refuge | None) -> Refuge:
        """Where to go; the one before while it is about as good as any.

        Many postures are looked at first, all refuges among them, and a few more with every command.

        Args:
            position_rad: (J,) where the joints are.
            walking: Of `walking`.
            before: The last choice.
        """
        if before is None:
            found, turn, looks = position_rad, 0, KINDS * len(self.postures_rad)
        else:
            found, turn, looks = np.array(before.posture_rad), before.turn, LOOKED_AT
        least = self._cost(position_rad, found, walking)
        for number in range(turn, turn + looks):
            posture, better = self._candidate(number, position_rad, found)
            most = better * least - SLIGHT_M2_S
            if most > 0.0 and (cost := self._cost(position_rad, posture, walking, most)) < most:
                found, least = posture, cost
        return Refuge(tuple(found.tolist()), turn + looks)

    def _cost(self, from_rad: FloatArray, to_rad: FloatArray, walking: Obstacles, most: float = math.inf) -> float:
        """What a refuge costs, the nearer ones preferred a little, or more than the most of interest [m^2 s]."""
        in_the_way, lasts_s = self._rollout(from_rad, to_rad, _segments(walking), AHEAD_S, most)
        return in_the_way + PER_S_M2 * lasts_s

    def _candidate(self, number: int, at_rad: FloatArray, best_rad: FloatArray) -> tuple[FloatArray, float]:
        """(J,) a posture to look at, and how much better it must be.

        One of the refuges, or the nearest one with the hand drawn back, or a variation of the best one.
        """
        place, kind = divmod(number, KINDS)
        if kind == 0:
            refuge: FloatArray = self.postures_rad[place % len(self.postures_rad)]
            return refuge, BETTER
        if kind == 1:
            *aside_m, share = self.drawn[number % DRAWS].tolist()
            shoulder_m, hand_m = self.guard.chain.offsets[0][:3, 3], self.guard.chain.tool(at_rad)
            back = Reach(self.robot.tool_link, shoulder_m + share * (hand_m - shoulder_m) + aside_m)
            return self._solver.step(at_rad, [back], at_rad, STEPS), BETTER
        margin = self.settings.position_margin_rad
        varied: FloatArray = np.clip(
            best_rad + self.varied_rad[number % DRAWS], self.robot.lower_rad + margin, self.robot.upper_rad - margin
        )
        return varied, BETTER_VARIED

    def in_the_way(self, from_rad: FloatArray, to_rad: FloatArray, walking: Obstacles) -> float:
        """How much the arm is in people's way while it goes from a posture to another and stays there [m^2 s].

        Squares of how much nearer people are than they should be, over time.
        """
        return self._rollout(from_rad, to_rad, _segments(walking), AHEAD_S)[0]

    def duration_s(self, from_rad: FloatArray, to_rad: FloatArray) -> float:
        """How long a straight way in joint space takes inside the speeds that are allowed near people [s]."""
        return self._rollout(from_rad, to_rad, _segments(NO_ONE), AHEAD_S)[1]

    def _rollout(
        self, from_rad: FloatArray, to_rad: FloatArray, segments: Segments, ahead_s: float, most: float = math.inf
    ) -> tuple[float, float]:
        chain, capsules = self.guard.chain, self.guard.capsules
        in_the_way, lasts_s = rollout(
            *(from_rad, to_rad, chain.columns, chain.offsets, chain.axes),
            *(capsules.mounted, capsules.ends_m, capsules.sizes_m, capsules.outer_m, capsules.pairs, capsules.moving),
            *segments,
            *(self.robot.velocity_rad_s, PACE * self.settings.near_speed_m_s, ahead_s, most),
        )
        return float(in_the_way), float(lasts_s)


def _segments(among: Obstacles, which: NDArray[np.bool_] | slice = EVERYONE) -> Segments:
    ends_m, velocities_m_s = among.ends_m[which], among.velocities_m_s[which]
    return ends_m, velocities_m_s, among.radii_m[which], among.keep_m[which], among.zones_m[which]


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
    zones_m: FloatArray,
    velocity_rad_s: FloatArray,
    speed_m_s: float,
    ahead_s: float,
    most: float,
) -> tuple[float, float]:
    """What a straight way in joint space, and staying where it ends, is like among S segments that move on.

    The arm goes along it no faster than the guard lets it towards who comes near: from who comes fast it may wait.

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
        zones_m: (S,) nearer than this, speed towards each is limited.
        velocity_rad_s: (J,) largest speeds of the joints.
        speed_m_s: Largest speed of the ends of the moving capsules, and towards segments less their own approach.
        ahead_s: How far to look ahead.
        most: As soon as the integral is more than this, it is not looked at any further.

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
    cost, went, each_s = 0.0, 0.0, ahead_s / LOOKS
    now = np.empty((len(radii_m), 2, 3))
    place_capsules(frames_of(from_rad, columns, offsets, axes), mounted, ends_m, placed)
    for look in range(1, LOOKS + 1 if len(radii_m) else 1):
        time_s = look * each_s
        for other in range(len(radii_m)):
            for end in range(2):
                for i in range(3):
                    now[other, end, i] = people_m[other, end, i] + time_s * people_m_s[other, end, i]
        goes = min(min(max(time_s - REACTS_S, 0.0), each_s) / lasts_s, 1.0 - went)
        if goes > 0.0:
            before[:] = placed
            at[:] = from_rad + (went + goes) * way
            place_capsules(frames_of(at, columns, offsets, axes), mounted, ends_m, placed)
            still = (before, placed, sizes_m, outer_m, moving)
            free = _freedom(*still, now, people_m_s, radii_m, zones_m, speed_m_s, each_s)
            if free < 1.0:
                goes *= free
                at[:] = from_rad + (went + goes) * way
                place_capsules(frames_of(at, columns, offsets, axes), mounted, ends_m, placed)
            went += goes
            if least_clearance(placed, sizes_m, placed, sizes_m, pairs, APART_M) < APART_M:
                return COLLIDES, lasts_s
        deepest = 0.0
        for other in range(len(radii_m)):
            half = _half_length(now[other])
            for number in range(len(moving)):
                part = int(moving[number])
                room = outer_m[part] + radii_m[other] + keep_m[other] + ROOM_M - deepest
                if _may_be_within(placed[part], sizes_m[part, 1], now[other], half, room):
                    apart = nearest_points(placed[part, 0], placed[part, 1], now[other, 0], now[other, 1])[0]
                    deepest = max(deepest, deepest + room - apart)
        cost += deepest * deepest * each_s
        if cost > most:
            break
    return cost, lasts_s


@compiled
def _half_length(segment: FloatArray) -> float:
    square = 0.0
    for i in range(3):
        square += (0.5 * (segment[1, i] - segment[0, i])) ** 2
    return float(np.sqrt(square))


@compiled
def _may_be_within(capsule: FloatArray, size_m: float, segment: FloatArray, half_m: float, room_m: float) -> bool:
    """Whether a capsule's axis may be nearer to a segment's than this: by the balls around them."""
    x = capsule[2, 0] - 0.5 * (segment[0, 0] + segment[1, 0])
    y = capsule[2, 1] - 0.5 * (segment[0, 1] + segment[1, 1])
    z = capsule[2, 2] - 0.5 * (segment[0, 2] + segment[1, 2])
    reach = room_m + size_m + half_m
    return reach > 0.0 and x * x + y * y + z * z < reach * reach


@compiled
def _freedom(
    before: FloatArray,
    placed: FloatArray,
    sizes_m: FloatArray,
    outer_m: FloatArray,
    moving: FloatArray,
    now: FloatArray,
    people_m_s: FloatArray,
    radii_m: FloatArray,
    zones_m: FloatArray,
    speed_m_s: float,
    each_s: float,
) -> float:
    """The share of a piece of the way that the arm may go, so as not to come too fast towards anyone near it.

    Args:
        before: Placed capsules where the piece begins ...
        placed: ... and where it would end.
        sizes_m: Of `Capsules`.
        outer_m: Of `Capsules`.
        moving: Of `Capsules`.
        now: (S, 2, 3) where the segments are then.
        people_m_s: (S, 2, 3) how they move.
        radii_m: (S,) of these.
        zones_m: (S,) nearer than this, speed towards each is limited.
        speed_m_s: To this, less their own approach.
        each_s: How long the piece takes.
    """
    free = 1.0
    for other in range(len(radii_m)):
        if not people_m_s[other].any():
            continue  # the way takes so long that the arm is slow enough for who stands
        ax, ay, az = now[other, 0]
        ux, uy, uz = now[other, 1] - now[other, 0]
        vx, vy, vz = people_m_s[other, 0]
        square = max(ux * ux + uy * uy + uz * uz, 1e-12)
        coming, closing = 0.0, 0.0
        for number in range(len(moving)):
            part = int(moving[number])
            x, y, z = before[part, 2, 0] - ax, before[part, 2, 1] - ay, before[part, 2, 2] - az
            share = min(max((x * ux + y * uy + z * uz) / square, 0.0), 1.0)
            x, y, z = x - share * ux, y - share * uy, z - share * uz
            apart = max(np.sqrt(x * x + y * y + z * z), 1e-9)
            if apart < outer_m[part] + sizes_m[part, 1] + radii_m[other] + zones_m[other]:
                coming = max(coming, (x * vx + y * vy + z * vz) / apart)
                dx, dy, dz = placed[part, 2] - before[part, 2]
                closing = max(closing, -(x * dx + y * dy + z * dz) / apart / each_s)
        allowed = max(speed_m_s - coming, 0.0) + LEAST_M_S
        if closing > allowed:
            free = min(free, allowed / closing)
    return free


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

# SPDX-License-Identifier: Apache-2.0
"""Which motions are refused: into the robot itself, into a person, or too fast near a person.

A motion is taken only if it and the stop that it would need break no rule all the way, or none that stopping at once
would not break as badly. A refused one is answered by stopping from where the robot is, along a way that was found
harmless before. So only a person who moves can bring about what the rules forbid; then every motion that makes it
worse is refused and every one that leads out of it is taken.

The rules hold between the looks at a path too: each time between two looks is bounded by what happens at its ends and
by how fast that can change (`path_bounds`). People go on at their velocities while the robot stops.

No certified safety function: it trusts a camera, an estimate and this computer. Sources: ISO/TS 15066, 5.5.4, and ISO
13855 (speed and separation monitoring): the robot's stop, the person's way meanwhile and what is unsure of their place
are all within the distance that is kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mild_core.retargeting.clearance import BREACHES, LEAST_M_S, evaluate_poses, find_breach, nearest_rows, path_bounds
from mild_core.retargeting.limiter import JointMotion, Limiter
from mild_core.retargeting.obstacles import NO_ONE, Obstacles
from mild_core.retargeting.robot_model.capsules import Capsules, capsules_of
from mild_core.retargeting.robot_model.chain import Chain, chain_of, nearest_points
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.shapes import FloatArray

APART_M = 0.02
"""Parts of the robot stay this far apart: what stopping and a controller's tracking error may take from it."""

HAND_ROOM_M = 0.05
"""The robot's hand is sent no nearer to what is kept than this, as it is thicker than a point."""

ROUNDING = 1e-6
"""Less than this, in metres or metres per second, is not worse."""

TOO_FAST = "refused_speed"
"""Counted when a motion is too fast near a person."""

UNSURE_M_S, UNSURE_HAND_M_S = 0.1, 0.12
"""What moves may come twice as fast as a tracker can have seen yet, but by no more than the first; an offered hand,
which gathers speed more quickly, by the second."""

MEETING_M = 0.02
"""Hands meet where the robot is deeper than this inside of what an offered forearm is believed to be, up to the finger
tips. There nothing is allowed for, which would keep them apart."""

HURRIED_M = 0.2
"""As far outside of where the speed is limited a robot that is late may begin to catch up faster."""

LOOK_S = 0.01
"""Time between two looks at a path near people: there the bounds between looks are tight to 1 cm and 3 cm/s."""

BETWEEN_M = 0.02
"""More than a person approaches between two such checks [m]."""

FAR_M = 0.35
"""This far outside of where the speed is limited a path is looked at in a few places first; if their bounds are enough,
nothing more has to be known."""

FAR_LOOKS = 2
"""Looks at a stop there."""

UNPACED_M = 0.5
"""Beyond this distance from the zone every arm can still be slowed in time [m]."""

PACE, SLOWING_S = 0.85, 0.15
"""Targets move at this share of the speed that is allowed, and outside of where it is faster by what they need this
long for: a robot that lags behind them, and a person who comes nearer, shall find it slow enough."""


class PoseEvaluation(NamedTuple):
    """What is seen of K poses among S segments; see `evaluate_poses`."""

    own_m: FloatArray
    speed_m_s: FloatArray
    clear_m: FloatArray
    toward_m_s: FloatArray
    approach_m_s: FloatArray

    @property
    def near_m(self) -> float:
        """Distance of the nearest person to the first of the poses [m]."""
        return float(self.clear_m[0].min(initial=math.inf))


class Verdict(NamedTuple):
    """What is wrong with a motion.

    Attributes:
        refusal: A word to count; "" when it is harmless.
        segment: Place of the segment that it is about; -1 for none.
    """

    refusal: str
    segment: int


HARMLESS = Verdict("", -1)


@dataclass(frozen=True, eq=False)
class Guard:
    """The judge of motions of one robot.

    Attributes:
        robot: Whose motions.
        settings: How far and how fast.
        chain: Its arm ...
        capsules: ... and its shape.
        reach_m: No point of the arm is ever further than this from its first joint.
    """

    robot: RobotModel
    settings: RetargetingSettings
    chain: Chain = field(init=False, repr=False)
    capsules: Capsules = field(init=False, repr=False)
    reach_m: float = field(init=False, repr=False)
    _jerk_m_s3: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        chain, capsules = chain_of(self.robot), capsules_of(self.robot)
        object.__setattr__(self, "chain", chain)
        object.__setattr__(self, "capsules", capsules)
        reaches_m, turns = reaches(self.robot), np.linalg.norm(chain.axes, axis=1)
        object.__setattr__(self, "reach_m", float(reaches_m.max()))
        jerk_rad_s3 = turns * self.robot.jerk_rad_s3[chain.columns.astype(int)]
        object.__setattr__(self, "_jerk_m_s3", float(reaches_m @ jerk_rad_s3))

    def evaluate_poses(
        self,
        times_s: FloatArray,
        positions_rad: FloatArray,
        velocities_rad_s: FloatArray,
        among: Obstacles,
        beyond_m: float,
        itself: bool = True,
        around: bool = False,
    ) -> PoseEvaluation:
        """What is seen of K poses (K, J) of a path that move at (K, J), K times after now.

        Args:
            times_s: (K,) those times.
            positions_rad: The poses.
            velocities_rad_s: How they move.
            among: Everyone.
            itself: Whether its clearance to itself matters.
            around: Whether points all around the arm count for an approaching person, and not only the nearest.
            beyond_m: Rates are computed this far outside of the zones in which speed is limited, distances twice as
                far.
        """
        chain, capsules = self.chain, self.capsules
        widest_m = float(among.zones_m.max(initial=0.0))
        own, *others = evaluate_poses(
            *(times_s, positions_rad, velocities_rad_s, chain.columns, chain.offsets, chain.axes),
            *(capsules.mounted, capsules.ends_m, capsules.sizes_m, capsules.outer_m, capsules.pairs, capsules.moving),
            *(among.ends_m, among.velocities_m_s, among.radii_m, among.horizon_s),
            *(widest_m + 2.0 * beyond_m, among.zones_m + beyond_m, APART_M if itself else math.inf),
            self.settings.near_speed_m_s if around else math.inf,
        )
        return PoseEvaluation(own, *others)

    def own_clearance_m(self, positions_rad: FloatArray) -> FloatArray:
        """(K,) clearance of the robot to itself, beyond what is kept, at poses (K, J) [m]."""
        still = np.zeros((1, len(self.robot.joint_names)))
        return np.array(
            [self.evaluate_poses(np.zeros(1), pose[None], still, NO_ONE, 0.0).own_m[0] for pose in positions_rad]
        )

    def here(self, motion: JointMotion, among: Obstacles) -> PoseEvaluation:
        """What is seen of the robot where it is."""
        position, velocity = np.array([motion.position_rad]), np.array([motion.velocity_rad_s])
        return self.evaluate_poses(np.zeros(1), position, velocity, among, UNPACED_M, itself=False)

    def check_motion(
        self,
        limiter: Limiter,
        now: JointMotion,
        then: JointMotion,
        elapsed_s: float,
        here: PoseEvaluation,
        among: Obstacles,
        giving_way: bool = False,
    ) -> Verdict:
        """What is wrong with a motion and the stop that it would need.

        Args:
            limiter: Which stops.
            now: Where the robot is.
            then: Where it would be ...
            elapsed_s: ... after this time.
            here: What is seen of it now.
            among: Everyone.
            giving_way: Whether it leads away from a person: then what little parts of the arm that turn with it come
                towards them is none.
        """
        stop_s = limiter.stop_duration_s(then)
        looks = max(2, math.ceil(elapsed_s / LOOK_S)) if elapsed_s > 1.5 * LOOK_S else 1
        before_s = np.arange(looks) * (elapsed_s / looks)
        if not len(among.people) or float((here.clear_m[0] - among.zones_m).min()) > FAR_M:
            after_s = elapsed_s + np.linspace(0.0, stop_s, 1 + FAR_LOOKS if stop_s else 1)
            times_s = np.concatenate([before_s, after_s])
            verdict = self._check_path(limiter, now, then, elapsed_s, times_s, among, FAR_M, giving_way)
            # Wide looks find a collision with oneself where there is one, but may bound people too coarsely.
            if not verdict.refusal:
                return verdict
        after_s = elapsed_s + np.linspace(0.0, stop_s, 1 + math.ceil(stop_s / LOOK_S))
        times_s = np.concatenate([before_s, after_s])
        return self._check_path(limiter, now, then, elapsed_s, times_s, among, BETWEEN_M, giving_way)

    def _check_path(
        self,
        limiter: Limiter,
        now: JointMotion,
        then: JointMotion,
        elapsed_s: float,
        times_s: FloatArray,
        among: Obstacles,
        beyond_m: float,
        giving_way: bool,
    ) -> Verdict:
        bounds = self._bounds(times_s, *limiter.path(now, then, elapsed_s, times_s), among, beyond_m, giving_way)
        nothing = np.empty((0, bounds.shape[1]))
        rule, segment = find_breach(bounds, nothing, among.keep_m, ROUNDING)
        if rule:
            stopped = limiter.path(now, limiter.stop(now, elapsed_s), elapsed_s, times_s)
            least = self._bounds(times_s, *stopped, among, beyond_m, giving_way)
            rule, segment = find_breach(bounds, least, among.keep_m, ROUNDING)
        return Verdict(BREACHES[rule], segment) if rule else HARMLESS

    def _bounds(
        self,
        times_s: FloatArray,
        positions_rad: FloatArray,
        velocities_rad_s: FloatArray,
        among: Obstacles,
        beyond_m: float,
        giving_way: bool,
    ) -> FloatArray:
        seen = self.evaluate_poses(times_s, positions_rad, velocities_rad_s, among, beyond_m, around=not giving_way)
        limits = self.settings.near_speed_m_s, self._jerk_m_s3, LEAST_M_S if giving_way else 0.0
        return path_bounds(times_s, *seen, among.speeds_m_s, among.zones_m, *limits, _unsure_m_s(among, seen))

    def push_out(self, point_m: FloatArray, among: Obstacles) -> tuple[FloatArray, int]:
        """(3,) the point, or the nearest one at which the robot's hand keeps out of what must not be touched.

        With the place of the segment that it is pushed out of; -1 for none.
        """
        pushed = -1
        each = zip(among.ends_m, among.radii_m, among.keep_m, strict=True)
        for place, ((start, end), radius_m, keep_m) in enumerate(each):
            if not math.isfinite(keep_m):
                continue
            distance_m, _, share = nearest_points(point_m, point_m, start, end)
            least_m = radius_m + keep_m + HAND_ROOM_M
            if 1e-6 < distance_m < least_m:
                away = point_m - (start + share * (end - start))
                point_m, pushed = point_m + away * (least_m / distance_m - 1.0), place
        return point_m, pushed

    def nearness(self, near_m: float) -> float:
        """From 0 to 1 where the robot is so close to a person that its speed is limited."""
        return min(max(1.0 - (near_m - self.settings.near_m) / HURRIED_M, 0.0), 1.0)

    def within_reach(self, among: Obstacles) -> bool:
        """Whether a bystander is where the arm can come."""
        shoulder = self.chain.offsets[0][:3, 3]
        return any(
            among.is_bystander(place)
            and nearest_points(shoulder, shoulder, *among.ends_m[place])[0] - among.radii_m[place] < self.reach_m
            for place in range(len(among.people))
        )

    def limit_speed(
        self,
        from_rad: FloatArray,
        to_rad: FloatArray,
        here: PoseEvaluation,
        among: Obstacles,
        crowded: bool,
        elapsed_s: float,
    ) -> FloatArray:
        """(J,) as far from one target towards the next as the arm may go near people, so that nothing is refused.

        Args:
            from_rad: (J,) the target before, which the robot lags behind.
            to_rad: (J,) the one that is wanted.
            here: What is seen of the robot.
            among: Everyone.
            crowded: Whether a bystander is within reach: then the arm is slow everywhere.
            elapsed_s: Time between both targets.
        """
        outside_m = (here.clear_m[0] - among.zones_m).min(initial=math.inf)
        if elapsed_s <= 0.0 or (outside_m > UNPACED_M and not crowded):
            return to_rad
        there = self.evaluate_poses(
            np.zeros(1), from_rad[None], ((to_rad - from_rad) / elapsed_s)[None], among, UNPACED_M, itself=False
        )
        beyond_m = np.maximum(np.minimum(here.clear_m[0], there.clear_m[0]) - among.zones_m, 0.0)
        near, slack = self.settings.near_speed_m_s, beyond_m / SLOWING_S
        most = PACE * near + (0.0 if crowded else float(slack.min(initial=math.inf)))
        share = min(1.0, most / max(float(there.speed_m_s[0]), 1e-9))
        left = PACE * np.maximum(near - there.approach_m_s[0], 0.0) + slack
        for towards, allowed in zip(there.toward_m_s[0], left, strict=True):
            if towards * share > allowed:
                share = allowed / towards
        paced: FloatArray = to_rad if share >= 1.0 else from_rad + share * (to_rad - from_rad)
        return paced

    def rows_away(self, position_rad: FloatArray, among: Obstacles, far_m: float) -> tuple[FloatArray, ...]:
        """What moves the arm away from people; see `nearest_rows`."""
        chain, capsules = self.chain, self.capsules
        return nearest_rows(
            *(position_rad, chain.columns, chain.offsets, chain.axes),
            *(capsules.mounted, capsules.ends_m, capsules.outer_m, capsules.moving),
            *(among.ends_m, among.velocities_m_s, among.radii_m, far_m),
        )

    def arm_speed(self, position_rad: FloatArray, velocity_rad_s: FloatArray, among: Obstacles) -> float:
        """Greatest speed of a point of the arm [m/s]."""
        seen = self.evaluate_poses(np.zeros(1), position_rad[None], velocity_rad_s[None], among, 0.0, itself=False)
        return float(seen.speed_m_s[0])


def _unsure_m_s(among: Obstacles, seen: PoseEvaluation) -> FloatArray:
    """(S,) how much faster each segment may come than it is seen to [m/s]."""
    most = np.full(len(among.people), UNSURE_M_S)
    if among.offered >= 0:
        meets = seen.clear_m[0, among.offered] < -MEETING_M
        most[among.offered] = 0.0 if meets else UNSURE_HAND_M_S
    unsure: FloatArray = np.minimum(among.speeds_m_s, most)
    return unsure


def reaches(robot: RobotModel) -> FloatArray:
    """(C,) how far a point of the arm can be from the axis of each joint of its chain: the way to its end [m]."""
    chain, capsules = chain_of(robot), capsules_of(robot)
    found = np.zeros(len(chain.columns))
    steps = np.linalg.norm(chain.offsets[:, :3, 3], axis=1)
    for place in range(len(found)):
        for part in capsules.moving.astype(int):
            frame = int(capsules.mounted[part])
            if frame <= place:
                continue
            beyond = float(np.linalg.norm(capsules.ends_m[part], axis=1).max()) + capsules.outer_m[part]
            found[place] = max(found[place], float(steps[place + 1 : frame].sum()) + beyond)
    return found

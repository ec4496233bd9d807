# SPDX-License-Identifier: Apache-2.0
"""Which motions are refused: into the robot itself, into the person's head or trunk, or too fast near the person.

A motion is taken only if the stop that it would need is harmless all the way. A refused one is answered by stopping
from where the robot is, along a way that was found harmless before, so only a person who moves can bring about what
the rules forbid; then every motion that makes it worse is refused and every one that leads out of it is taken.

No certified safety function: it trusts a camera, an estimate and this computer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mild_core.retargeting.capsules import Capsules, capsules_of
from mild_core.retargeting.chain import Chain, chain_of
from mild_core.retargeting.clearance import look
from mild_core.retargeting.limiter import JointMotion
from mild_core.retargeting.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.shapes import FloatArray

APART_M = 0.02
"""Parts of the robot stay this far apart: what stopping and a controller's tracking error may take from it."""

HEAD_RADIUS_M, TRUNK_RADIUS_M = 0.12, 0.14
"""Of an adult. Source: halves of the 95th percentiles of head length and chest depth, DIN 33402-2, rounded up."""

HAND_ROOM_M = 0.05
"""The robot's hand is sent no nearer to what is kept than this, as it is thicker than a point."""

WORSE_M = 1e-6
"""Less than this is not worse: rounding."""

TOO_FAST = "refused_speed"
"""Counted when a motion is too fast near the person."""

HURRIED_M = 0.2
"""As far outside of where the speed is limited a robot that is late may begin to catch up faster."""

UNPACED_M = 0.5
"""Further outside of it nobody's arm is too fast to be slowed in time."""

PACE, SLOWING_S = 0.85, 0.15
"""Targets move at this share of the speed that is allowed, and outside of where it is faster by what they need this
long for: a robot that lags behind them, and a person who comes nearer, shall find it slow enough."""

SELF, PERSON, NEAR, SPEED = range(4)
"""Columns of what is seen at a pose: clearance to itself and to head and trunk, distance to head, trunk and hand,
all less what has to be kept [m]; and the speed of the tool [m/s]."""


@dataclass(frozen=True, eq=False)
class Body:
    """The person as the robot has to respect them, in its base frame.

    Attributes:
        hand_m: (3,) the hand that may be touched; NaN when it is not known.
        capsules_m: (2, 3, 3) head and trunk: ends and middle; NaN where unknown.
    """

    hand_m: FloatArray
    capsules_m: FloatArray


SIZES_M = np.array([[HEAD_RADIUS_M, 0.0], [TRUNK_RADIUS_M, 0.3]])
"""Radius and half length of head and trunk; half the length of a trunk bounds that of everyone."""

NOBODY = Body(np.full(3, np.nan), np.full((2, 3, 3), np.nan))


def body_of(hand_m: FloatArray, trunk_m: FloatArray) -> Body:
    """The body of a person.

    Args:
        hand_m: (3,) the hand.
        trunk_m: (3, 3) head, middle of the shoulders and of the hips.
    """
    head, shoulders, hips = trunk_m
    return Body(hand_m, np.stack([[head, head, head], [shoulders, hips, (shoulders + hips) / 2.0]]))


@dataclass(frozen=True, eq=False)
class Guard:
    """The judge of motions of one robot.

    Attributes:
        robot: Whose motions.
        settings: How far and how fast.
    """

    robot: RobotModel
    settings: RetargetingSettings
    chain: Chain = field(init=False, repr=False)
    _capsules: Capsules = field(init=False, repr=False)
    _meetings: FloatArray = field(init=False, repr=False)
    _keep: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        chain, capsules = chain_of(self.robot), capsules_of(self.robot)
        meetings = np.array([(part, other) for part in capsules.moving for other in (0.0, 1.0)])
        object.__setattr__(self, "chain", chain)
        object.__setattr__(self, "_capsules", capsules)
        object.__setattr__(self, "_meetings", meetings)
        object.__setattr__(self, "_keep", np.array([APART_M, self.settings.keep_out_m]))

    def seen(self, motions: Sequence[JointMotion], body: Body) -> FloatArray:
        """(S, 4) what is seen at each of S motions; columns as said above."""
        chain, capsules = self.chain, self._capsules
        positions = np.array([motion.position_rad for motion in motions])
        velocities = np.array([motion.velocity_rad_s for motion in motions])
        return look(
            *(positions, velocities, chain.columns, chain.offsets, chain.axes, chain.tool_m),
            *(capsules.mounted, capsules.ends_m, capsules.sizes_m, capsules.pairs),
            *(self._meetings, body.capsules_m, SIZES_M, body.hand_m, self._keep),
        )

    def judged(self, now: JointMotion, stop: Sequence[JointMotion], body: Body) -> tuple[str, float]:
        """Why a motion is refused, as a word to count, "" when it is not; and how near the person the robot is [m].

        Args:
            now: Where the robot is.
            stop: The motion after the next step, and some of its stop, to the end.
            body: The person.
        """
        here, *ahead = self.seen((now, *stop), body).tolist()
        for there in ahead:
            if there[SELF] < min(0.0, here[SELF] - WORSE_M):
                return "refused_self_collision", here[NEAR]
            if there[PERSON] < min(0.0, here[PERSON] - WORSE_M):
                return "refused_keep_out", here[NEAR]
            if there[NEAR] < self.settings.near_m and there[SPEED] > self.settings.near_speed_m_s:
                return TOO_FAST, here[NEAR]
        return "", here[NEAR]

    def outside(self, point_m: FloatArray, body: Body) -> FloatArray:
        """(3,) the point, or the nearest one at which the robot's hand keeps out of head and trunk."""
        for (start, end, _), (radius_m, _) in zip(body.capsules_m, SIZES_M, strict=True):
            along = end - start
            share = min(max(float((point_m - start) @ along) / max(float(along @ along), 1e-9), 0.0), 1.0)
            away = point_m - (start + share * along)
            distance_m, least_m = math.hypot(*away), radius_m + self.settings.keep_out_m + HAND_ROOM_M
            if 1e-6 < distance_m < least_m:
                point_m = point_m + away * (least_m / distance_m - 1.0)
        return point_m

    def nearness(self, near_m: float) -> float:
        """From 0 to 1 where the robot's hand is so near the person that its speed is limited."""
        return min(max(1.0 - (near_m - self.settings.near_m) / HURRIED_M, 0.0), 1.0)

    def paced(self, from_rad: FloatArray, to_rad: FloatArray, near_m: float, elapsed_s: float) -> FloatArray:
        """(J,) as far from one target towards the next as the hand may go near the person, so that nothing is refused.

        Args:
            from_rad: (J,) the target before.
            to_rad: (J,) the one that is wanted.
            near_m: How near the person the robot is.
            elapsed_s: Time between both.
        """
        beyond_m = max(near_m - self.settings.near_m, 0.0)
        if beyond_m > UNPACED_M:
            return to_rad
        way_m = math.dist(self.chain.tool(from_rad), self.chain.tool(to_rad))
        most_m = (PACE * self.settings.near_speed_m_s + beyond_m / SLOWING_S) * elapsed_s
        paced: FloatArray = to_rad if way_m <= most_m else from_rad + (to_rad - from_rad) * (most_m / way_m)
        return paced

# SPDX-License-Identifier: Apache-2.0
"""Whether a raised hand is meant for the robot: what must hold before its first motion.

People greet others, scratch themselves and point. So the first motion needs a person who faces the robot and is near
it, a recognised interaction for a moment, and a hand that goes neither to their own head nor aside. A hand that is
offered and has no name yet does as well, of a person who is seen to face the robot and to stand: naming takes the
better part of a second, and then the arm would be late. Once the robot follows, only the end of the interaction stops
it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mild_core.retargeting.human_track import HumanTrack
from mild_core.retargeting.obstacles import Crowd
from mild_core.retargeting.robot_model.chain import nearest_points
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.shapes import FloatArray
from mild_core.signals import ROBOT_FRAME, UNKNOWN_DIRECTION, WATCHED_PERSON

TURNED_AWAY, FAR, UNDECIDED, WATCHED = "start_turned_away", "start_too_far", "start_undecided", "start_watched"
ASIDE, AT_HEAD = "start_aside", "start_at_head"
"""Why the robot does not start for a raised hand, as it is counted: once for each time that it becomes so."""

SOON_S = 0.2
"""A hand is judged by where it is and by where it will be after this time if it goes on."""

HIGH_M, NEAR_HEAD_M = -0.05, 0.25
"""A hand this much above the shoulder and less than the second in front of it is at the person's own head. Hands that
wave are 0.3 m in front of it or lower."""

ASIDE_M, BEHIND_M = 0.3, 0.3
"""A hand this far outside of its shoulder, and further than in front of it, points aside; this far behind, back. Hands
that greet come towards the middle of the body: in the recordings none was outside by more than 0.1 m."""

WALKS_M_S = 0.3
"""People whose trunk moves faster than this swing their arms, so that their hand needs a name. Standing people
sway by less than 0.1 m/s; slow walking is 0.6."""

ARM_M = 0.6
"""A hand at rest hangs this far below its shoulder, where the shoulder is not seen."""


@dataclass(frozen=True)
class Way:
    """Where a hand is and will soon be, from its shoulder.

    Attributes:
        now: Towards the robot, outwards (away from the other shoulder), and up [m].
        soon: The same three after `SOON_S`.
    """

    now: tuple[float, float, float]
    soon: tuple[float, float, float]

    @property
    def doubt(self) -> str:
        """Which other thing than a greeting the hand does; "" for none."""
        for forward, outward, up in (self.now, self.soon):
            if up > HIGH_M and forward < NEAR_HEAD_M:
                return AT_HEAD
            if (outward > ASIDE_M and outward > forward) or forward < -BEHIND_M:
                return ASIDE
        return ""

    def reaches(self, far_m: float) -> bool:
        """Whether the hand is held out so far towards the robot, and does nothing else."""
        return self.now[0] >= far_m and not self.doubt


class Around(NamedTuple):
    """What the watched person's place says.

    Attributes:
        to_robot: (3,) horizontal direction from them to the robot.
        own: Ends of each of their parts.
    """

    to_robot: FloatArray
    own: dict[str, FloatArray]


def way_of(sight: HumanTrack, crowd: Crowd | None) -> Way:
    """Where the hand goes.

    Args:
        sight: The watched hand.
        crowd: Everyone's segments; None when not known.
    """
    to_robot, own = _around(sight, crowd)
    side = _side(own, sight.hand_m)
    upper_arm = own.get(f"{side}_upper_arm")
    shoulder = sight.rest_m + np.array([0.0, 0.0, ARM_M]) if upper_arm is None else upper_arm[0]
    outward = np.array([to_robot[1], -to_robot[0], 0.0]) * (1.0 if side == "right" else -1.0)
    axes = np.stack([to_robot, outward, np.array([0.0, 0.0, 1.0])])
    now = axes @ (sight.hand_m - shoulder)
    soon = now + SOON_S * (axes @ sight.velocity_m_s)
    return Way(tuple(now.tolist()), tuple(soon.tolist()))


def start_refusal(
    sight: HumanTrack,
    crowd: Crowd | None,
    evidence: float,
    named: bool,
    settings: RetargetingSettings,
    shoulder_m: FloatArray,
    now_ns: int,
) -> str:
    """Why the robot does not start for this person; "" when it may.

    Args:
        sight: The watched hand.
        crowd: Everyone's segments, and where the watched person faces; None when not known.
        evidence: For a recognised interaction, from 0 to 1.
        named: Whether it is known which one; else the hand is offered.
        settings: The thresholds.
        shoulder_m: (3,) the robot's first joint in its base frame.
        now_ns: Time of the command.
    """
    if sight.frame_id == ROBOT_FRAME:
        to_robot, own = _around(sight, crowd)
        facing = UNKNOWN_DIRECTION if crowd is None else _flat(crowd.facing)
        if float(facing @ to_robot) < math.cos(math.radians(settings.start_facing_deg)):  # not so for NaN
            return TURNED_AWAY
        away_m = math.dist(_middle(own, sight)[:2], shoulder_m[:2])
        if away_m > settings.start_trunk_m or math.dist(sight.hand_m, shoulder_m) > settings.start_hand_m:
            return FAR
    if evidence < settings.start_evidence or not (named or _stands_facing(sight, crowd)):
        return UNDECIDED
    return WATCHED if (now_ns - sight.raised_ns) * 1e-9 < settings.start_watch_s else ""


def _stands_facing(sight: HumanTrack, crowd: Crowd | None) -> bool:
    """Whether the watched person is seen to stand, and which way they face, so that this was judged."""
    if sight.frame_id != ROBOT_FRAME or crowd is None or not np.isfinite(crowd.facing).all():
        return False
    segments = crowd.segments
    each = zip(segments.people, segments.parts, segments.velocities_m_s, strict=True)
    trunks = [ends for person, part, ends in each if person == WATCHED_PERSON and part == "trunk"]
    return bool(trunks) and float(np.linalg.norm(trunks[0].mean(axis=0))) < WALKS_M_S


def _around(sight: HumanTrack, crowd: Crowd | None) -> Around:
    own: dict[str, FloatArray] = {}
    if crowd is not None and crowd.frame_id == sight.frame_id:
        segments = crowd.segments
        each = zip(segments.people, segments.parts, segments.ends_m, strict=True)
        own = {part: ends for person, part, ends in each if person == WATCHED_PERSON}
    if sight.frame_id == ROBOT_FRAME:
        return Around(_flat(-_middle(own, sight)), own)  # people turn to the whole robot, whose base is the origin
    return Around(np.array([1.0, 0.0, 0.0]), own)  # the arm frame's x axis: where they faced at calibration


def _middle(own: dict[str, FloatArray], sight: HumanTrack) -> FloatArray:
    """(3,) the middle of the trunk, or where the hand rests."""
    middle: FloatArray = own["trunk"].mean(axis=0) if "trunk" in own else sight.rest_m
    return middle


def _side(own: dict[str, FloatArray], hand_m: FloatArray) -> str:
    """The side whose forearm the hand is on; the right one where none is known. The hand has to be seen now."""
    arms = [side for side in ("right", "left") if f"{side}_forearm" in own]
    if not arms:
        return "right"
    return min(arms, key=lambda side: float(nearest_points(hand_m, hand_m, *own[f"{side}_forearm"])[0]))


def _flat(direction: FloatArray) -> FloatArray:
    """(3,) the horizontal part, of length 1; zero for a vertical one."""
    flat = np.array([direction[0], direction[1], 0.0])
    length = math.hypot(flat[0], flat[1])
    return flat if length <= 1e-9 else flat / length

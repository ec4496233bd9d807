# SPDX-License-Identifier: Apache-2.0
"""Whether a raised hand is meant for the robot: what must hold before its first motion.

People greet others, scratch themselves and point. So the first motion needs a person who faces the robot and is near
it, a recognised interaction for a moment, and a hand that has come towards the robot and away from their own body. Once
the robot follows, only the end of the interaction stops it.
"""

from __future__ import annotations

import math

import numpy as np

from mild_core.retargeting.chain import nearest_points
from mild_core.retargeting.obstacles import Crowd
from mild_core.retargeting.person import Sight
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.shapes import FloatArray
from mild_core.signals import ROBOT_FRAME, WATCHED_PERSON

TURNED_AWAY, FAR, UNDECIDED = "start_turned_away", "start_too_far", "start_undecided"
ELSEWHERE, AT_BODY = "start_elsewhere", "start_at_own_body"
"""Why the robot does not start, as it is counted: once for each time that it becomes so."""


def start_refusal(
    sight: Sight, crowd: Crowd | None, evidence: float, settings: RetargetingSettings, shoulder_m: FloatArray
) -> str:
    """Why the robot does not start for this hand; "" when it may.

    Args:
        sight: The watched hand.
        crowd: Everyone's segments, and where the watched person faces; None when not known.
        evidence: For a recognised interaction, from 0 to 1.
        settings: The thresholds.
        shoulder_m: (3,) the robot's first joint in its base frame.
    """
    if evidence < settings.start_evidence:
        return UNDECIDED
    own = {} if crowd is None or crowd.frame_id != sight.frame_id else _own_segments(crowd)
    if sight.frame_id == ROBOT_FRAME:
        at = own["trunk"][0].mean(axis=0) if "trunk" in own else sight.rest_m
        to_robot = _flat(-at)  # the base is the origin: people turn to the whole robot
        if crowd is not None and math.isfinite(float(crowd.facing[0])):
            facing = _flat(crowd.facing)
            if float(facing @ to_robot) < math.cos(math.radians(settings.start_facing_deg)):
                return TURNED_AWAY
        away_m = math.dist(at[:2], shoulder_m[:2])
        if math.dist(sight.hand_m, shoulder_m) > settings.start_hand_m or away_m > settings.start_trunk_m:
            return FAR
    else:
        to_robot = np.array([1.0, 0.0, 0.0])  # the arm frame's x axis: where the person faced at calibration
    if float((sight.hand_m - sight.rest_m) @ to_robot) < settings.start_reach_m:
        return ELSEWHERE
    mine = _nearest_arm(own, sight.hand_m)
    for part, (ends_m, radius_m) in own.items():
        if part.startswith(mine) or part.endswith(("thigh", "shin")):
            continue
        if nearest_points(sight.hand_m, sight.hand_m, *ends_m)[0] - radius_m < settings.start_apart_m:
            return AT_BODY
    return ""


def _own_segments(crowd: Crowd) -> dict[str, tuple[FloatArray, float]]:
    """Ends and radius of each part of the watched person."""
    segments = crowd.segments
    each = zip(segments.people, segments.parts, segments.ends_m, segments.radii_m, strict=True)
    return {part: (ends, float(radius)) for person, part, ends, radius in each if person == WATCHED_PERSON}


def _nearest_arm(own: dict[str, tuple[FloatArray, float]], hand_m: FloatArray) -> str:
    """The side whose forearm the hand is on, as parts of it begin; one that no part begins with when there is none."""
    arms = [side for side in ("left_", "right_") if f"{side}forearm" in own]
    if not arms:
        return "no arm"
    return min(arms, key=lambda side: float(nearest_points(hand_m, hand_m, *own[f"{side}forearm"][0])[0]))


def _flat(direction: FloatArray) -> FloatArray:
    """(3,) the horizontal part, of length 1; zero for a vertical one."""
    flat = np.array([direction[0], direction[1], 0.0])
    length = math.hypot(flat[0], flat[1])
    return flat / length if length > 1e-9 else flat

# SPDX-License-Identifier: Apache-2.0
"""Where the watched person is, for a robot that may touch the hand and must keep away from head and trunk."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mild_core.errors import DataError
from mild_core.perception.calibration import Calibration
from mild_core.perception.gates import Point, believed
from mild_core.shapes import FloatArray
from mild_core.signals import ARM_FRAME, ROBOT_FRAME, PersonPose, SkeletonFrame

HAND_FROM_WRIST_M = 0.08
"""From the wrist to the middle of the hand, along the forearm, where a tracker sees no hand. Source: an adult's hand
is 0.19 m long, of which the palm is the first 0.11."""

SHOULDERS, HIPS = ("left_shoulder", "right_shoulder"), ("left_hip", "right_hip")

UNSEEN: Point = (math.nan, math.nan, math.nan)


def person_pose(
    person: SkeletonFrame,
    calibration: Calibration,
    robot_from_source: FloatArray | None,
    min_confidence: float,
    arm_believed: bool,
) -> PersonPose:
    """Hand, head and trunk of a person.

    Args:
        person: One frame of them.
        calibration: Their arm frame; its side is the watched one.
        robot_from_source: (4, 4) pose of the tracker's frame in the robot's base frame; None leaves the person in the
            arm frame.
        min_confidence: Least confidence of a joint that is used.
        arm_believed: Whether the arm passed the gates; a hand on an arm that did not is not told.
    """

    def middle(names: Sequence[str]) -> Point:
        """Between joints, if all are to be believed."""
        try:
            points = believed(person, names, min_confidence)
        except DataError:
            return UNSEEN
        x, y, z = (math.fsum(values) / len(points) for values in zip(*points, strict=True))
        return x, y, z

    hips = middle(("pelvis",)) if "pelvis" in person.joint_names else middle(HIPS)
    hand = _hand(person, calibration.side, min_confidence) if arm_believed else UNSEEN
    seen = np.array([hand, middle(("head",)), middle(SHOULDERS), hips])
    if robot_from_source is None:
        placed, frame = (seen - calibration.shoulder_m) @ calibration.arm_from_source.T, ARM_FRAME
    else:
        placed, frame = seen @ robot_from_source[:3, :3].T + robot_from_source[:3, 3], ROBOT_FRAME
    return PersonPose(person.stamp_ns, frame, placed[0], placed[1], placed[2:])


def _hand(person: SkeletonFrame, side: str, min_confidence: float) -> Point:
    """The tracked hand, or what lies beyond the wrist."""
    names = (f"{side}_elbow", f"{side}_wrist", f"{side}_hand")
    try:
        if names[2] in person.joint_names:
            return believed(person, names[2:], min_confidence)[0]
        elbow, wrist = believed(person, names[:2], min_confidence)
    except DataError:
        return UNSEEN
    beyond = HAND_FROM_WRIST_M / max(math.dist(elbow, wrist), 1e-6)
    x, y, z = (end + beyond * (end - start) for start, end in zip(elbow, wrist, strict=True))
    return x, y, z

# SPDX-License-Identifier: Apache-2.0
"""Where the watched person is, for a robot that may touch the hand and must keep away from head and trunk."""

from __future__ import annotations

import math

import numpy as np

from mild_core.perception.bodies import Placing
from mild_core.perception.joint_validity import UNSEEN, Body, Point, believed_place, middle
from mild_core.shapes import FloatArray
from mild_core.signals import BodySegments, PersonPose

HAND_FROM_WRIST_M = 0.08
"""From the wrist to the middle of the hand, along the forearm, where a tracker sees no hand. Source: an adult's hand
is 0.19 m long, of which the palm is the first 0.11."""

SHOULDERS, HIPS = ("left_shoulder", "right_shoulder"), ("left_hip", "right_hip")


def person_pose(
    body: Body,
    side: str,
    placing: Placing,
    frame_id: str,
    min_confidence: float,
    arm_believed: bool,
    segments: BodySegments,
    facing: FloatArray,
) -> PersonPose:
    """Hand, head and trunk of the watched person, and everyone's segments.

    Args:
        body: One frame of the person.
        side: The watched arm.
        placing: From the tracker's frame to that of the pose ...
        frame_id: ... which is this one.
        min_confidence: Least confidence of a joint that is used.
        arm_believed: Whether the arm passed the gates; a hand on an arm that did not is left out.
        segments: Everyone in view, in the frame of the pose.
        facing: (3,) of the person, in that frame.
    """
    hips = believed_place(body, "pelvis", min_confidence)
    if "pelvis" not in body.places:
        hips = middle(*[believed_place(body, name, min_confidence) for name in HIPS])
    shoulders = middle(*[believed_place(body, name, min_confidence) for name in SHOULDERS])
    hand = _hand(body, side, min_confidence) if arm_believed else UNSEEN
    placed = placing.placed(np.array([hand, believed_place(body, "head", min_confidence), shoulders, hips]))
    placed.flags.writeable = False
    return PersonPose(body.frame.stamp_ns, frame_id, placed[0], placed[1], placed[2:], segments, facing)


def _hand(body: Body, side: str, min_confidence: float) -> Point:
    """The tracked hand, or what lies beyond the wrist."""
    if f"{side}_hand" in body.frame.joint_names:
        return believed_place(body, f"{side}_hand", min_confidence)
    elbow, wrist = [believed_place(body, f"{side}_{part}", min_confidence) for part in ("elbow", "wrist")]
    beyond = HAND_FROM_WRIST_M / max(math.dist(elbow, wrist), 1e-6)
    x, y, z = [end + beyond * (end - start) for start, end in zip(elbow, wrist, strict=True)]
    return x, y, z

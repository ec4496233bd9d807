# SPDX-License-Identifier: Apache-2.0
"""People for tests: segments of whole bodies around a hand, a head and a trunk, still or moving."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mild_core.shapes import FloatArray
from mild_core.signals import ROBOT_FRAME, UNKNOWN_DIRECTION, WATCHED_PERSON, BodySegments, PersonPose

RADII_M = {
    "head": 0.12,
    "trunk": 0.15,
    "shoulders": 0.08,
    "right_upper_arm": 0.055,
    "right_forearm": 0.05,
    "left_upper_arm": 0.055,
    "left_forearm": 0.05,
    "right_thigh": 0.09,
    "left_thigh": 0.09,
    "right_shin": 0.07,
    "left_shin": 0.07,
}
"""Of an adult."""

FOREARM_M, HAND_M = 0.25, 0.08
"""From elbow to wrist, from there to the middle of the hand; the fingers end as far beyond."""

Ends = dict[str, tuple[FloatArray, FloatArray]]


def body_ends(hand_m: FloatArray, head_m: FloatArray, shoulders_m: FloatArray, hips_m: FloatArray) -> Ends:
    """Ends of each part of a person whose right hand, head, middle of shoulders and of hips are there."""
    up = (shoulders_m - hips_m) / max(float(np.linalg.norm(shoulders_m - hips_m)), 1e-9)
    forward = hand_m - shoulders_m
    forward = forward - (forward @ up) * up
    forward = forward / max(float(np.linalg.norm(forward)), 1e-9)
    left = np.cross(up, forward)
    shoulder, other = shoulders_m - 0.18 * left, shoulders_m + 0.18 * left
    # The elbow hangs below the straight line from shoulder to hand.
    span = hand_m - shoulder
    length, upper, lower = float(np.linalg.norm(span)), 0.29, FOREARM_M + HAND_M
    along = np.clip((length**2 + upper**2 - lower**2) / (2.0 * max(length, 1e-9)), -upper, upper)
    down = -up + (up @ span) * span / max(length**2, 1e-9)
    down = down / max(float(np.linalg.norm(down)), 1e-9)
    elbow = shoulder + along * span / max(length, 1e-9) + np.sqrt(max(upper**2 - along**2, 0.0)) * down
    tip = hand_m + (hand_m - elbow) / max(float(np.linalg.norm(hand_m - elbow)), 1e-9) * HAND_M
    left_elbow, left_tip = other - 0.28 * up + 0.03 * left, other - 0.72 * up + 0.05 * left
    right_hip, left_hip = hips_m - 0.09 * left, hips_m + 0.09 * left
    return {
        "head": (head_m, head_m + 0.02 * up),
        "trunk": (shoulders_m, hips_m),
        "shoulders": (shoulder, other),
        "right_upper_arm": (shoulder, elbow),
        "right_forearm": (elbow, tip),
        "left_upper_arm": (other, left_elbow),
        "left_forearm": (left_elbow, left_tip),
        "right_thigh": (right_hip, right_hip - 0.42 * up),
        "left_thigh": (left_hip, left_hip - 0.42 * up),
        "right_shin": (right_hip - 0.42 * up, right_hip - 0.85 * up),
        "left_shin": (left_hip - 0.42 * up, left_hip - 0.85 * up),
    }


def shifted(body: Ends, way_m: FloatArray) -> Ends:
    """The same body elsewhere."""
    return {part: (start + way_m, end + way_m) for part, (start, end) in body.items()}


def segments(
    bodies: Iterable[tuple[int, Ends]], velocity_m_s: FloatArray | None = None, parts: Iterable[str] = tuple(RADII_M)
) -> BodySegments:
    """Of these people, by number; all of them move at one velocity."""
    wanted = set(parts)
    each = [(number, part, ends) for number, body in bodies for part, ends in body.items() if part in wanted]
    moving = np.zeros(3) if velocity_m_s is None else velocity_m_s
    return BodySegments(
        tuple(number for number, _, _ in each),
        tuple(part for _, part, _ in each),
        np.array([ends for _, _, ends in each]).reshape(-1, 2, 3),
        np.tile(moving, (len(each), 2, 1)),
        np.array([RADII_M[part] for _, part, _ in each]),
    )


def pose(
    stamp_ns: int,
    hand_m: FloatArray,
    head_m: FloatArray,
    trunk_m: FloatArray,
    frame_id: str = ROBOT_FRAME,
    bystanders: Iterable[Ends] = (),
    velocity_m_s: FloatArray | None = None,
    facing: FloatArray = UNKNOWN_DIRECTION,
    parts: Iterable[str] = tuple(RADII_M),
) -> PersonPose:
    """A person with a hand, a head and a trunk (2, 3) there, and others."""
    bodies = [(WATCHED_PERSON, body_ends(hand_m, head_m, *trunk_m)), *enumerate(bystanders, start=1)]
    known = segments(bodies, velocity_m_s, parts)
    return PersonPose(stamp_ns, frame_id, hand_m, head_m, trunk_m, known, facing)

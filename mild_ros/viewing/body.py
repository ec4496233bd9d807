# SPDX-License-Identifier: Apache-2.0
"""A person drawn from the joints of a skeleton: rigid, smooth parts that move with the bones.

The shapes are made once from the person's median bone lengths; each moment only places them. Axes are REP-103:
x forward of the person, y left, z up, whatever the tracker's were.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.shapes import FloatArray
from mild_ros.viewing.surfaces import Ring, Surface, ellipsoid, lofted, tapered_limb

Places = Mapping[str, FloatArray]
"""Joint name to (3,) metres."""

SKIN, HAIR, SHIRT, TROUSERS, SHOES, EYES = (
    (0.93, 0.74, 0.62),
    (0.30, 0.21, 0.16),
    (0.10, 0.52, 0.62),
    (0.26, 0.30, 0.40),
    (0.33, 0.31, 0.31),
    (0.16, 0.14, 0.14),
)


_ON_BOTH_SIDES = ("shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle", "foot")

NEEDED = frozenset(
    ("pelvis", "neck", "head", *(f"{side}_{part}" for side in ("left", "right") for part in _ON_BOTH_SIDES))
)
"""Joints without which no body can be drawn."""


LONGEST_FIST_M = 0.05
"""From the middle of the hand to the tip of a closed one; trackers without a tip joint see hands that are open."""


@dataclass(frozen=True, eq=False)
class BodyPart:
    """One rigid part.

    Attributes:
        name: E.g. "right_forearm".
        colour: Red, green, blue from 0 to 1.
        surface: Its shape in its own frame.
        pose: From joints to (rotation (3, 3), position (3,)) of its frame.
    """

    name: str
    colour: tuple[float, float, float]
    surface: Surface
    pose: Callable[[Places], tuple[FloatArray, FloatArray]]


def body_parts(frames: Sequence[Places]) -> tuple[BodyPart, ...]:
    """The parts of a person who was seen in `frames` (each with the joints of `NEEDED`)."""

    def length(a: str, b: str) -> float:
        seen = [np.linalg.norm(frame[b] - frame[a]) for frame in frames if b in frame]
        return float(np.median(seen)) if seen else np.inf

    parts = [*_trunk(length), *_head(length)]
    for side in ("left", "right"):
        parts += _arm(side, length) + _leg(side, length)
    return tuple(parts)


def _trunk(length: Callable[[str, str], float]) -> list[BodyPart]:
    height = length("pelvis", "neck")
    half_shoulders = 0.5 * length("left_shoulder", "right_shoulder")
    half_hips = max(0.5 * length("left_hip", "right_hip"), 0.55 * half_shoulders)
    chest = half_shoulders * 0.93
    rings = [
        Ring(-0.14, 0.04, half_hips * 0.5, 0.0, 2.4),
        Ring(-0.12, 0.085, half_hips * 1.15, -0.005, 2.4),
        Ring(-0.03, 0.108, half_hips * 1.62, -0.012, 2.4),
        Ring(0.05, 0.106, half_hips * 1.60, -0.010, 2.4),
        Ring(0.32 * height, 0.098, chest * 0.82, 0.0, 2.4),
        Ring(0.55 * height, 0.112, chest * 0.93, 0.0, 2.4),
        Ring(0.74 * height, 0.118, chest * 1.02, -0.005, 2.5),
        Ring(0.87 * height, 0.104, chest * 1.08, -0.016, 2.4),
        Ring(0.935 * height, 0.088, chest * 1.04, -0.022, 2.2),
        Ring(0.985 * height, 0.072, chest * 0.82, -0.026, 2.0),
        Ring(1.03 * height, 0.060, chest * 0.52, -0.022, 2.0),
        Ring(1.07 * height, 0.056, chest * 0.36, -0.014, 2.0),
    ]
    shirt = [ring for ring in rings if ring.height_m > 0.0]
    hips = [ring for ring in rings if ring.height_m < 0.10]
    return [
        BodyPart("chest", SHIRT, lofted([Ring(0.01, 0.112, half_hips * 1.66, -0.012, 2.4), *shirt]), _trunk_pose),
        BodyPart("hips", TROUSERS, lofted(hips), _trunk_pose),
    ]


def _head(length: Callable[[str, str], float]) -> list[BodyPart]:
    neck = length("neck", "head") + 0.02
    return [
        BodyPart("neck", SKIN, tapered_limb(neck, 0.056, 0.050), lambda at: _along(at["neck"], at["head"], _left(at))),
        BodyPart("head", SKIN, _skull(), _head_pose),
        BodyPart("nose", SKIN, ellipsoid(0.020, 0.013, 0.022), lambda at: _beside(_head_pose(at), (0.092, 0.0, 0.042))),
        BodyPart(
            "left_eye", EYES, ellipsoid(0.007, 0.009, 0.010), lambda at: _beside(_head_pose(at), (0.086, 0.031, 0.060))
        ),
        BodyPart(
            "right_eye",
            EYES,
            ellipsoid(0.007, 0.009, 0.010),
            lambda at: _beside(_head_pose(at), (0.086, -0.031, 0.060)),
        ),
        BodyPart("hair", HAIR, ellipsoid(0.108, 0.088, 0.098, -0.05), _hair_pose),
    ]


def _skull() -> Surface:
    """Chin to crown along z; the face looks along x."""
    return lofted(
        [
            Ring(-0.078, 0.012, 0.012, 0.052),
            Ring(-0.074, 0.028, 0.028, 0.048),
            Ring(-0.055, 0.055, 0.048, 0.030),
            Ring(-0.025, 0.078, 0.062, 0.014),
            Ring(0.010, 0.091, 0.071, 0.004),
            Ring(0.050, 0.098, 0.077, -0.002),
            Ring(0.090, 0.097, 0.077, -0.006),
            Ring(0.120, 0.086, 0.068, -0.008),
            Ring(0.143, 0.062, 0.049, -0.009),
            Ring(0.155, 0.030, 0.024, -0.010),
            Ring(0.157, 0.008, 0.007, -0.010),
        ]
    )


def _arm(side: str, length: Callable[[str, str], float]) -> list[BodyPart]:
    shoulder, elbow, wrist, hand = (f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist", "hand"))
    upper = tapered_limb(length(shoulder, elbow), 0.052, 0.044)
    sleeve = tapered_limb(length(shoulder, elbow) * 0.52, 0.063, 0.058)
    fore = tapered_limb(length(elbow, wrist), 0.044, 0.029, bulge=0.25)
    palm = max(length(wrist, hand), 0.05)
    fingers = _fist(palm) if length(hand, f"{hand}_tip") < LONGEST_FIST_M else _hand(palm)
    return [
        BodyPart(f"{side}_sleeve", SHIRT, sleeve, lambda at: _upper_arm_pose(at, side)),
        BodyPart(f"{side}_upper_arm", SKIN, upper, lambda at: _upper_arm_pose(at, side)),
        BodyPart(f"{side}_forearm", SKIN, fore, lambda at: _along(at[elbow], at[wrist], _left(at))),
        BodyPart(f"{side}_hand", SKIN, fingers, lambda at: _along(at[wrist], at[hand], _left(at))),
        BodyPart(f"{side}_thumb", SKIN, tapered_limb(0.055, 0.015, 0.011), lambda at: _thumb_pose(at, side)),
    ]


def _hand(palm_m: float) -> Surface:
    """Palm and closed fingers along z, flat across y."""
    reach = palm_m + 0.085
    shares = ((0.0, 0.5, 0.9), (0.10, 0.75, 1.0), (0.35, 1.0, 1.0), (0.60, 1.0, 0.9), (0.85, 0.85, 0.75))
    rings = [Ring(share * reach, 0.043 * wide, 0.022 * thick, 0.0, 2.6) for share, wide, thick in shares]
    tips = [Ring(0.96 * reach, 0.026, 0.011), Ring(reach, 0.008, 0.004)]
    return lofted([Ring(-0.006, 0.012, 0.012), *rings, *tips])


def _fist(palm_m: float) -> Surface:
    """Palm and bent fingers along z."""
    shares = ((0.0, 0.5, 0.5), (0.15, 0.75, 0.8), (0.45, 1.0, 1.0), (0.75, 1.05, 1.1), (0.93, 0.9, 0.95))
    rings = [Ring(share * (palm_m + 0.035), 0.042 * wide, 0.036 * thick, 0.0, 2.6) for share, wide, thick in shares]
    return lofted([Ring(-0.006, 0.012, 0.012), *rings, Ring(palm_m + 0.035, 0.018, 0.016)])


def _leg(side: str, length: Callable[[str, str], float]) -> list[BodyPart]:
    hip, knee, ankle, foot = (f"{side}_{joint}" for joint in ("hip", "knee", "ankle", "foot"))
    thigh = tapered_limb(length(hip, knee), 0.088, 0.062)
    shin = tapered_limb(length(knee, ankle), 0.062, 0.046, bulge=0.25)
    sole = lofted(
        [
            Ring(-0.075, 0.020, 0.020, 0.012, 2.6),
            Ring(-0.062, 0.043, 0.038, 0.010, 2.6),
            Ring(0.020, 0.052, 0.043, 0.012, 2.6),
            Ring(0.100, 0.038, 0.048, -0.006, 2.6),
            Ring(0.165, 0.026, 0.044, -0.020, 2.6),
            Ring(0.190, 0.012, 0.024, -0.026, 2.6),
        ]
    )
    return [
        BodyPart(f"{side}_thigh", TROUSERS, thigh, lambda at: _along(at[hip], at[knee], _left(at))),
        BodyPart(f"{side}_shin", TROUSERS, shin, lambda at: _along(at[knee], at[ankle], _left(at))),
        BodyPart(f"{side}_shoe", SHOES, sole, lambda at: _shoe_pose(at[ankle], at[foot])),
    ]


def _left(at: Places) -> FloatArray:
    across = at["left_shoulder"] - at["right_shoulder"]
    return across / max(float(np.linalg.norm(across)), 1e-9)


def _along(start: FloatArray, end: FloatArray, sideways: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A frame at `start` with z towards `end` and y as near to `sideways` as can be."""
    z = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
    y = sideways - (sideways @ z) * z
    if np.linalg.norm(y) < 0.1:
        y = np.cross(z, (1.0, 0.0, 0.0))
    y = y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], axis=1), start


def _beside(pose: tuple[FloatArray, FloatArray], offset_m: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    return pose[0], pose[1] + pose[0] @ np.asarray(offset_m)


def _trunk_pose(at: Places) -> tuple[FloatArray, FloatArray]:
    return _along(at["pelvis"], at["neck"], _left(at))


def _head_pose(at: Places) -> tuple[FloatArray, FloatArray]:
    rotation, _ = _trunk_pose(at)
    return rotation, at["head"]


def _hair_pose(at: Places) -> tuple[FloatArray, FloatArray]:
    """A cap on the back of the head, leaving the forehead free."""
    rotation, position = _beside(_head_pose(at), (-0.012, 0.0, 0.075))
    tilt = np.radians(-26.0)
    back = np.array([[np.cos(tilt), 0.0, np.sin(tilt)], [0.0, 1.0, 0.0], [-np.sin(tilt), 0.0, np.cos(tilt)]])
    return rotation @ back, position


def _upper_arm_pose(at: Places, side: str) -> tuple[FloatArray, FloatArray]:
    """From a little below and inside the shoulder's joint, under the slope of the shirt, to the elbow."""
    shoulder = at[f"{side}_shoulder"]
    inside = shoulder + 0.08 * (at["neck"] - shoulder) * (1.0, 1.0, 0.0) - (0.0, 0.0, 0.012)
    return _along(inside, at[f"{side}_elbow"], _left(at))


def _thumb_pose(at: Places, side: str) -> tuple[FloatArray, FloatArray]:
    """The thumb leaves the palm upwards of the hand's flat side."""
    rotation, position = _along(at[f"{side}_wrist"], at[f"{side}_hand"], _left(at))
    root = position + rotation @ np.array([-0.026, 0.0, 0.030])
    return _along(root, root + rotation @ np.array([-0.75, 0.0, 1.0]), rotation[:, 1])


def _shoe_pose(ankle: FloatArray, toes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The sole level, its length towards the toes, its x up."""
    forward = (toes - ankle) * (1.0, 1.0, 0.0)
    forward = forward / max(float(np.linalg.norm(forward)), 1e-9)
    up = np.array([0.0, 0.0, 1.0])
    return np.stack([up, np.cross(forward, up), forward], axis=1), ankle - (0.0, 0.0, 0.03)

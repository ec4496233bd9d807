# SPDX-License-Identifier: Apache-2.0
"""Which joints of a frame can be believed: present, finite, in range, seen, on bones that a human may have.

Joints of one frame are a handful of numbers, for which plain Python is several times faster than NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

from mild_core.errors import DataError
from mild_core.signals import SkeletonFrame

Point = tuple[float, float, float]

FARTHEST_M = 50.0
"""No tracker sees a person beyond this; a tracker that publishes millimetres does so at once."""

HUMAN_BONE_M = (0.05, 0.8)
"""An arm segment outside of this range is no arm's: a joint elsewhere, or two in one place, which have no direction."""

LEAP_RAD, LEAP_RAD_S = 0.6, 15.0
"""A bone of another length than calibrated is a tracker's glitch where it has also turned by more than the first and
this speed allow. Trackers stretch what points at them, and lengths say nothing of directions. Sources: 25 mm of jitter
turns a bone of 0.25 m by up to 0.5 rad from one frame to the next; the elbow of a tennis serve extends by 21 rad/s
(Fleisig et al., Sports Biomechanics 2003), greetings stay below 10."""

STAND_INS = {"hand": "wrist", "wrist": "hand"}
"""Trackers with one of the two: segments are scaled to the model's lengths, so only their direction counts."""


UNSEEN: Point = (math.nan, math.nan, math.nan)
"""Where a joint is that was not seen."""


class Body(NamedTuple):
    """One frame of a person as plain numbers, taken out of the arrays once.

    Attributes:
        frame: The person.
        points: Position [m] of each joint.
        confidence: Of each joint.
        places: Index of each joint's name, and of the names that it stands in for.
    """

    frame: SkeletonFrame
    points: list[list[float]]
    confidence: list[float]
    places: Mapping[str, int]


def body_of(frame: SkeletonFrame) -> Body:
    """The plain numbers of a frame."""
    return Body(frame, frame.positions_m.tolist(), frame.confidence.tolist(), places_of(frame.joint_names))


@lru_cache(maxsize=256)
def places_of(names: tuple[str, ...]) -> Mapping[str, int]:
    """Index of each joint of a skeleton, and of what these stand in for; trackers name the same joints every time.

    Source: `STAND_INS`.
    """
    places = {name: place for place, name in reversed(list(enumerate(names)))}
    for side in ("left", "right"):
        for part, other in STAND_INS.items():
            if f"{side}_{other}" in names:
                places.setdefault(f"{side}_{part}", names.index(f"{side}_{other}"))
    return places


def usable(point: Sequence[float]) -> bool:
    """Whether a position [m] is finite, in range and not the exact zero that trackers give for a lost joint."""
    x, y, z = point
    far = FARTHEST_M
    # Written so that NaN fails: every comparison with it is false.
    return -far < x < far and -far < y < far and -far < z < far and (x != 0.0 or y != 0.0 or z != 0.0)


def seen_joint(body: Body, name: str) -> Point | None:
    """Position [m] of a joint in the frame's axes; None when it is missing or not usable."""
    place = body.places.get(name)
    if place is None or not usable(body.points[place]):
        return None
    x, y, z = body.points[place]
    return x, y, z


def believed(body: Body, names: Sequence[str], min_confidence: float, zero_root_allowed: bool = False) -> list[Point]:
    """Positions [m] of joints, in the order of `names`, when each of them can be believed.

    Args:
        body: The person.
        names: Joints that are needed.
        min_confidence: The least confidence of each, 0 to 1.
        zero_root_allowed: The first joint may lie at the origin of the axes exactly.

    Raises:
        DataError: `missing_joint`, `not_finite`, `out_of_range`, `zeroed` or `low_confidence`, with the joint.
    """
    points: list[Point] = []
    for name in names:
        place = body.places.get(name)
        if place is None:
            raise DataError("missing_joint", f"the skeleton has no {name}")
        x, y, z = point = body.points[place]
        if not usable(point) and not (zero_root_allowed and not points and x == y == z == 0.0):
            raise _unusable(name, (x, y, z))
        if not body.confidence[place] >= min_confidence:
            raise DataError("low_confidence", f"{name} has {body.confidence[place]:.2f}, needs {min_confidence:.2f}")
        points.append((x, y, z))
    return points


def believed_place(body: Body, name: str, min_confidence: float) -> Point:
    """Position [m] of one joint that may be missing: `UNSEEN` when it is, or cannot be believed."""
    place = body.places.get(name)
    if place is None or not body.confidence[place] >= min_confidence or not usable(body.points[place]):
        return UNSEEN
    x, y, z = body.points[place]
    return x, y, z


def middle(one: Point, other: Point) -> Point:
    """Half way between two places; not a number when one of them was not seen."""
    (ax, ay, az), (bx, by, bz) = one, other
    return (ax + bx) / 2.0, (ay + by) / 2.0, (az + bz) / 2.0


def bone_lengths(points: Sequence[Point]) -> tuple[float, ...]:
    """Lengths [m] from each joint of a chain to its next."""
    return tuple(math.dist(start, end) for start, end in pairwise(points))


def check_bones(lengths: Sequence[float]) -> None:
    """Raise DataError `bone_length` when a bone [m] is of a length that no human has."""
    low, high = HUMAN_BONE_M
    for index, length in enumerate(lengths):
        if not low <= length <= high:
            seen = f"bone {index} is {length:.3f} m, should be {low:.3f} to {high:.3f}"
            raise DataError("bone_length", f"{seen}: are these metres, and the joints in this order?")


def fits(length: float, calibrated: float, tolerance: float) -> bool:
    """Whether a bone is as long as it was calibrated, but for a relative deviation."""
    return calibrated * (1.0 - tolerance) <= length <= calibrated * (1.0 + tolerance)


def check_leaps(
    points: Sequence[Point],
    before: Sequence[Point],
    elapsed_s: float,
    calibrated: Sequence[float],
    tolerance: float,
) -> None:
    """Raise DataError `bone_length` when a bone is of another length and has turned faster than an arm can.

    A length alone condemns nothing: models use directions only.

    Args:
        points: J places of the arm [m].
        before: The same of an earlier frame, in the same axes.
        elapsed_s: Since then.
        calibrated: J - 1 lengths [m].
        tolerance: Largest relative deviation of a length that needs no second look.

    Raises:
        DataError: `bone_length`.
    """
    bones = zip(pairwise(points), pairwise(before), calibrated, strict=True)
    for index, ((start, end), (old_start, old_end), length) in enumerate(bones):
        measured = math.dist(start, end)
        if fits(measured, length, tolerance):
            continue
        along = sum((b - a) * (d - c) for a, b, c, d in zip(start, end, old_start, old_end, strict=True))
        both = measured * math.dist(old_start, old_end)
        turned = math.acos(min(max(along / both, -1.0), 1.0)) if both > 0.0 else 0.0
        if turned > LEAP_RAD + LEAP_RAD_S * elapsed_s:
            seen = f"bone {index} is {measured:.3f} m instead of {length:.3f}"
            raise DataError("bone_length", f"{seen} and has turned by {math.degrees(turned):.0f} degrees")


def _unusable(name: str, point: Point) -> DataError:
    if not all(map(math.isfinite, point)):
        return DataError("not_finite", f"{name} is at {point}")
    if point == (0.0, 0.0, 0.0):
        return DataError("zeroed", f"{name} is at exactly zero: the tracker lost it")
    return DataError("out_of_range", f"{name} is at {point} m: are these millimetres?")

# SPDX-License-Identifier: Apache-2.0
"""Which joints of a frame can be believed: present, finite, in range, seen, on bones of a constant length.

Joints of one frame are a handful of numbers, for which plain Python is several times faster than NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from mild_core.errors import DataError
from mild_core.signals import SkeletonFrame

Point = tuple[float, float, float]

FARTHEST_M = 50.0
"""No tracker sees a person beyond this; a tracker that publishes millimetres does so at once."""

HUMAN_BONE_M = (0.05, 0.8)
"""Before calibration, an arm segment outside of this range is no arm's."""

STAND_INS = {"hand": "wrist", "wrist": "hand"}
"""Trackers with one of the two: segments are scaled to the model's lengths, so only their direction counts."""


def place_of(names: tuple[str, ...], name: str) -> int:
    """Index of a joint or of the one that stands in for it, -1 when the skeleton has neither.

    Source: `STAND_INS`.
    """
    if name in names:
        return names.index(name)
    side, _, part = name.partition("_")
    stand_in = f"{side}_{STAND_INS.get(part, part)}"
    return names.index(stand_in) if stand_in in names else -1


def usable(point: Sequence[float]) -> bool:
    """Whether a position [m] is finite, in range and not the exact zero that trackers give for a lost joint."""
    x, y, z = point
    far = FARTHEST_M
    # Written so that NaN fails: every comparison with it is false.
    return -far < x < far and -far < y < far and -far < z < far and (x != 0.0 or y != 0.0 or z != 0.0)


def seen_joint(frame: SkeletonFrame, name: str) -> Point | None:
    """Position [m] of a joint in the frame's axes; None when it is missing or not usable."""
    if name not in frame.joint_names:
        return None
    x, y, z = frame.positions_m[frame.joint_names.index(name)].tolist()
    return (x, y, z) if usable((x, y, z)) else None


def believed(
    frame: SkeletonFrame, names: Sequence[str], min_confidence: float, zero_root_allowed: bool = False
) -> list[Point]:
    """Positions [m] of joints, in the order of `names`, when each of them can be believed.

    Args:
        frame: The person.
        names: Joints that are needed.
        min_confidence: The least confidence of each, 0 to 1.
        zero_root_allowed: The first joint may lie at the origin of the axes exactly.

    Raises:
        DataError: `missing_joint`, `not_finite`, `out_of_range`, `zeroed` or `low_confidence`, with the joint.
    """
    positions, confidence = frame.positions_m, frame.confidence
    points: list[Point] = []
    for name in names:
        place = place_of(frame.joint_names, name)
        if place < 0:
            raise DataError("missing_joint", f"the skeleton has no {name}")
        x, y, z = positions[place].tolist()
        if not usable((x, y, z)) and not (zero_root_allowed and not points and x == y == z == 0.0):
            raise _unusable(name, (x, y, z))
        if not confidence[place] >= min_confidence:
            raise DataError("low_confidence", f"{name} has {confidence[place]:.2f}, needs {min_confidence:.2f}")
        points.append((x, y, z))
    return points


def bone_lengths(points: Sequence[Point]) -> tuple[float, ...]:
    """Lengths [m] from each joint of a chain to its next."""
    return tuple(math.dist(start, end) for start, end in pairwise(points))


def check_bones(lengths: Sequence[float], calibrated: Sequence[float] | None, tolerance: float) -> None:
    """Raise DataError `bone_length` when a bone is not as long as it was, or as any human's before calibration.

    Args:
        lengths: Measured [m].
        calibrated: As calibrated [m]; None before that.
        tolerance: Largest relative deviation.

    Raises:
        DataError: `bone_length`.
    """
    for index, length in enumerate(lengths):
        if calibrated is None:
            low, high = HUMAN_BONE_M
        else:
            low, high = calibrated[index] * (1.0 - tolerance), calibrated[index] * (1.0 + tolerance)
        if not low <= length <= high:
            doubt = "" if calibrated else ": are these metres, and the joints in this order?"
            seen = f"bone {index} is {length:.3f} m, should be {low:.3f} to {high:.3f}"
            raise DataError("bone_length", seen + doubt)


def _unusable(name: str, point: Point) -> DataError:
    if not all(map(math.isfinite, point)):
        return DataError("not_finite", f"{name} is at {point}")
    if point == (0.0, 0.0, 0.0):
        return DataError("zeroed", f"{name} is at exactly zero: the tracker lost it")
    return DataError("out_of_range", f"{name} is at {point} m: are these millimetres?")

# SPDX-License-Identifier: Apache-2.0
"""The canonical arm, a right one with the model's bones for every person, and whether it is still the same person's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.perception.calibration import Calibration
from mild_core.shapes import FloatArray, require_shape

_MIRRORED = np.array([1.0, -1.0, 1.0])
_SHORTEST_M = 1e-6


def in_arm_frame(positions_m: FloatArray, calibration: Calibration) -> FloatArray:
    """Joints in the arm frame; a left arm becomes the right arm of the mirrored person.

    Args:
        positions_m: (..., 3) in the axes of the calibration's frame.
        calibration: Of the person.
    """
    positions: FloatArray = (positions_m - calibration.shoulder_m) @ calibration.arm_from_source.T
    return positions if calibration.side == "right" else positions * _MIRRORED


def with_bone_lengths(arm_m: FloatArray, bone_lengths_m: tuple[float, ...]) -> FloatArray:
    """The same directions on bones of given lengths; the shoulder stays where it is.

    Each segment gets exactly the model's length in every frame, rather than one ratio for all frames: bones do not
    change, but an Azure Kinect's skeleton breathes by +-11 % and depth cameras stretch what points at them, and the
    recordings that models learn from have constant lengths. With a rigid skeleton both are the same. The way of
    the shoulder is not scaled: it is the body's motion in the room and not the arm's size.

    Args:
        arm_m: (T, J, 3), from the shoulder outwards.
        bone_lengths_m: J - 1 lengths; empty leaves the arm as it is.

    Returns:
        (T, J, 3) [m].
    """
    if not bone_lengths_m:
        return arm_m
    require_shape("arm_m", arm_m, (None, len(bone_lengths_m) + 1, 3))
    placed: list[float] = []
    for joints in arm_m.tolist():  # a few numbers a frame, for which plain Python is five times faster than NumPy
        before = joints[0]
        x, y, z = before
        placed += before
        for here, length in zip(joints[1:], bone_lengths_m, strict=True):
            along, left, up = here[0] - before[0], here[1] - before[1], here[2] - before[2]
            ratio = length / max(math.sqrt(along * along + left * left + up * up), _SHORTEST_M)
            x, y, z = x + along * ratio, y + left * ratio, z + up * ratio
            placed += x, y, z
            before = here
    return np.array(placed).reshape(arm_m.shape)


AVERAGED_S = 1.0
"""Time constant of the mean lengths: trackers stretch a bone for a moment, and jitter."""


@dataclass(frozen=True)
class BoneFit:
    """How the watched arm has lately compared with the calibrated one.

    Attributes:
        stamp_ns: Of the newest frame.
        lengths_m: Running mean of the J - 1 bones' lengths.
        misfit_since_ns: Since when all of them are too long, or all too short; None while one fits.
    """

    stamp_ns: int
    lengths_m: tuple[float, ...]
    misfit_since_ns: int | None = None

    @property
    def misfit_ns(self) -> int:
        """How long this may have been another person's arm."""
        return 0 if self.misfit_since_ns is None else self.stamp_ns - self.misfit_since_ns


def bone_fit(
    before: BoneFit | None, stamp_ns: int, lengths_m: tuple[float, ...], calibrated_m: Sequence[float], tolerance: float
) -> BoneFit:
    """The comparison after one more frame.

    Args:
        before: The one before it; None at the first.
        stamp_ns: Of the frame.
        lengths_m: J - 1 lengths in it.
        calibrated_m: J - 1 lengths of the calibrated person.
        tolerance: Largest relative deviation of their own.
    """
    if before is not None:
        share = 1.0 - math.exp(-max(stamp_ns - before.stamp_ns, 0) * 1e-9 / AVERAGED_S)
        pairs = zip(before.lengths_m, lengths_m, strict=True)
        lengths_m = tuple([old + share * (new - old) for old, new in pairs])
    ratios = [mean / length for mean, length in zip(lengths_m, calibrated_m, strict=True)]
    if not (min(ratios) > 1.0 + tolerance or max(ratios) < 1.0 - tolerance):
        return BoneFit(stamp_ns, lengths_m)
    since_ns = None if before is None else before.misfit_since_ns
    return BoneFit(stamp_ns, lengths_m, stamp_ns if since_ns is None else since_ns)

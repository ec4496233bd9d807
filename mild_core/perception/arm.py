# SPDX-License-Identifier: Apache-2.0
"""The canonical arm: for every person and place, a right arm in the model's frame with the model's bone lengths."""

from __future__ import annotations

import math

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

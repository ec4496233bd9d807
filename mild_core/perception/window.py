# SPDX-License-Identifier: Apache-2.0
"""The last W frames of the arm as the features a model was trained on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mild_core.perception.arm import with_bone_lengths
from mild_core.perception.resampling import Grid, resample
from mild_core.perception.settings import PerceptionSettings
from mild_core.shapes import FloatArray


@dataclass(frozen=True, eq=False)
class ArmStream:
    """An arm without a break longer than may be bridged.

    Attributes:
        grid: Where resampling stands; joints are in the arm frame with the person's own bones.
        rows: (W, D) the newest window, read-only.
    """

    grid: Grid
    rows: FloatArray


Row = tuple[int, FloatArray]
"""Stamp [ns] of a window's newest row, and the window (W, D)."""


def start(stamp_ns: int, arm_m: FloatArray, settings: PerceptionSettings) -> tuple[ArmStream, list[Row]]:
    """The stream of which this frame is grid point 0.

    Its window repeats this frame, the person being at rest, so that the robot can answer from the start.

    Args:
        stamp_ns: Of the frame.
        arm_m: (J, 3) in the arm frame.
        settings: Of the window.
    """
    row = with_bone_lengths(arm_m[None], settings.bone_lengths_m).ravel()
    if settings.features == "positions_velocities":
        row = np.concatenate([row, np.zeros_like(row)])
    rows = np.tile(row, (settings.window, 1))
    rows.flags.writeable = False
    return ArmStream(Grid(stamp_ns, 1, stamp_ns, arm_m), rows), [(stamp_ns, rows)]


def extend(
    stream: ArmStream, stamp_ns: int, arm_m: FloatArray, settings: PerceptionSettings
) -> tuple[ArmStream, list[Row]]:
    """The stream after one more frame, and the windows that it completes, oldest first.

    Args:
        stream: Before it.
        stamp_ns: Later than the newest frame.
        arm_m: (J, 3) in the arm frame.
        settings: Of the window.
    """
    grid, stamps, points = resample(stream.grid, stamp_ns, arm_m, settings.rate_hz)
    rows, made = stream.rows, []
    for stamp, positions in zip(stamps, with_bone_lengths(points, settings.bone_lengths_m), strict=True):
        rows = pushed(rows, positions, settings.rate_hz)
        made.append((stamp, rows))
    return ArmStream(grid, rows), made


def pushed(rows: FloatArray, positions_m: FloatArray, rate_hz: float) -> FloatArray:
    """(W, D) read-only after one more frame: the oldest row leaves.

    Args:
        rows: (W, D) before.
        positions_m: (J, 3) the new frame, one period later.
        rate_hz: Of the rows. A velocity [m/s] is the difference to the row before times this.
    """
    size = positions_m.size
    after = np.empty_like(rows)
    after[:-1] = rows[1:]
    after[-1, :size] = positions_m.ravel()
    if rows.shape[1] > size:
        after[-1, size:] = (after[-1, :size] - rows[-1, :size]) * rate_hz
    after.flags.writeable = False
    return after

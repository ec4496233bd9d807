# SPDX-License-Identifier: Apache-2.0
"""From a tracker's frames, whenever they come, to the model's even rate.

A time grid starts at the first usable frame. Each frame fills all grid points up to its stamp by linear
interpolation from the frame before. A frame just short of a grid point fills that point too: with a tracker at the
model's rate whose stamps jitter, each message then gives one window, and none waits for the next message.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mild_core.shapes import FloatArray

SNAP = 0.2
"""How far short of a grid point a frame may be, in periods of the grid or of the tracker, whichever is shorter: a
tracker faster than the model shows the grid point itself soon."""

GAP_INTERVALS = 1.5
"""More tracker intervals than this between two frames: one in between was lost."""

FLOOD_NS = 2_000_000
"""No tracker sees a person twice within this time: in a flood of messages, gaps cannot be detected."""

_RISE, _FALL = 0.05, 0.10
"""Most that one interval may change the estimate: losses lengthen intervals, nothing shortens them."""


@dataclass(frozen=True)
class FrameRateEstimator:
    """How often the tracker sees the person.

    Attributes:
        stamp_ns: Of the newest frame, usable or not.
        interval_ns: Estimated time between frames; 0 before the second.
        absent: Messages without the person since.
    """

    stamp_ns: int
    interval_ns: float = 0.0
    absent: int = 0

    def after(self, stamp_ns: int) -> tuple[FrameRateEstimator, int]:
        """The cadence after a frame, and how many messages before it never came, judged from the stamps."""
        interval = stamp_ns - self.stamp_ns
        if 0 < interval < FLOOD_NS:
            return FrameRateEstimator(stamp_ns), 0
        if self.interval_ns == 0.0:
            return FrameRateEstimator(stamp_ns, float(interval)), 0
        missed = max(0, round(interval / self.interval_ns) - 1 - self.absent)
        low, high = self.interval_ns * (1.0 - _FALL), self.interval_ns * (1.0 + _RISE)
        return FrameRateEstimator(stamp_ns, min(max(interval, low), high)), missed

    def is_gap(self, interval_ns: int) -> bool:
        """Whether a frame is missing in a span between two usable frames."""
        return self.interval_ns > 0.0 and interval_ns > GAP_INTERVALS * self.interval_ns


@dataclass(frozen=True, eq=False)
class Grid:
    """Where resampling stands.

    Attributes:
        anchor_ns: Grid point 0.
        next_index: First grid point not yet filled.
        sample_ns: Stamp of the newest frame.
        sample_m: (J, 3) its joints.
    """

    anchor_ns: int
    next_index: int
    sample_ns: int
    sample_m: FloatArray


def resample(grid: Grid, stamp_ns: int, sample_m: FloatArray, rate_hz: float) -> tuple[Grid, list[int], FloatArray]:
    """Fill the grid up to a new frame.

    Args:
        grid: Before it.
        stamp_ns: Later than the newest frame.
        sample_m: (J, 3) its joints.
        rate_hz: Of the grid.

    Returns:
        The grid after it; the stamps of the N new points, of which the last is the frame's own when it snapped;
        and (N, J, 3) their joints. N is often 1, and 0 for a frame that comes before the next grid point.
    """
    period, interval = 1e9 / rate_hz, stamp_ns - grid.sample_ns
    snap = SNAP * min(period, interval)
    last = math.floor((stamp_ns - grid.anchor_ns + snap) / period)
    stamps = [min(grid.anchor_ns + round(index * period), stamp_ns) for index in range(grid.next_index, last + 1)]
    if len(stamps) == 1 and stamps[0] == stamp_ns:
        points = sample_m[None]
    else:
        weights = np.array([(stamp - grid.sample_ns) / interval for stamp in stamps])[:, None, None]
        points = grid.sample_m + weights * (sample_m - grid.sample_m)
    return Grid(grid.anchor_ns, max(grid.next_index, last + 1), stamp_ns, sample_m), stamps, points

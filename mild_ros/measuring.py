# SPDX-License-Identifier: Apache-2.0
"""What a node measures of itself between two reports: how many, how long, how many were lost on the way to it."""

from __future__ import annotations

from collections import deque
from statistics import median

import numpy as np


class Spread:
    """Times of the last interval [ns], told as p50, p99 and max."""

    def __init__(self) -> None:
        self._values_ns: list[int] = []

    def add(self, value_ns: int) -> None:
        """One more."""
        self._values_ns.append(value_ns)

    def take_ms(self) -> tuple[float, float, float] | None:
        """(p50, p99, max) [ms] of what was added since the last call; None when that is nothing."""
        if not self._values_ns:
            return None
        p50, p99, greatest = np.percentile(self._values_ns, [50, 99, 100]) * 1e-6
        self._values_ns = []
        return float(p50), float(p99), float(greatest)


class GapWatch:
    """Tells from gaps between stamps how many messages never came: DDS fires no event for them.

    A gap counts when it is longer than one and a half times the median of the last intervals. One longer than
    `pause_ns` is a pause of the sender, not a loss.

    Args:
        pause_ns: Longest gap that can be a loss.
    """

    _REMEMBERED = 31
    _ENOUGH = 5
    _TOO_LONG = 1.5

    def __init__(self, pause_ns: int = 1_000_000_000) -> None:
        self._pause_ns = pause_ns
        self._newest_ns: int | None = None
        self._intervals_ns: deque[int] = deque(maxlen=self._REMEMBERED)

    def lost_before(self, stamp_ns: int) -> int:
        """How many messages seem to be missing between the one before and this one."""
        newest_ns, self._newest_ns = self._newest_ns, stamp_ns
        if newest_ns is None or not 0 < stamp_ns - newest_ns <= self._pause_ns:
            return 0
        interval_ns = stamp_ns - newest_ns
        usual_ns = median(self._intervals_ns) if len(self._intervals_ns) >= self._ENOUGH else interval_ns
        self._intervals_ns.append(interval_ns)
        return round(interval_ns / usual_ns) - 1 if interval_ns > self._TOO_LONG * usual_ns else 0


class Stream:
    """One topic that comes in or goes out.

    Attributes:
        count: Messages since the start.
        lost: Messages that seem to be missing, from gaps in stamps.
        newest_s: When the newest one came, on a steady clock; None before the first.
    """

    def __init__(self) -> None:
        self.count = 0
        self.lost = 0
        self.newest_s: float | None = None
        self._reported = 0
        self._gaps = GapWatch()

    def add(self, steady_s: float, stamp_ns: int | None = None) -> None:
        """One more message; without a stamp no loss can be told."""
        self.count += 1
        self.newest_s = steady_s
        if stamp_ns is not None:
            self.lost += self._gaps.lost_before(stamp_ns)

    def take_rate_hz(self, elapsed_s: float) -> float:
        """Messages per second since the last call, `elapsed_s` ago."""
        new, self._reported = self.count - self._reported, self.count
        return new / elapsed_s if elapsed_s > 0.0 else 0.0

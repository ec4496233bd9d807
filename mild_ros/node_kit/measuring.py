# SPDX-License-Identifier: Apache-2.0
"""What a node measures of itself between two reports: how many, how long, how many were lost on the way to it."""

from __future__ import annotations

import numpy as np


class Spread:
    """Times of the last interval [ns], reported as p50, p99 and max."""

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


class Stream:
    """One topic that comes in or goes out.

    Attributes:
        count: Messages since the start.
        lost: Messages that never came, or that newer ones took the place of before they could be taken.
        newest_s: When the newest one came, on a steady clock; None before the first.
    """

    def __init__(self) -> None:
        self.count = 0
        self.lost = 0
        self.newest_s: float | None = None
        self._reported = 0

    def add(self, steady_s: float) -> None:
        """One more message."""
        self.count += 1
        self.newest_s = steady_s

    def take_rate_hz(self, elapsed_s: float) -> float:
        """Messages per second since the last call, `elapsed_s` ago."""
        new, self._reported = self.count - self._reported, self.count
        return new / elapsed_s if elapsed_s > 0.0 else 0.0

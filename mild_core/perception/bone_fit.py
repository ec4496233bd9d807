# SPDX-License-Identifier: Apache-2.0
"""Whether the calibrated person is still the one who is seen: by bones that are all too long or too short for long."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

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

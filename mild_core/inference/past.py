# SPDX-License-Identifier: Apache-2.0
"""Where the arm has been: means of its joints' positions that fade with time, whatever the length of a window.

A window of a sixth of a second hardly shows whether a raised hand is going up, waits or comes back; where the hand has
been in the last seconds does. Nothing of it is learned, so it cannot be learned wrongly from few trials.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mild_core.shapes import FloatArray, read_only


def kept_per_frame(past_s: Sequence[float], rate_hz: float) -> FloatArray:
    """(T,) share of a mean that is left from one frame to the next.

    Args:
        past_s: Time constants [s].
        rate_hz: Of the frames.
    """
    return read_only(np.exp(-1.0 / (np.asarray(past_s, dtype=np.float64) * rate_hz)))


def fade(before: FloatArray | None, positions: FloatArray, kept: FloatArray, passed: int = 1) -> FloatArray:
    """Take one frame.

    Args:
        before: (T, 3 J) the means before it; None: it is the first.
        positions: (3 J,) the newest frame [m].
        kept: (T,) see `kept_per_frame`.
        passed: Frames since the last one; those that were missed count as the newest.

    Returns:
        (T, 3 J) the means with it [m].
    """
    if before is None:
        return read_only(np.tile(positions, (len(kept), 1)))
    left = (kept**passed)[:, None]
    return read_only(left * before + (1.0 - left) * positions)

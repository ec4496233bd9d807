# SPDX-License-Identifier: Apache-2.0
"""Whose clock the stamps in a bag are of: a tracker stamps with its own, and the recorder notes when a message came.

Stamps are more even than receipts, so they are kept where they can be: as they are when they are of the recorder's
clock, moved by the typical delay when their clock is another one, and not at all when they jump about.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from mild_core.perception.skeletons import SkeletonSource
from mild_ros.bag.people import people_in_bag
from mild_ros.bag.reader import BagReader

EARLIEST_S, LATEST_S = -0.1, 1.0
"""How long after their stamps messages come, typically, if both clocks are the same."""

UNSTEADY_S = 0.5
"""Delays that differ by more are none: those stamps are no times of measuring."""

JUDGED, LOOKED_AT = 100, 5000
"""Messages with people in them by which a replay judges a tracker's clock, and in how many it looks for them."""


@dataclass(frozen=True)
class Clock:
    """How the stamps of a topic become times of the recorder's clock.

    Attributes:
        shift_ns: Added to each; None takes the time of receipt.
        note: What is odd about them, for people; "" for nothing.
    """

    shift_ns: int | None
    note: str = ""

    def time_ns(self, stamp_ns: int, received_ns: int) -> int:
        """When a message was true."""
        return received_ns if self.shift_ns is None or stamp_ns == 0 else stamp_ns + self.shift_ns


def judge_clock(thing: str, received_ns: Sequence[int], stamps_ns: Sequence[int], choice: str = "auto") -> Clock:
    """What to do with the stamps of a topic.

    Args:
        thing: Whose they are, for people.
        received_ns: When its messages came.
        stamps_ns: Their stamps; 0 for none.
        choice: "header" keeps them, "bag" takes the receipts, "auto" judges.
    """
    stamped = [(got, stamp) for got, stamp in zip(received_ns, stamps_ns, strict=True) if stamp]
    if choice != "auto" or not stamped:
        return Clock(None if choice == "bag" or not stamped else 0)
    delays_s = np.subtract(*np.transpose(np.array(stamped))) * 1e-9
    low, delay_s, high = np.quantile(delays_s, [0.05, 0.5, 0.95])
    if high - low > UNSTEADY_S:
        return Clock(None, f"stamps of {thing} jump about by {high - low:.1f} s: the times of receipt are taken")
    if EARLIEST_S <= delay_s <= LATEST_S:
        return Clock(0)
    return Clock(round(delay_s * 1e9), f"the clock of {thing} is {delay_s:.1f} s off the recorder's: moved")


def tracker_clock(bag: BagReader, source: SkeletonSource, topic: str = "") -> Clock:
    """The clock of a bag's tracker, by the begin of the bag.

    Args:
        bag: The bag.
        source: Tracker convention.
        topic: Of its skeletons; "" finds it by its type.

    Raises:
        BagError: The bag has no such topic, or breaks off.
        SetupError: The source has a topic for each joint, and none is named.
    """
    shown = (found for found in people_in_bag(bag, source, topic, LOOKED_AT) if found[1])
    stamped = [(time_ns, people[0].stamp_ns) for time_ns, people in islice(shown, JUDGED)]
    if not stamped:
        return Clock(0)
    return judge_clock("the tracker", [received for received, _ in stamped], [stamp for _, stamp in stamped])

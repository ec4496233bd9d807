# SPDX-License-Identifier: Apache-2.0
"""Two messages that belong together because their stamps are equal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mild_ros.messages.stamps import ns_from_msg


class StampPairs:
    """Waits for the other half of a pair, for as long as `depth` further pairs.

    Args:
        on_pair: Called with the left and the right message of a pair, as soon as both are there.
        on_single: Called with the stamp [ns] of a message that is given up.
        depth: Messages that may wait.
    """

    def __init__(self, on_pair: Callable[[Any, Any], None], on_single: Callable[[int], None], depth: int = 50) -> None:
        self._on_pair, self._on_single, self._depth = on_pair, on_single, depth
        self._waiting: dict[int, tuple[str, Any]] = {}

    def left(self, message: Any) -> None:
        """The left half of a pair came."""
        self._add("left", message)

    def right(self, message: Any) -> None:
        """The right half of a pair came."""
        self._add("right", message)

    def _add(self, side: str, message: Any) -> None:
        stamp_ns = ns_from_msg(message.header.stamp)
        waiting_side, other = self._waiting.get(stamp_ns, (side, None))
        if waiting_side != side:
            del self._waiting[stamp_ns]
            self._on_pair(*((message, other) if side == "left" else (other, message)))
            return
        if stamp_ns in self._waiting:
            self._on_single(stamp_ns)
        self._waiting[stamp_ns] = (side, message)
        if len(self._waiting) > self._depth:
            oldest_ns = min(self._waiting)
            del self._waiting[oldest_ns]
            self._on_single(oldest_ns)

# SPDX-License-Identifier: Apache-2.0
"""A node's time, and the ticks of its control: of the wall when live, of `/clock` alone with `use_sim_time`.

A stage takes time as an argument, so a replay gives the same commands as long as every input comes with the same
time. With `use_sim_time` the node's time is therefore the newest `/clock` message, taken in order with the other
messages, and control ticks when that passes a point of the time grid: never by itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock as RosClock
from rclpy.clock import ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from mild_ros.messages.stamps import NANOSECONDS_PER_SECOND, ns_from_msg
from mild_ros.node_kit.quality_of_service import CLOCK

if TYPE_CHECKING:
    from mild_ros.node_kit.diagnostics import Diagnostics


class ControlGrid:
    """Points of time that lie one period apart, the first at the first time it is asked about.

    Args:
        period_ns: Time between points.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._anchor_ns: int | None = None
        self._index = -1
        self._newest_ns = 0

    def due(self, now_ns: int) -> bool:
        """Whether a point has been passed since the last time that one had; a jump back starts a new grid."""
        if self._anchor_ns is None or now_ns < self._newest_ns:
            self._anchor_ns, self._index = now_ns, -1
        self._newest_ns = now_ns
        index = (now_ns - self._anchor_ns) // self._period_ns
        passed = index > self._index
        self._index = max(index, self._index)
        return passed


class NodeClock:
    """The time of a node, and the ticks that it wants.

    Args:
        node: Whose time; its `use_sim_time` decides which.
        diagnostics: Where a missing `/clock` is reported.
        on_tick: Called with now [ns] at each tick; None when the node needs none.
        rate_hz: Ticks per second.
        timer: Whether a timer of the node ticks when it is live; otherwise the owner calls it.
    """

    def __init__(
        self,
        node: Node,
        diagnostics: Diagnostics,
        on_tick: Callable[[int], None] | None = None,
        rate_hz: float = 100.0,
        timer: bool = True,
    ) -> None:
        self.simulated: bool = node.get_parameter("use_sim_time").value
        self._clock = node.get_clock()
        self._simulated_ns, self._advanced_s = 0, time.monotonic()
        self._on_tick, self._diagnostics = on_tick, diagnostics
        self._grid = ControlGrid(round(NANOSECONDS_PER_SECOND / rate_hz))
        if self.simulated:
            diagnostics.expect("/clock")
            node.create_subscription(Clock, "/clock", self._on_clock, CLOCK)
        elif on_tick is not None and timer:
            node.create_timer(1.0 / rate_hz, lambda: on_tick(self.now_ns()), clock=steady_clock())

    def now_ns(self) -> int:
        """Now; 0 before the first `/clock` message of a simulation."""
        return self._simulated_ns if self.simulated else int(self._clock.now().nanoseconds)

    def standstill_s(self) -> float:
        """For how long `/clock` has shown the same time, or nothing, on the steady clock."""
        return time.monotonic() - self._advanced_s

    def _on_clock(self, message: Any) -> None:
        self._diagnostics.flowed("/clock")
        clock_ns = ns_from_msg(message.clock)
        if clock_ns < 0:
            self._diagnostics.unreadable("/clock", "negative_time", f"{clock_ns * 1e-9:.3f} s")
            return
        if clock_ns != self._simulated_ns:
            self._simulated_ns, self._advanced_s = clock_ns, time.monotonic()
        if self._on_tick is not None and self._grid.due(self._simulated_ns):
            self._on_tick(self._simulated_ns)


def steady_clock() -> RosClock:
    """A clock that neither a simulation nor a correction of the wall clock can stop or turn back."""
    return RosClock(clock_type=ClockType.STEADY_TIME)

# SPDX-License-Identifier: Apache-2.0
"""Two ways to send a bag to nodes: in lock-step, each event after the one before is handled, or in real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial

from rclpy.clock import Clock as RosClock
from rclpy.clock import ClockType

from mild_core.errors import DataError, SetupError
from mild_ros.bags import BagReader
from mild_ros.encoding import restamped
from mild_ros.messages.handled import Handled
from mild_ros.replay import SKELETON, TICK, TRUE_MOTION, Event

FIRST = ("perception", "pipeline")
"""Stages that take skeletons: nothing that comes of one is all handled before they say so."""

MEASURED = ("measured", "joints_missing", "outside_limits")
"""Outcomes of the robot's own states, which may come from a simulation at any time."""

REPEAT_S = 0.5
"""`/clock` is best effort: a tick that nobody answers is sent again after so long."""

LONGEST_NAP_S = 0.1

Send = Callable[[str, bytes], None]


class LockStep:
    """Sends one event at a time and waits until every stage is done with all that came of it.

    A message is one token. A stage that reports n outputs takes one token and puts n; at none left all is handled.

    Args:
        events: What to send, ticks included.
        send: Publishes bytes on an input.
        tick: Publishes `/clock` [ns].
        patience_s: How long to wait for an answer.
    """

    def __init__(self, events: Iterator[Event], send: Send, tick: Callable[[int], None], patience_s: float) -> None:
        self.sent = 0
        self._events, self._send, self._tick, self._patience_s = events, send, tick, patience_s
        self._event: Event | None = None
        self._tokens = 0
        self._begun = False
        self._since_s = self._repeated_s = 0.0

    def advance(self) -> bool:
        """Send the next event; False when there is none."""
        self._event = next(self._events, None)
        while self._event is not None and self._event.input == TRUE_MOTION and self._event.message is not None:
            self._send(TRUE_MOTION, self._event.message.data)
            self._event = next(self._events, None)
        if self._event is None:
            return False
        self._tokens, self._begun = 1, self._event.input != SKELETON
        self._since_s = self._repeated_s = time.monotonic()
        self._tick(self._event.time_ns)
        if self._event.message is not None:
            self._send(self._event.input, self._event.message.data)
        self.sent += 1
        return True

    def is_done_after(self, fate: Handled) -> bool:
        """Take the fate of an input into account; whether nothing is left of the event sent last."""
        if self._event is None or not self._concerns(self._event, fate):
            return False
        self._tokens += fate.outputs - 1
        self._begun = self._begun or fate.stage in FIRST
        return self._tokens == 0 and self._begun

    def check(self) -> None:
        """Look after an event that nobody answers; to be called now and then.

        Raises:
            SetupError: For longer than `patience_s`.
        """
        now_s = time.monotonic()
        if self._event is None:
            return
        if now_s - self._since_s > self._patience_s:
            what = "tick of /clock" if self._event.input == TICK else f"message on {self._event.input}"
            raise SetupError(
                "lock-step",
                f"event {self.sent}, a {what}, was not handled within {self._patience_s:g} s",
                "start the nodes with -p report_handled:=true -p use_sim_time:=true, and one set of them only",
            )
        if self._event.input == TICK and now_s - self._repeated_s > REPEAT_S:
            self._repeated_s = now_s
            self._tick(self._event.time_ns)

    @staticmethod
    def _concerns(event: Event, fate: Handled) -> bool:
        if event.input == TICK:
            return fate.outcome == "tick" and fate.stamp_ns == event.time_ns
        if event.input == SKELETON:
            return fate.outcome != "tick" and fate.outcome not in MEASURED
        return fate.outcome != "tick" and fate.outputs == 0


def play_in_real_time(
    bag: BagReader, events: Iterator[Event], send: Send, rate: float, restamp: bool, go_on: Callable[[], bool]
) -> int:
    """Send the messages as far apart as they were recorded, divided by `rate`; returns how many.

    A restamped message carries the time at which it is due, so that neither the bag's nor this machine's hiccups
    change the intervals between stamps. It is made ready before that time, not at it.
    """
    sent, start_ns, first_ns = 0, 0, 0
    clock = RosClock(clock_type=ClockType.SYSTEM_TIME)
    for event in events:
        if event.message is None:
            continue
        if not sent:
            start_ns, first_ns = clock.now().nanoseconds + 50_000_000, event.time_ns
        due_ns = start_ns + round((event.time_ns - first_ns) / rate)
        data = event.message.data
        if restamp:
            with suppress(DataError):  # what cannot be read is sent as it is: the nodes are to count it
                data = restamped(
                    data, event.message.type_name, partial(bag.decode, event.message), due_ns - event.time_ns
                )
        while (wait_s := (due_ns - clock.now().nanoseconds) * 1e-9) > 0.0:
            if not go_on():
                return sent
            time.sleep(min(wait_s, LONGEST_NAP_S))
        if not go_on():
            return sent
        send(event.input, data)
        sent += 1
    return sent

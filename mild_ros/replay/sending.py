# SPDX-License-Identifier: Apache-2.0
"""Two ways to send a bag to nodes: in lock-step, each event after the one before is handled, or in real time."""

from __future__ import annotations

import itertools
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import NamedTuple

from rclpy.clock import Clock as RosClock
from rclpy.clock import ClockType

from mild_core.errors import DataError, SetupError
from mild_core.joint_measurements import OUTCOMES
from mild_ros.bag.encoding import restamped
from mild_ros.bag.reader import BagReader
from mild_ros.messages.handled import Handled
from mild_ros.node_kit.dds_variables import heard_remedy
from mild_ros.replay.events import JOINT_STATES, SKELETON, TAKEN, TICK, Event

FIRST = ("perception", "pipeline")
"""Stages that take skeletons: nothing that comes of one is all handled before they say so."""

REPEAT_S = 0.5
"""`/clock` is best effort: a tick without an outcome is sent again after this long [s]."""

MOMENT_NS = 25_000_000
"""A node that sends in real time looks after everything else between such moments."""

START_PIPELINE = "start the pipeline (in lock-step with -p report_handled:=true -p use_sim_time:=true)"
START_RECORDER = "start the recorder with -p report_recorded:=true, and let it record handled, or set recorders to 0"

Send = Callable[[str, bytes], None]


class LockStep:
    """Sends one event at a time and waits until every stage is done with all that came of it.

    A message is one token. A stage that reports n outputs takes one token and puts n; at none left all is handled.

    Args:
        events: What to send, ticks included.
        send: Publishes bytes on an input.
        tick: Publishes `/clock` [ns].
        patience_s: How long to wait for an answer.
        reporters: How many nodes report. Where there are several, two of them take the robot's own state.
        recorders: How many recorders repeat each report once they have written it down.

    Attributes:
        period_s: How often to ask `is_due`.
        sent: How many events were sent.
    """

    period_s = 0.05

    def __init__(
        self,
        events: Iterator[Event],
        send: Send,
        tick: Callable[[int], None],
        patience_s: float,
        reporters: int = 1,
        recorders: int = 0,
    ) -> None:
        self.sent = 0
        self._recorders = recorders
        self._reported, self._recorded = Counter[Handled](), Counter[Handled]()
        self._measuring = min(reporters, 2)
        self._events, self._send, self._tick, self._patience_s = events, send, tick, patience_s
        self._event: Event | None = None
        self._tokens = 0
        self._started = False
        self._since_s = self._repeated_s = 0.0

    def advance(self) -> bool:
        """Send the next event; False when there is none."""
        self._event = next(self._events, None)
        while self._event is not None and self._event.input not in TAKEN and self._event.message is not None:
            self._send(self._event.name, self._event.message.data)
            self._event = next(self._events, None)
        if self._event is None:
            return False
        self._tokens = self._measuring if self._event.input == JOINT_STATES else 1
        self._started = self._event.input != SKELETON
        self._reported.clear()
        self._recorded.clear()
        self._since_s = self._repeated_s = time.monotonic()
        self._tick(self._event.time_ns)
        if self._event.message is not None:
            self._send(self._event.name, self._event.message.data)
        self.sent += 1
        return True

    def pause(self) -> None:
        """Nothing to do: what is under way is waited for as ever."""

    def is_done_after(self, handled: Handled) -> bool:
        """Take the outcome of an input into account; whether nothing is left of the event sent last."""
        if self._event is None or not self._concerns(self._event, handled):
            return False
        self._tokens += handled.outputs - 1
        self._started = self._started or handled.stage in FIRST
        self._reported[handled] += self._recorders
        return self._is_done()

    def is_done_once_recorded(self, handled: Handled) -> bool:
        """Take into account that a recorder has written down an outcome; whether nothing is left of the event."""
        self._recorded[handled] += 1
        return self._reported[handled] > 0 and self._is_done()

    def _is_done(self) -> bool:
        return self._tokens == 0 and self._started and self._reported <= self._recorded

    def is_due(self) -> bool:
        """Never by itself, but resend an event without an outcome; to be called now and then.

        Raises:
            SetupError: For longer than `patience_s`.
        """
        now_s = time.monotonic()
        if self._event is None:
            return False
        if now_s - self._since_s > self._patience_s:
            what = "tick of /clock" if self._event.input == TICK else f"message on {self._event.name}"
            raise SetupError(
                "lock-step",
                f"event {self.sent}, a {what}, was not handled within {self._patience_s:g} s",
                self._remedy(),
            )
        if self._event.input == TICK and now_s - self._repeated_s > REPEAT_S:
            self._repeated_s = now_s
            self._tick(self._event.time_ns)
        return False

    def _remedy(self) -> str:
        if self._tokens == 0 and self._started:
            return START_RECORDER
        return "start the nodes with -p report_handled:=true -p use_sim_time:=true, and one set of them only"

    @staticmethod
    def _concerns(event: Event, handled: Handled) -> bool:
        if event.input == TICK:
            return handled.outcome == "tick" and handled.stamp_ns == event.time_ns
        if event.input == SKELETON:
            return handled.outcome != "tick" and handled.outcome not in OUTCOMES
        return handled.outcome != "tick" and handled.outputs == 0


class RealTime:
    """Sends messages as far apart as they were recorded, divided by `rate`.

    A restamped message carries the time at which it is due, so that neither the bag's nor this machine's hiccups
    change the intervals between stamps. It is made ready before that time, not at it.

    Args:
        events: What to send; ticks are published on `/clock`.
        send: Publishes bytes on an input.
        tick: Publishes `/clock` [ns].
        rate: How much faster than it was recorded.
        bag: Reads messages, to give them the time of their sending; None leaves the stamps as they are.

    Attributes:
        period_s: How often to ask `is_due`.
        sent: How many messages were sent.
    """

    period_s = 0.001

    def __init__(
        self,
        events: Iterator[Event],
        send: Send,
        tick: Callable[[int], None],
        rate: float,
        bag: BagReader | None,
    ) -> None:
        self.sent = 0
        self._events, self._send, self._tick, self._rate, self._bag = events, send, tick, rate, bag
        self._clock = RosClock(clock_type=ClockType.SYSTEM_TIME)
        self._anchor: tuple[int, int] | None = None
        self._newest_ns = 0
        self._ready: tuple[int, Event, bytes] | None = None

    def advance(self) -> bool:
        """Send what is due in the next moment; False when nothing is left."""
        end_ns = self._clock.now().nanoseconds + MOMENT_NS
        while True:
            if self._ready is None:
                event = next(self._events, None)
                if event is None:
                    return False
                self._ready = self._made_ready(event)
            due_ns, event, data = self._ready
            wait_ns = min(due_ns, end_ns) - self._clock.now().nanoseconds
            time.sleep(max(wait_ns, 0) * 1e-9)
            if due_ns > end_ns:
                return True
            self._ready = None
            if event.message is None:
                self._tick(event.time_ns)
            else:
                self._send(event.name, data)
                self.sent += 1

    def is_done_after(self, _handled: Handled) -> bool:
        """Waits for no one."""
        return False

    def is_done_once_recorded(self, _handled: Handled) -> bool:
        """Nor is a recorder."""
        return False

    def is_due(self) -> bool:
        """Always: to send is to look at the clock."""
        return True

    def pause(self) -> None:
        """Go on later from where it was."""
        self._anchor = None
        if self._ready is not None:
            self._events, self._ready = itertools.chain([self._ready[1]], self._events), None

    def _made_ready(self, event: Event) -> tuple[int, Event, bytes]:
        """When an event is due, and the bytes to send then."""
        if self._anchor is None or event.time_ns < self._newest_ns:  # the first, or of a bag that begins again
            self._anchor = self._clock.now().nanoseconds + 2 * MOMENT_NS, event.time_ns
        self._newest_ns = event.time_ns
        start_ns, first_ns = self._anchor
        due_ns = start_ns + round((event.time_ns - first_ns) / self._rate)
        message = event.message
        if message is None or self._bag is None:
            return due_ns, event, b"" if message is None else message.data
        data = message.data
        with suppress(DataError):  # what cannot be read is sent as it is: the nodes are to count it
            decode, shift_ns = partial(self._bag.decode, message), due_ns - event.time_ns
            data = restamped(data, message.type_name, decode, shift_ns, self._bag.types)
        return due_ns, event, data


LOOK_PERIOD_S = 0.05

SETTLING_S = 0.5
"""A publisher sees a subscriber before that one sees it: they get this long."""


class Wanted(NamedTuple):
    """Something that has to be there before a replay begins.

    Attributes:
        found: How many there are now.
        least: How many are wanted.
        what: For people, behind a number.
        remedy: What to do when they do not come.
    """

    found: Callable[[], int]
    least: int
    what: str
    remedy: str


class SubscriberWait:
    """Who is to hear a replay.

    Args:
        wanted: All that has to be there.
        patience_s: How long to wait.
    """

    def __init__(self, wanted: Sequence[Wanted], patience_s: float) -> None:
        self._wanted, self._patience_s = wanted, patience_s
        self._waited_s = self._settled_s = 0.0

    def is_there(self, since_s: float) -> bool:
        """Whether all have been there for long enough; to be asked every `since_s`.

        Raises:
            SetupError: They do not come.
        """
        missing = next(((found, one) for one in self._wanted if (found := one.found()) < one.least), None)
        self._waited_s += since_s
        self._settled_s = self._settled_s + since_s if missing is None else 0.0
        if missing is not None and self._waited_s > self._patience_s:
            found, one = missing
            problem = f"{found} {one.what} after {self._waited_s:.0f} s"
            raise SetupError("replay", problem, heard_remedy(one.remedy))
        return self._settled_s >= SETTLING_S

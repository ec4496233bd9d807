# SPDX-License-Identifier: Apache-2.0
"""Takes what comes on a node's topics: newest wins, bounded in number and in time, and what is dropped is counted.

A thread waits for messages, takes all that are there, keeps the newest few of each topic and hands those on in the
order in which they came. Only those are deserialised. Memory stays bounded: what waits lies in DDS, which keeps the
newest `depth` of a topic. Time stays bounded too: of each topic so many are used per second, whatever comes, and the
thread sleeps while it is flooded. In lock-step all of this is the executor's, one message after the other.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.threads import StageNode

KEPT = 8
"""Messages of a topic that are used of those that came at once. At 200 Hz eight are the work of 40 ms."""

JOINTS_KEPT = 16
"""The same of `joint_states`: a driver may say each joint in a message of its own."""

PER_S, JOINTS_PER_S, PARTS_PER_S = 250.0, 1000.0, 4000.0
"""Messages of a topic, of `joint_states`, and of a topic of many transforms, that are used per second at most: as many
as the fastest trackers (200 Hz) and drivers (1 kHz) send."""

NOTICE_NS = 100_000_000
"""A thread that has nothing to do notices the end of the node within this time."""

FAILED_PAUSE_S = 0.01
"""A fault of ours in reception costs what had come; the next attempt follows after this time."""

FLOOD_PAUSE_S = 0.005
"""Reception sleeps for so long at least when more has come than is used: control needs the lock too ..."""

FLOOD_REST = 2.0
"""... and for so many times the processor time that it has spent, so that of a flooded process a third is reception's
at most. Both together are all that a flood adds to the age of a message."""


@dataclass(eq=False)
class _Input:
    """One subscription.

    Attributes:
        topic: Its name in diagnostics.
        kind: Of its messages.
        raw: Whether the callback takes bytes.
        subscription: Itself, and the callback.
        depth: How many messages DDS keeps.
        newest: When those came that are handed on next, and what they are.
        per_s: How many are used per second at most.
        allowance: How many may be used now: it grows with time, up to the places in `newest`.
        looked_s: When that was reckoned, on the steady clock.
        sequence: The publisher's number of the newest message; None while that says nothing of losses.
    """

    topic: str
    kind: type[Any]
    raw: bool
    subscription: Subscription
    depth: int
    newest: deque[tuple[int, bytes]]
    per_s: float
    allowance: float
    looked_s: float = 0.0
    sequence: int | None = None

    def allowed(self, now_s: float) -> int:
        """How many messages may be used now; the newest one always may."""
        grown = self.allowance + (now_s - self.looked_s) * self.per_s
        self.allowance, self.looked_s = min(grown, float(self.newest.maxlen or 1)), now_s
        return max(1, int(self.allowance))

    def lost(self, taken: int, sequence: int) -> int:
        """How many messages never came, or had to make room in DDS, before the newest of those taken.

        The publisher numbers them; with several publishers nothing can be counted.
        """
        before, self.sequence = self.sequence, sequence if self.subscription.get_publisher_count() == 1 else None
        return max(0, sequence - before - taken) if before is not None and self.sequence is not None else 0


class Reception:
    """The topics that a stage takes.

    Args:
        node: Whose.
        diagnostics: Where lost, dropped and undecodable messages are counted.

    Attributes:
        lock: Held while a callback runs: another thread that changes the same state takes it.
    """

    def __init__(self, node: StageNode, diagnostics: Diagnostics) -> None:
        self.lock = threading.RLock()
        self._node, self._diagnostics, self._in_order = node, diagnostics, node.is_in_order
        self._inputs: list[_Input] = []
        if not self._in_order:
            node.run_beside("reception", self._run)

    def subscribe(
        self,
        kind: type[Any],
        topic: str,
        callback: Callable[[Any], None],
        quality: QoSProfile,
        *,
        raw: bool = False,
        kept: int = KEPT,
        per_s: float = PER_S,
    ) -> None:
        """Hand messages to a callback.

        Args:
            kind: Their type.
            topic: Their topic.
            callback: Takes each that is used.
            quality: How they are delivered.
            raw: Whether the callback takes bytes.
            kept: How many are used of those that came at once. Where one message says only a part (one joint, one
                transform), all parts that come together must find a place.
            per_s: How many are used per second at most.
        """
        if self._in_order:
            self._node.create_subscription(kind, topic, callback, quality, raw=raw)
            return
        subscription = self._node.create_subscription(kind, topic, callback, quality, raw=True)
        self._node.take_over(subscription)
        self._inputs.append(_Input(topic, kind, raw, subscription, quality.depth, deque(maxlen=kept), per_s, kept))

    def _run(self) -> None:
        count = len(self._inputs)
        if not count:
            return
        waiting = rclpy_implementation.WaitSet(count, 0, 0, 0, 0, 0, self._node.context.handle)
        receive = self._node.guard("reception", self._receive)
        while not self._node.ending.is_set():
            pause_s = receive(waiting)
            if pause_s is None:
                pause_s = FAILED_PAUSE_S
            if pause_s:
                self._node.ending.wait(pause_s)

    def _receive(self, waiting: Any) -> float:
        """Wait for messages and hand on what has come; for how long to sleep then [s]."""
        waiting.clear_entities()
        for entry in self._inputs:
            waiting.add_subscription(entry.subscription.handle)
        waiting.wait(NOTICE_NS)
        ready = set(waiting.get_ready_entities("subscription"))
        if not ready:
            return 0.0
        started_s = time.thread_time()
        flooded = [self._take(entry) for entry in self._inputs if entry.subscription.handle.pointer in ready]
        self._hand_on()
        return max(FLOOD_PAUSE_S, FLOOD_REST * (time.thread_time() - started_s)) if any(flooded) else 0.0

    def _take(self, entry: _Input) -> bool:
        """Take what is there of a topic, and keep what may be used; whether more comes than that."""
        taken, handle, sequence = 0, entry.subscription.handle, 0
        while taken < entry.depth:
            found = handle.take_message(entry.kind, True)
            if found is None:
                break
            data, facts = found
            entry.newest.append((facts["received_timestamp"], data))
            taken, sequence = taken + 1, facts["publication_sequence_number"]
        if not taken:
            return False
        if lost := entry.lost(taken, sequence):
            self._diagnostics.lost(entry.topic, lost)
        while len(entry.newest) > entry.allowed(time.monotonic()):
            entry.newest.popleft()
        entry.allowance = max(0.0, entry.allowance - len(entry.newest))
        if taken > len(entry.newest):
            self._diagnostics.superseded(entry.topic, taken - len(entry.newest))
        return taken > len(entry.newest) or entry.allowance < 1.0

    def _hand_on(self) -> None:
        """Hand on what was kept, in the order in which it came."""
        kept = [(received, entry, data) for entry in self._inputs for received, data in entry.newest]
        for entry in self._inputs:
            entry.newest.clear()
        for _, entry, data in sorted(kept, key=lambda one: one[0]) if len(kept) > 1 else kept:
            try:
                message = data if entry.raw else deserialize_message(data, entry.kind)
            except Exception as error:  # rclpy has no common root for what it raises
                self._diagnostics.flowed(entry.topic)
                self._diagnostics.unreadable(entry.topic, "undecodable", str(error).splitlines()[0])
                continue
            with self.lock:
                entry.subscription.callback(message)

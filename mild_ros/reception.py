# SPDX-License-Identifier: Apache-2.0
"""Takes what comes on a node's topics: newest wins, bounded in number and in time, and what is dropped is counted.

A thread waits for messages, takes all that are there, keeps the newest few of each topic and hands those on in the
order in which they came. Only those are deserialised. Memory stays bounded: what waits lies in DDS, which keeps the
newest `depth` of a topic. When messages had to be dropped, the thread sleeps twice as long as it has worked, so a flood
takes about a third of a core. In lock-step all of this is the executor's, one message after the other.
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

from mild_ros.diagnostics import Diagnostics
from mild_ros.threads import StageNode

KEPT = 8
"""Messages of a topic that are used of those that came at once. At 200 Hz eight are the work of 40 ms."""

JOINTS_KEPT = 16
"""The same of `joint_states`: a driver may say each joint in a message of its own."""

NOTICE_NS = 100_000_000
"""A thread that has nothing to do notices the end of the node within this time."""

PAUSE_SHARE = 2.0
"""After messages had to be dropped reception sleeps twice as long as it has worked: control needs the lock too."""

FAILED_PAUSE_S = 0.01
"""A fault of ours in reception costs what had come; the next attempt follows after this time."""

LEAST_PAUSE_S, LONGEST_PAUSE_S = 0.001, 0.005
"""Bounds of the sleep after messages had to be dropped: a flood never adds more than this to the age of a message."""


@dataclass(eq=False)
class _Input:
    """One subscription: what to do with its messages, and how many of those that came at once to use."""

    topic: str
    kind: type[Any]
    raw: bool
    subscription: Subscription
    depth: int
    newest: deque[tuple[int, bytes]]


class Reception:
    """The topics that a stage takes.

    Args:
        node: Whose.
        diagnostics: Where dropped and undecodable messages are counted.

    Attributes:
        lock: Held while a callback runs: whoever changes the same state from another thread takes it.
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
        """
        if self._in_order:
            self._node.create_subscription(kind, topic, callback, quality, raw=raw)
            return
        subscription = self._node.create_subscription(kind, topic, callback, quality, raw=True)
        self._node.take_over(subscription)
        self._inputs.append(_Input(topic, kind, raw, subscription, quality.depth, deque(maxlen=kept)))

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
        started_s = time.monotonic()
        dropped = 0
        for entry in self._inputs:
            if entry.subscription.handle.pointer in ready:
                dropped += self._take(entry)
        self._hand_on()
        if not dropped:
            return 0.0
        worked_s = time.monotonic() - started_s
        return min(max(PAUSE_SHARE * worked_s, LEAST_PAUSE_S), LONGEST_PAUSE_S)

    def _take(self, entry: _Input) -> int:
        """Take what is there of a topic; how many messages there are no place for."""
        taken, handle = 0, entry.subscription.handle
        while taken < entry.depth:
            found = handle.take_message(entry.kind, True)
            if found is None:
                break
            data, facts = found
            entry.newest.append((facts["received_timestamp"], data))
            taken += 1
        dropped = taken - len(entry.newest)
        if dropped:
            self._diagnostics.superseded(entry.topic, dropped)
        return dropped

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

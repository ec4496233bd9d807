# SPDX-License-Identifier: Apache-2.0
"""What all nodes of the three stages are: a ROS node with threads of its own beside the executor.

The executor serves timers, parameters and services. Topics are taken by `Reception`, commands are made by `Control`,
each in a thread, so that none of them waits for the others. In lock-step (see `is_in_order`) there is one thread only.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.service import Service
from rclpy.subscription import Subscription

from mild_ros.node_kit.guarded import GuardedNode

JOIN_S = 5.0
"""A thread ends within a control period; a busy machine may take longer."""


class StageNode(GuardedNode):
    """A node that may take subscriptions and services from its executor.

    Attributes:
        started_s: When the node came to life, on the steady clock: from then on DDS looks for others.
        failure: What ended a thread before its time; None while all is well.
    """

    def __init__(self, name: str) -> None:
        self._taken_over: set[int] = set()
        self._bodies: list[tuple[str, Callable[[], None]]] = []
        self._finishing: list[Callable[[], None]] = []
        self._threads: list[threading.Thread] = []
        self.started_s = time.monotonic()
        self.failure: BaseException | None = None
        self.ending = threading.Event()
        super().__init__(name)

    @property
    def is_in_order(self) -> bool:
        """Whether a replay in lock-step is served: every message in the order in which it comes, by one thread."""
        return bool(self.get_parameter("use_sim_time").value) and bool(self.get_parameter("report_handled").value)

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Those that the executor serves."""
        return (entry for entry in super().subscriptions if id(entry) not in self._taken_over)

    @property
    def services(self) -> Iterator[Service]:
        """Those that the executor serves."""
        return (entry for entry in super().services if id(entry) not in self._taken_over)

    def take_over(self, entry: Any) -> None:
        """From now on the executor leaves this subscription or service alone."""
        self._taken_over.add(id(entry))

    def run_beside(self, name: str, body: Callable[[], None], finish: Callable[[], None] = lambda: None) -> None:
        """Call `body` in a thread from the start of the node; it returns when `ending` is set, `finish` having run."""
        self._bodies.append((name, body))
        self._finishing.append(finish)

    def start_threads(self) -> None:
        """Start what runs beside the executor; an error in it ends the node, and the other threads finish first."""

        def guarded(body: Callable[[], None]) -> None:
            try:
                body()
            except BaseException as error:
                if not self.ending.is_set():
                    self.failure = self.failure or error

        for name, body in self._bodies:
            self._threads.append(threading.Thread(target=guarded, args=(body,), name=name, daemon=True))
            self._threads[-1].start()

    def stop_threads(self) -> None:
        """End all threads, before the node is destroyed; each that still runs finishes what it does first."""
        try:
            for thread, finish in zip(self._threads, self._finishing, strict=False):
                if thread.is_alive():
                    self.guard(thread.name, finish)()
        finally:
            self.ending.set()
        for thread in self._threads:
            thread.join(JOIN_S)

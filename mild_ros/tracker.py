# SPDX-License-Identifier: Apache-2.0
"""The tracker that a node listens to."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from mild_core.errors import DataError
from mild_core.signals import SkeletonFrame
from mild_ros.assembly.perception import skeleton_source
from mild_ros.clock import NodeClock
from mild_ros.diagnostics import Diagnostics
from mild_ros.fates import Fates
from mild_ros.messages.marker_array_bytes import marker_array_from_bytes
from mild_ros.messages.skeletons import ADAPTERS
from mild_ros.quality_of_service import SENSOR
from mild_ros.settings import PerceptionParameters

TOPIC = "skeleton"

FROM_BYTES: dict[str, Callable[[bytes], Any]] = {"marker_array": marker_array_from_bytes}
"""Kinds of messages that are read faster without rclpy's own classes."""


@dataclass(frozen=True)
class Sighting:
    """One message of a tracker.

    Attributes:
        people: Everyone in it.
        stamp_ns: The newest of their stamps; None when there is nobody.
        now_ns: When it came, in the node's time.
        steady_ns: When it came, on a clock for measuring how long things take.
    """

    people: tuple[SkeletonFrame, ...]
    stamp_ns: int | None
    now_ns: int
    steady_ns: int

    @property
    def input_ns(self) -> int:
        """The stamp of the message, and of one with nobody in it the time when it came."""
        return self.now_ns if self.stamp_ns is None else self.stamp_ns


class Tracker:
    """Subscribes to a tracker and reads its messages.

    Args:
        parameters: Which one.
        stage: Who reports the fate of a message that cannot be read.

    Raises:
        SetupError: As `skeleton_source`.
    """

    def __init__(self, parameters: PerceptionParameters, stage: str) -> None:
        self._source = skeleton_source(parameters)
        self._adapter = ADAPTERS[self._source.message]
        self._from_bytes = FROM_BYTES.get(self._source.message)
        self._stage = stage

    def listen(
        self,
        node: Node,
        clock: NodeClock,
        diagnostics: Diagnostics,
        fates: Fates,
        on_sight: Callable[[Sighting], None],
    ) -> None:
        """Call `on_sight` with every message; one that cannot be read is counted and logged here."""

        def on_message(message: Any) -> None:
            steady_ns, now_ns = time.perf_counter_ns(), clock.now_ns()
            try:
                readable = self._from_bytes(message) if self._from_bytes else message
                people = self._adapter.people(readable, self._source, now_ns)
            except DataError as error:
                diagnostics.flowed(TOPIC)
                diagnostics.unreadable(TOPIC, error.reason, error.detail)
                fates.report(self._stage, 0, error.reason, now_ns)
                return
            stamp_ns = max((person.stamp_ns for person in people), default=None)
            on_sight(Sighting(people, stamp_ns, now_ns, steady_ns))
            diagnostics.flowed(TOPIC, stamp_ns)

        raw = self._from_bytes is not None
        node.create_subscription(self._adapter.message_type, TOPIC, on_message, SENSOR, raw=raw)

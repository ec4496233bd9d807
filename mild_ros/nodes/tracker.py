# SPDX-License-Identifier: Apache-2.0
"""The tracker that a node listens to."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.node import Node

from mild_core.errors import DataError
from mild_core.signals import SkeletonFrame
from mild_ros.assembly.perception import skeleton_source
from mild_ros.assembly.settings import PerceptionParameters
from mild_ros.messages.feeds import SKELETON_TOPIC, Feed
from mild_ros.messages.marker_array_bytes import marker_array_from_bytes
from mild_ros.messages.message_types import required_message_class
from mild_ros.messages.skeletons import ADAPTERS
from mild_ros.node_kit.clock import NodeClock
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.outcomes import OutcomePublisher
from mild_ros.node_kit.quality_of_service import SENSOR, STATIC_TRANSFORMS
from mild_ros.node_kit.reception import KEPT, PARTS_PER_S, PER_S, Reception
from mild_ros.nodes.tracker_watch import TrackerWatch

TOPIC = SKELETON_TOPIC
"""What a tracker is called in diagnostics, whatever its topics are."""

FROM_BYTES: dict[str, Callable[[bytes], Any]] = {"visualization_msgs/msg/MarkerArray": marker_array_from_bytes}
"""Types of messages that are read faster without rclpy's own classes."""


@dataclass(frozen=True)
class Sighting:
    """One message of a tracker.

    Attributes:
        people: Everyone in it.
        stamp_ns: The newest of their stamps; None when there is no person.
        now_ns: When it came, in the node's time.
        steady_ns: When it came, on a clock for measuring how long things take.
    """

    people: tuple[SkeletonFrame, ...]
    stamp_ns: int | None
    now_ns: int
    steady_ns: int

    @property
    def input_ns(self) -> int:
        """The stamp of the message, and of one without a person the time when it came."""
        return self.now_ns if self.stamp_ns is None else self.stamp_ns


class Tracker:
    """Subscribes to a tracker and reads its messages.

    Args:
        parameters: Which one.
        stage: Which stage reports the outcome of a message that cannot be read.

    Raises:
        SetupError: As `skeleton_source` and `required_message_class`.
    """

    def __init__(self, parameters: PerceptionParameters, stage: str) -> None:
        self._source = skeleton_source(parameters)
        self._feeds = [
            (feed, required_message_class(feed.type_name))
            for feed in ADAPTERS[self._source.message].feeds(self._source)
        ]
        self._stage = stage

    def listen(
        self,
        node: Node,
        reception: Reception,
        clock: NodeClock,
        diagnostics: Diagnostics,
        outcomes: OutcomePublisher,
        on_sight: Callable[[Sighting], None],
    ) -> None:
        """Call `on_sight` with everyone who is seen; a message that cannot be read is counted and logged here."""
        watch = TrackerWatch(node, diagnostics, self._source, tuple(feed for feed, _ in self._feeds), reception.lock)

        def on_message(feed: Feed, message: Any) -> None:
            steady_ns, now_ns = time.perf_counter_ns(), clock.now_ns()
            from_bytes = FROM_BYTES.get(feed.type_name)
            try:
                readable = from_bytes(message) if from_bytes else message
                watch.came(feed, readable)
                people = feed.read(readable, now_ns)
            except DataError as error:
                diagnostics.flowed(TOPIC)
                diagnostics.unreadable(TOPIC, error.reason, error.detail)
                outcomes.report(self._stage, 0, error.reason, now_ns)
                return
            if people is None:
                outcomes.report(self._stage, 0, "incomplete", now_ns)
                return
            stamp_ns = max((person.stamp_ns for person in people), default=None)
            on_sight(Sighting(people, stamp_ns, now_ns, steady_ns))
            diagnostics.flowed(TOPIC)

        for feed, message_type in self._feeds:
            quality = STATIC_TRANSFORMS if feed.latched else SENSOR
            raw = feed.type_name in FROM_BYTES
            # A transform alone shows no person, and every static one comes once only.
            all_parts = feed.latched or feed.lacks is not None
            kept, per_s = (quality.depth, PARTS_PER_S) if all_parts else (KEPT, PER_S)
            read = partial(on_message, feed)
            reception.subscribe(message_type, feed.topic, read, quality, raw=raw, kept=kept, per_s=per_s)

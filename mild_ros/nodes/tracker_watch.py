# SPDX-License-Identifier: Apache-2.0
"""Notices within two seconds that the tracker is not the one that was set, and says in one line what to do."""

from __future__ import annotations

import time
from collections.abc import Iterable
from contextlib import AbstractContextManager
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from mild_core.perception.skeletons import SkeletonSource
from mild_ros.commands.command_topics import JOINT_COMMAND
from mild_ros.messages.feeds import SKELETON_TOPIC, Feed
from mild_ros.messages.misfits import fitting_sources, misfit
from mild_ros.node_kit.clock import steady_clock
from mild_ros.node_kit.diagnostics import OTHER_USER, Diagnostics, publisher_names

PERIOD_S = 0.5
SILENCE_S = 1.5
"""Silence for so long needs an explanation; a slow tracker sends every 0.2 s, and discovery takes its time."""

STUCK_S = 1.0
"""Messages of which none can be used for so long need one."""


OF_A_ROBOT = ("joint_states", JOINT_COMMAND, "robot_description")
"""Who publishes one of these in a namespace has a robot there."""


OF_PERCEPTION = (JOINT_COMMAND, "feature_window")
"""A node that takes a tracker's messages publishes one of these."""


def other_robots(topics: Iterable[str], namespace: str) -> set[str]:
    """Namespaces of robots beside our own, of which ours is none and which do not hold ours.

    Args:
        topics: Full names of all that is published.
        namespace: Our own.
    """
    places = {topic.rpartition("/")[0] for topic in topics if topic.rpartition("/")[2] in OF_A_ROBOT}
    return {place for place in places if place and not _is_within(namespace, place)}


def _is_within(name: str, namespace: str) -> bool:
    """Whether a name lies in a namespace, or is it."""
    return name == namespace or name.startswith(f"{namespace}/")


class TrackerWatch:
    """Looks at what arrives, at who publishes and at what perception makes of it, twice a second.

    Args:
        node: Who listens.
        diagnostics: Where it is said; what perception makes of messages is read there.
        source: The tracker that was set.
        feeds: What is listened to.
        lock: Held while messages are read, in another thread.
    """

    def __init__(
        self,
        node: Node,
        diagnostics: Diagnostics,
        source: SkeletonSource,
        feeds: tuple[Feed, ...],
        lock: AbstractContextManager[Any],
    ) -> None:
        self._lock = lock
        self._node, self._diagnostics, self._source, self._feeds = node, diagnostics, source, feeds
        self._newest: dict[str, Any] = {}
        self._silent_since_s = dict.fromkeys((feed.topic for feed in feeds), time.monotonic())
        self._progress, self._stuck_since_s = 0, time.monotonic()
        node.create_timer(PERIOD_S, self.look, clock=steady_clock())

    def came(self, feed: Feed, message: Any) -> None:
        """A message was read."""
        self._newest[feed.topic] = message

    def look(self) -> None:
        """Say what is wrong, or that nothing is any longer."""
        with self._lock:
            line = self._looked(time.monotonic())
        if line:
            self._diagnostics.complain(f"source {self._source.name}: {line}")
            self._diagnostics.alarms["tracker"] = (DiagnosticStatus.WARN, line)
        else:
            self._diagnostics.alarms.pop("tracker", None)

    def _looked(self, now_s: float) -> str:
        """What is wrong; "" for nothing."""
        messages, self._newest = self._newest, {}
        for topic in messages:
            self._silent_since_s[topic] = now_s
        lines = [self._judged(feed, messages.get(feed.topic), now_s) for feed in self._feeds]
        return next(filter(None, lines), "") or self._stuck(bool(messages), now_s)

    def _judged(self, feed: Feed, message: Any, now_s: float) -> str:
        topic = self._node.resolve_topic_name(feed.topic)
        publishers = self._node.get_publishers_info_by_topic(topic)
        for other in publishers:
            if other.topic_type != feed.type_name:
                return self._of_another_type(topic, feed, other)
        if message is not None:
            wrong = misfit(message, self._source)
            return f"{topic} brings {wrong}" if wrong else ""
        if feed.latched or now_s - self._silent_since_s[feed.topic] < SILENCE_S:
            return ""
        if publishers:
            names = publisher_names(publishers)
            return f"nothing comes on {topic}, which {names} could publish: is the tracker running?{OTHER_USER[1:]}"
        return f"no publisher on {topic} ({feed.type_name}): {self._elsewhere(feed)}"

    def _of_another_type(self, topic: str, feed: Feed, other: Any) -> str:
        fitting = fitting_sources(other.topic_type) if feed.topic == SKELETON_TOPIC else []
        remedy = f"set source to {' or '.join(fitting)}" if fitting else "remap to another topic"
        who = f"{other.node_namespace.rstrip('/')}/{other.node_name}"
        expected = f"{self._source.name} reads {feed.type_name}"
        return f"{who} publishes {other.topic_type} on {topic}, but source {expected}: {remedy}"

    def _elsewhere(self, feed: Feed) -> str:
        """What else is there that could be meant, but for what is another robot's."""
        own = {name for name, _ in self._node.get_publisher_names_and_types_by_node(
            self._node.get_name(), self._node.get_namespace()
        )}  # fmt: skip
        found = [
            (name, kinds[0])
            for name, kinds in self._node.get_topic_names_and_types()
            if name not in own and self._node.count_publishers(name)
        ]
        robots = other_robots((name for name, _ in found), self._node.get_namespace())
        found = [(name, kind) for name, kind in found if not self._is_of(robots, name)]
        same = [name for name, kind in found if kind == feed.type_name]
        if same:
            return f"remap it, e.g. -r {feed.topic}:={same[0]}"
        others = [(name, sources[0]) for name, kind in found if (sources := fitting_sources(kind))]
        if others and feed.topic == SKELETON_TOPIC:
            name, source = others[0]
            return f"is it {name}? Then -r {feed.topic}:={name} -p source:={source}"
        return "start the tracker; does it run in another ROS_DOMAIN_ID, or unheard? See ./mild doctor"

    def _is_of(self, robots: set[str], topic: str) -> bool:
        """Whether a topic lies in the namespace of one of these robots, or another person tracking reads it."""
        if any(_is_within(topic, robot) for robot in robots):
            return True
        own = (self._node.get_name(), self._node.get_namespace())
        listeners = {(one.node_name, one.node_namespace) for one in self._node.get_subscriptions_info_by_topic(topic)}
        return any(one[1] in robots or self._reads_people(*one) for one in listeners - {own})

    def _reads_people(self, name: str, namespace: str) -> bool:
        """Whether a node is one of ours that takes a tracker's messages."""
        try:
            published = self._node.get_publisher_names_and_types_by_node(name, namespace)
        except RuntimeError:  # rclpy has no type of its own for a node that has gone, or has no name yet
            return False
        return any(topic.rpartition("/")[2] in OF_PERCEPTION for topic, _ in published)

    def _stuck(self, flowing: bool, now_s: float) -> str:
        """Why messages come but no person in them can be used, when that has been so for long."""
        progress = self._diagnostics.usable("perception")
        if progress != self._progress or not flowing:
            self._progress, self._stuck_since_s = progress, now_s
        stuck = now_s - self._stuck_since_s >= STUCK_S
        for feed in self._feeds if stuck else ():
            if feed.lacks is not None and (lacking := feed.lacks()):
                return lacking
        return self._diagnostics.newest_detail if stuck else ""

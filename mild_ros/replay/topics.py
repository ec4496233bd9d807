# SPDX-License-Identifier: Apache-2.0
"""The topics that a replay publishes."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from mild_ros.bag.reader import BagReader
from mild_ros.messages.message_types import message_class, required_message_class
from mild_ros.messages.stamps import time_to_msg
from mild_ros.node_kit.quality_of_service import BETWEEN_STAGES, STATIC_TRANSFORMS
from mild_ros.replay.events import JOINT_STATES, SKELETON, TRUE_MOTION
from mild_ros.replay.in_process import Inputs


class ReplayTopics:
    """Publishers of what a bag holds; topics of types that are not installed here are passed over and counted.

    Args:
        node: Whose.
        bag: The bag.
        inputs: What of it is sent.
        clock: Whether `/clock` is published.

    Attributes:
        left_out: What will not be sent, in a few words; "" for nothing.
    """

    def __init__(self, node: Node, bag: BagReader, inputs: Inputs, clock: bool) -> None:
        unknown: dict[str, int] = {}
        types = {JOINT_STATES: JointState, TRUE_MOTION: JointState}
        names = [name for name in dict.fromkeys(inputs.topics(bag).values()) if name != SKELETON]
        if inputs.joint_states in ("home", "auto") and JOINT_STATES not in names:
            names.append(JOINT_STATES)
        self._publishers: dict[str, Publisher] = {}
        for feed in inputs.feeds(bag).values():
            quality = STATIC_TRANSFORMS if feed.latched else BETWEEN_STAGES
            self._publishers[feed.topic] = node.create_publisher(
                required_message_class(feed.type_name), feed.topic, quality
            )
        self._skeletons = list(self._publishers.values())
        for name in names:
            kind = types[name] if name in types else message_class(bag.topics[name].type_name)
            if kind is None:
                summary = bag.topics[name]
                unknown[name] = summary.count
                node.get_logger().warning(f"{name} is not sent: the type {summary.type_name} is not installed here")
                continue
            latched = name in bag.topics and bag.topics[name].latched
            self._publishers[name] = node.create_publisher(kind, name, STATIC_TRANSFORMS if latched else BETWEEN_STAGES)
        note = f"; {sum(unknown.values())} messages of types that are not installed here left out"
        self.left_out = f"{note} ({', '.join(sorted(unknown))})" if unknown else ""
        self._clock = node.create_publisher(Clock, "/clock", BETWEEN_STAGES) if clock else None

    def send(self, name: str, data: bytes) -> None:
        """Publish the bytes of a message."""
        if name in self._publishers:
            self._publishers[name].publish(data)

    def tick(self, time_ns: int) -> None:
        """Publish the time of the bag."""
        if self._clock is not None:
            self._clock.publish(Clock(clock=time_to_msg(time_ns)))

    def listeners(self) -> int:
        """How many subscribe to the skeletons."""
        return min(int(publisher.get_subscription_count()) for publisher in self._skeletons)

    def finish(self) -> None:
        """Let the last messages arrive."""
        for publisher in self._skeletons:
            publisher.wait_for_all_acked(Duration(seconds=1.0))

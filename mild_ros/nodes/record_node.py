# SPDX-License-Identifier: Apache-2.0
"""Records topics into a bag: the exact bytes that came, with the time of their receipt.

A full disk or a kill costs at most the last second: see `bag/writer.py`.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import Header

from mild_core.errors import SetupError
from mild_core.printable import printable_lines
from mild_ros.assembly.bag_settings import FIRST_HEARD, RecordParameters
from mild_ros.bag.writer import create_bag
from mild_ros.messages.message_types import message_class
from mild_ros.node_kit.clock import steady_clock
from mild_ros.node_kit.guarded import GuardedNode
from mild_ros.node_kit.parameters import declare
from mild_ros.node_kit.quality_of_service import HANDLED, as_offered, is_latched
from mild_ros.node_kit.running import give_up, giving_up, has_given_up, run

LOOK_PERIOD_S, FLUSH_PERIOD_S = 0.1, 1.0
DEPTH = 5000
"""Half a minute of everything at the usual rates: a slow disk must not lose messages."""


OVERLAP_S = 2.0
"""A message that came by one subscription comes by another within this time, if it does."""


LARGE_BYTES = 100_000
"""A picture that only one subscription can bring is not looked at: to compare bytes takes a nanosecond for each."""


class OnceEach:
    """Which messages of a topic to keep where several subscriptions bring the same ones.

    rclpy does not give a subscriber the sender of a message, so equal bytes count: the n-th time that a subscription
    brings them is the n-th message of these bytes. Of messages that only some subscriptions get, none is lost.
    """

    def __init__(self) -> None:
        self._newest: OrderedDict[int, tuple[float, dict[Hashable, int]]] = OrderedDict()

    def is_new(self, subscription: Hashable, data: bytes, now_s: float) -> bool:
        """Whether this is the first time that this message comes, by any subscription."""
        while self._newest and now_s - next(iter(self._newest.values()))[0] > OVERLAP_S:
            self._newest.popitem(last=False)
        key = hash(data)
        _, counts = self._newest.pop(key, (now_s, {}))
        kept = max(counts.values(), default=0)
        counts[subscription] = counts.get(subscription, 0) + 1
        self._newest[key] = (now_s, counts)
        return counts[subscription] > kept


class RecordNode(GuardedNode):
    """Subscribes to whatever is published and writes it down."""

    def __init__(self) -> None:
        super().__init__("record")
        self.parameters = declare(self, RecordParameters)
        if not self.parameters.bag:
            raise SetupError("parameter bag", "is empty", "name a new folder, e.g. -p bag:=recording")
        self._wanted = {self.resolve_topic_name(topic) for topic in self.parameters.topics}
        split_bytes = round(self.parameters.split_mb * 1e6)
        self._recording = create_bag(Path(self.parameters.bag).expanduser(), durable=True, split_bytes=split_bytes)
        self._bag = self._recording.__enter__()
        self._types: dict[str, str] = {}
        self._subscribed: dict[str, set[Hashable]] = {}
        self._came: dict[str, OnceEach] = {}
        self._passed_over: dict[str, None] = {}
        self._latched: set[str] = set()
        self._heard: set[str] = set()
        self._simulated = bool(self.get_parameter("use_sim_time").value)
        self._early: list[tuple[str, bytes]] = []
        self._before_clock = 0
        reporting = self.parameters.report_recorded
        self._recorded = self.create_publisher(Header, "recorded", HANDLED) if reporting else None
        self._handled = self.resolve_topic_name("handled")
        self._look()
        self.create_timer(LOOK_PERIOD_S, self._look, clock=steady_clock())
        self.create_timer(FLUSH_PERIOD_S, self._flush, clock=steady_clock())
        self.get_logger().info(f"recording {', '.join(sorted(self._wanted)) or 'all topics'} into {self._bag.path}")

    def destroy_node(self) -> None:
        """End the bag, then the node."""
        try:
            self._recording.__exit__(None, None, None)
        except SetupError as error:  # at the very end too this is one line
            give_up(self, error)
        passed = f"; not recorded: {', '.join(sorted(self._passed_over))}" if self._passed_over else ""
        if before := self._before_clock + len(self._early):
            passed += f"; {before} from before the first /clock, which have no time"
        if self._bag.counts or not has_given_up(self):  # otherwise nothing is there
            said = f"mild_ros record: {sum(self._bag.counts.values())} messages in {self._bag.path}{passed}"
            print(printable_lines(said), flush=True)
        super().destroy_node()  # type: ignore[no-untyped-call]

    def _look(self) -> None:
        """Subscribe to topics that have appeared, and to new publishers of those there are; write what has waited."""
        with giving_up(self):
            self._write_early()
        for topic, types in self.get_topic_names_and_types():
            if self._wanted and topic not in self._wanted:
                continue
            offers = self.get_publishers_info_by_topic(topic)
            if offers and topic not in self._types:
                self._types[topic] = self._announced(topic, types, offers)
            kind = self._types.get(topic)
            for offer in offers if kind else ():
                if offer.topic_type == kind:
                    self._subscribe(topic, offer)
                else:
                    self._pass_over(f"{topic} of {offer.node_name}", f"it is {offer.topic_type}, not {kind}")

    def _announced(self, topic: str, types: list[str], offers: list[TopicEndpointInfo]) -> str:
        """The type of a topic that has appeared, which the bag now knows; "" if it cannot be recorded."""
        problem = f"it has several types, {', '.join(types)}" if len(types) != 1 else ""
        problem = problem or ("" if message_class(types[0]) else f"the type {types[0]} is not installed here")
        try:
            if not problem:
                self._bag.add_topic(topic, types[0], transient_local=is_latched(offers))
                if is_latched(offers):
                    self._latched.add(topic)
                return types[0]
        except KeyError:
            problem = f"the type {types[0]} is not known to bags"
        self._pass_over(topic, problem)
        return ""

    def _pass_over(self, what: str, problem: str) -> None:
        if what not in self._passed_over:
            self._passed_over[what] = None
            self.get_logger().warning(f"{what} is not recorded: {problem}")

    def _subscribe(self, topic: str, offer: TopicEndpointInfo) -> None:
        """Take what this publisher offers, as it offers it, unless that is done already."""
        quality = as_offered(offer, DEPTH)
        subscribed = self._subscribed.setdefault(topic, set())
        how = (quality.reliability, quality.durability)
        if how in subscribed:
            return
        if subscribed:
            self.get_logger().info(f"{topic} has another publisher, of other QoS ({offer.node_name}): recorded too")
        subscribed.add(how)
        once = self._came.setdefault(topic, OnceEach())
        # A publisher that does not match this subscription has another one: no warning that its messages will not be
        # received.
        events = SubscriptionEventCallbacks(incompatible_qos=lambda _: None)

        def is_wanted(data: bytes) -> bool:
            alone = len(subscribed) == 1 and len(data) > LARGE_BYTES
            return alone or once.is_new(how, data, time.monotonic())

        kind = message_class(self._types[topic])
        self.create_subscription(kind, topic, self._writer(topic, is_wanted), quality, raw=True, event_callbacks=events)

    def _writer(self, topic: str, is_wanted: Callable[[bytes], bool]) -> Callable[[bytes], Any]:
        def write(data: bytes) -> None:
            with giving_up(self):
                if not is_wanted(data):
                    return
                if topic not in self._heard:
                    self._heard.add(topic)
                    self.get_logger().info(FIRST_HEARD.format(topic))
                self._write(topic, data)

        return write

    def _write(self, topic: str, data: bytes) -> None:
        """Write a message down, and say so to a replay in lock-step that waits for it.

        Before the first `/clock` of a simulation there is no time: what is latched waits for it, and what a replay
        waits for, which may overtake that clock; all else is left out.
        """
        if not self._has_time():
            if topic in self._latched or self._is_awaited(topic, data):
                self._early.append((topic, data))
            else:
                self._before_clock += 1
            return
        self._write_early()
        self._put(topic, data)

    def _has_time(self) -> bool:
        return not self._simulated or self.get_clock().now().nanoseconds > 0

    def _is_awaited(self, topic: str, data: bytes) -> bool:
        """Whether a replay waits until this outcome is written down: it is of something that the replay has sent."""
        if self._recorded is None or topic != self._handled:
            return False
        stamp = deserialize_message(data, Header).stamp
        return bool(stamp.sec or stamp.nanosec)

    def _write_early(self) -> None:
        """Write what has waited for the first `/clock`, if that has come."""
        if self._early and self._has_time():
            early, self._early = self._early, []
            for topic, data in early:
                self._put(topic, data)

    def _put(self, topic: str, data: bytes) -> None:
        self._bag.write(topic, self._types[topic], self.get_clock().now().nanoseconds, data)
        if self._recorded is not None and topic == self._handled:
            self._recorded.publish(data)

    def _flush(self) -> None:
        with giving_up(self):
            self._bag.flush()


def main() -> int:
    """Entry point of `ros2 run mild_ros record`."""
    return run("record", RecordNode, RecordParameters)


if __name__ == "__main__":
    raise SystemExit(main())

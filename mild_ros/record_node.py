# SPDX-License-Identifier: Apache-2.0
"""Records topics into a bag: the exact bytes that came, with the time of their receipt.

A full disk or a kill costs at most the last second: see `bag_writer.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import Header

from mild_core.errors import SetupError
from mild_core.printable import printable_lines
from mild_ros.bag_settings import FIRST_HEARD, RecordParameters
from mild_ros.bag_writer import create_bag
from mild_ros.clock import steady_clock
from mild_ros.guarded import GuardedNode
from mild_ros.message_types import message_class
from mild_ros.parameters import declare
from mild_ros.quality_of_service import FATE, is_latched, strictest
from mild_ros.running import give_up, giving_up, has_given_up, run

LOOK_PERIOD_S, FLUSH_PERIOD_S = 0.1, 1.0
DEPTH = 5000
"""Half a minute of everything at the usual rates: a slow disk must not lose messages."""


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
        self._known: set[str] = set()
        self._latched: set[str] = set()
        self._heard: set[str] = set()
        self._passed_over: list[str] = []
        self._simulated = bool(self.get_parameter("use_sim_time").value)
        self._early: list[tuple[str, str, bytes]] = []
        self._before_clock = 0
        reporting = self.parameters.report_recorded
        self._recorded = self.create_publisher(Header, "recorded", FATE) if reporting else None
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
        """Subscribe to topics that have appeared."""
        for topic, types in self.get_topic_names_and_types():
            if topic in self._known or (self._wanted and topic not in self._wanted):
                continue
            offers = self.get_publishers_info_by_topic(topic)
            if offers:
                self._known.add(topic)
                self._subscribe(topic, types, offers)

    def _subscribe(self, topic: str, types: list[str], offers: list[TopicEndpointInfo]) -> None:
        kind = message_class(types[0])
        problem = f"it has several types, {', '.join(types)}" if len(types) != 1 else ""
        problem = problem or ("" if kind else f"the type {types[0]} is not installed here")
        try:
            if not problem:
                self._bag.add_topic(topic, types[0], transient_local=is_latched(offers))
            if is_latched(offers):
                self._latched.add(topic)
        except KeyError:
            problem = f"the type {types[0]} is not known to bags"
        if problem:
            self._passed_over.append(topic)
            self.get_logger().warning(f"{topic} is not recorded: {problem}")
            return
        self.create_subscription(kind, topic, self._writer(topic, types[0]), strictest(offers, DEPTH), raw=True)

    def _writer(self, topic: str, type_name: str) -> Callable[[bytes], None]:
        def write(data: bytes) -> None:
            with giving_up(self):
                if topic not in self._heard:
                    self._heard.add(topic)
                    self.get_logger().info(FIRST_HEARD.format(topic))
                self._write(topic, type_name, data)

        return write

    def _write(self, topic: str, type_name: str, data: bytes) -> None:
        """Write a message down, and say so to a replay in lock-step that waits for it.

        Before the first `/clock` of a simulation there is no time: what is latched waits for it, all else is left out.
        """
        now_ns = self.get_clock().now().nanoseconds
        if self._simulated and now_ns == 0:
            if topic in self._latched:
                self._early.append((topic, type_name, data))
            else:
                self._before_clock += 1
            return
        early, self._early = self._early, []
        for message in (*early, (topic, type_name, data)):
            self._bag.write(*message[:2], now_ns, message[2])
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

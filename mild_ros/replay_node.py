# SPDX-License-Identifier: Apache-2.0
"""`replay`: a bag's skeletons to the nodes, in lock-step with `/clock` or in real time."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from mild_core.errors import SetupError
from mild_core.perception.skeletons import SOURCES
from mild_core.retargeting.robots import ROBOTS
from mild_ros.bag_settings import ReplayParameters
from mild_ros.bags import open_bag
from mild_ros.clock import steady_clock
from mild_ros.messages.handled import handled_from_msg
from mild_ros.messages.skeletons import ADAPTERS
from mild_ros.messages.stamps import time_to_msg
from mild_ros.parameters import declare
from mild_ros.quality_of_service import BETWEEN_STAGES, FATE
from mild_ros.replay import JOINT_STATES, SKELETON, TRUE_MOTION, Inputs, with_ticks
from mild_ros.running import run
from mild_ros.sending import LockStep, play_in_real_time

LOOK_PERIOD_S, SETTLING_S = 0.05, 0.5
"""Nodes get this long to find each other once enough subscribers are seen."""


class ReplayNode(Node):
    """Publishes what a bag holds, when everybody listens, and ends."""

    def __init__(self) -> None:
        super().__init__("replay")
        self.parameters = declare(self, ReplayParameters)
        if not self.parameters.bag:
            raise SetupError("parameter bag", "is empty", "name a bag, e.g. -p bag:=bags/handshake")
        self._in_lock_step = self.parameters.mode == "lock_step"
        source = SOURCES[self.parameters.source]
        auto = "auto" if self._in_lock_step else "none"
        states = auto if self.parameters.joint_states == "auto" else self.parameters.joint_states
        inputs = Inputs(source, ROBOTS[self.parameters.robot], self.parameters.skeleton_topic, states)
        self._bags = ExitStack()
        self._bag = self._bags.enter_context(open_bag(Path(self.parameters.bag), salvage=self.parameters.salvage))
        self._events = inputs.messages(self._bag)
        self._publishers_by_input: dict[str, Publisher] = {
            SKELETON: self.create_publisher(ADAPTERS[source.message].message_type, "skeleton", BETWEEN_STAGES)
        }
        if f"/{TRUE_MOTION}" in self._bag.topics:
            self._publishers_by_input[TRUE_MOTION] = self.create_publisher(JointState, TRUE_MOTION, BETWEEN_STAGES)
        if states != "none":
            self._publishers_by_input[JOINT_STATES] = self.create_publisher(JointState, "joint_states", BETWEEN_STAGES)
        if self._in_lock_step:
            self._clock_publisher = self.create_publisher(Clock, "/clock", BETWEEN_STAGES)
            self._fates = self.create_subscription(Header, "handled", self._on_handled, FATE)
            events = with_ticks(self._events, self.parameters.control_rate_hz)
            self._lock_step = LockStep(events, self._send, self._tick, self.parameters.patience_s)
        self._waited_s = self._settled_s = 0.0
        self._starting = self.create_timer(LOOK_PERIOD_S, self._start_when_heard, clock=steady_clock())

    def _start_when_heard(self) -> None:
        """Start once everybody listens: a message before that would be lost."""
        self._waited_s += LOOK_PERIOD_S
        listeners = self._publishers_by_input[SKELETON].get_subscription_count()
        heard = listeners >= self.parameters.subscribers
        if self._in_lock_step:
            heard = heard and self._fates.get_publisher_count() >= self.parameters.reporters
        self._settled_s = self._settled_s + LOOK_PERIOD_S if heard else 0.0
        if not heard and self._waited_s > self.parameters.patience_s:
            remedy = "start the pipeline (in lock-step with -p report_handled:=true -p use_sim_time:=true)"
            topic = self.resolve_topic_name("skeleton")
            raise SetupError("replay", f"{listeners} subscribers of {topic} after {self._waited_s:.0f} s", remedy)
        if self._settled_s < SETTLING_S:
            return
        self.destroy_timer(self._starting)
        self.get_logger().info(f"replaying {self.parameters.bag} ({self.parameters.mode})")
        if self._in_lock_step:
            self.create_timer(LOOK_PERIOD_S, self._lock_step.check, clock=steady_clock())
            self._advance()
            return
        rate, restamp = self.parameters.rate, self.parameters.restamp
        self._end(play_in_real_time(self._bag, self._events, self._send, rate, restamp, rclpy.ok))

    def _on_handled(self, message: Any) -> None:
        if self._lock_step.is_done_after(handled_from_msg(message)):
            self._advance()

    def _advance(self) -> None:
        if not self._lock_step.advance():
            self._end(self._lock_step.sent)

    def _send(self, name: str, data: bytes) -> None:
        self._publishers_by_input[name].publish(data)

    def _tick(self, time_ns: int) -> None:
        self._clock_publisher.publish(Clock(clock=time_to_msg(time_ns)))

    def _end(self, sent: int) -> None:
        """Let the last messages arrive, then end this program."""
        if rclpy.ok():
            self._publishers_by_input[SKELETON].wait_for_all_acked(Duration(seconds=1.0))
        print(f"mild_ros replay: {sent} events of {self.parameters.bag}", flush=True)
        self._bags.close()
        rclpy.try_shutdown()


def main() -> int:
    """Entry point of `ros2 run mild_ros replay`."""
    return run("replay", ReplayNode, ReplayParameters)


if __name__ == "__main__":
    raise SystemExit(main())

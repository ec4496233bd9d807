# SPDX-License-Identifier: Apache-2.0
"""`replay`: a bag's skeletons to the nodes, in lock-step with `/clock` or in real time."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from std_msgs.msg import Header
from std_srvs.srv import SetBool

from mild_core.errors import SetupError
from mild_core.printable import printable_lines
from mild_core.retargeting.robot_file import find_robot
from mild_ros.assembly.bag_settings import ReplayParameters
from mild_ros.bag.reader import open_bag
from mild_ros.messages.handled import handled_from_msg
from mild_ros.node_kit.clock import steady_clock
from mild_ros.node_kit.guarded import GuardedNode
from mild_ros.node_kit.parameters import declare
from mild_ros.node_kit.quality_of_service import HANDLED
from mild_ros.node_kit.running import giving_up, run
from mild_ros.replay.events import with_ticks
from mild_ros.replay.in_process import Inputs
from mild_ros.replay.sending import (
    LOOK_PERIOD_S,
    START_PIPELINE,
    START_RECORDER,
    LockStep,
    RealTime,
    SubscriberWait,
    Wanted,
)
from mild_ros.replay.topics import ReplayTopics


class ReplayNode(GuardedNode):
    """Publishes what a bag holds, when everybody listens, and ends."""

    def __init__(self) -> None:
        super().__init__("replay")
        given = self.parameters = declare(self, ReplayParameters)
        if not given.bag:
            raise SetupError("parameter bag", "is empty", "name a bag, e.g. -p bag:=bags/handshake")
        self._in_lock_step = given.mode == "lock_step"
        states = given.joint_states if given.joint_states != "auto" or self._in_lock_step else "none"
        inputs = Inputs(
            given.tracker(), find_robot(given.robot), given.skeleton_topic, states, given.start_s, given.also
        )
        self._bags = ExitStack()
        self._bag = self._bags.enter_context(open_bag(Path(given.bag).expanduser(), salvage=given.salvage))
        for odd in filter(None, (self._bag.lost, inputs.note(self._bag), inputs.clock(self._bag).note)):
            self.get_logger().warning(f"{given.bag}: {odd}")
        ticking = self._in_lock_step or given.clock
        self._topics = ReplayTopics(self, self._bag, inputs, ticking)
        events = inputs.laps(self._bag, forever=given.loop)
        events = with_ticks(events, given.control_rate_hz) if ticking else events
        self._sender: LockStep | RealTime
        if self._in_lock_step:
            self._sender = LockStep(
                events, self._topics.send, self._topics.tick, given.patience_s, given.reporters, given.recorders
            )
        else:
            restamped = self._bag if given.restamp and not given.clock else None
            self._sender = RealTime(events, self._topics.send, self._topics.tick, given.rate, restamped)
        handled = self.create_subscription(Header, "handled", self._on_handled, HANDLED)
        recorded = self.create_subscription(Header, "recorded", self._on_recorded, HANDLED)
        skeleton = self.resolve_topic_name("skeleton")
        wanted = [Wanted(self._topics.listeners, given.subscribers, f"subscribers of {skeleton}", START_PIPELINE)]
        if self._in_lock_step:
            # A recorder looks for topics now and then: an outcome before it hears of them would be lost to it.
            hear = partial(self.count_subscribers, "handled")
            wanted += [
                Wanted(handled.get_publisher_count, given.reporters, "publishers of handled", START_PIPELINE),
                Wanted(recorded.get_publisher_count, given.recorders, "publishers of recorded", START_RECORDER),
                Wanted(hear, 1 + given.recorders, "subscribers of handled", START_RECORDER),
            ]
        self._audience = SubscriberWait(wanted, given.patience_s)
        self._paused, self._started, self._held = given.paused, False, False
        self.create_service(SetBool, "~/pause", self._on_pause)
        self._acting = self.create_timer(LOOK_PERIOD_S, self._start_when_heard, clock=steady_clock())

    def _start_when_heard(self) -> None:
        with giving_up(self):
            if self._paused or not self._audience.is_there(LOOK_PERIOD_S):
                return
            self.destroy_timer(self._acting)
            self.get_logger().info(f"replaying {self.parameters.bag} ({self.parameters.mode})")
            self._started = True
            self._acting = self.create_timer(self._sender.period_s, self._look, clock=steady_clock())
            self._advance()

    def _look(self) -> None:
        with giving_up(self):
            if self._sender.is_due():
                self._advance()

    def _on_handled(self, message: Any) -> None:
        if self._sender.is_done_after(handled_from_msg(message)):
            self._advance()

    def _on_recorded(self, message: Any) -> None:
        if self._sender.is_done_once_recorded(handled_from_msg(message)):
            self._advance()

    def _on_pause(self, wish: Any, answer: Any) -> Any:
        self._paused, answer.success = bool(wish.data), True
        answer.message = "paused" if self._paused else "goes on"
        if self._started and self._paused:
            self._sender.pause()
        elif self._started and self._held:
            self._advance()
        return answer

    def _advance(self) -> None:
        self._held = self._paused
        with giving_up(self):
            if not self._paused and not self._sender.advance():
                self._end()

    def _end(self) -> None:
        """Let the last messages arrive, then end this program."""
        self._acting.cancel()
        self._topics.finish()
        rclpy.try_shutdown()

    def destroy_node(self) -> None:
        """Say what was sent, then end."""
        sent = f"{self._sender.sent} events of {self.parameters.bag}"
        print(printable_lines(f"mild_ros replay: {sent}{self._topics.left_out}"), flush=True)
        self._bags.close()
        super().destroy_node()  # type: ignore[no-untyped-call]


def main() -> int:
    """Entry point of `ros2 run mild_ros replay`."""
    return run("replay", ReplayNode, ReplayParameters)


if __name__ == "__main__":
    raise SystemExit(main())

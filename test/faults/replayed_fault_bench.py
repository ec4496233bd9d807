# SPDX-License-Identifier: Apache-2.0
"""Simulated time in lock-step, all stages in one process, as in a replay: for faults of messages and of the clock.

Time goes on when everything that was sent is handled, so a busy machine changes nothing.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from mild_core.signals import JointMeasurement
from mild_ros.environment.processes import Nodes
from mild_ros.messages.stamps import time_to_msg
from mild_ros.node_kit.quality_of_service import HANDLED, STATE
from test.faults.fault_bench import ROBOT, FaultBench, stage_parameters
from test.faults.table import Fault

CONTROL_HZ = 50.0
"""Half the usual: less to compute."""

TICK_NS = round(1e9 / CONTROL_HZ)

START_NS = 1_700_000_000_000_000_000

PATIENCE_S = 1.0
"""A message without an outcome within this time was dropped: trackers and clocks are best effort."""


class ReplayFaultBench(FaultBench):
    """As in a replay, with a robot that is where it was commanded to be."""

    def __init__(self, nodes: Nodes, domain: int) -> None:
        super().__init__(nodes, domain, ("pipeline",))
        self._now_ns = self._due_ns = START_NS
        self._handled = 0
        self._clock = self._node.create_publisher(Clock, "/clock", STATE)
        self._node.create_subscription(Header, "handled", self._on_handled, HANDLED)
        started = {"use_sim_time": True, "report_handled": True, "control_rate_hz": CONTROL_HZ}
        nodes.start("pipeline", {**stage_parameters("pipeline"), **started})

    def now_ns(self) -> int:
        """The time on `/clock`."""
        return self._now_ns

    def _begin(self, fault: Fault) -> None:
        if fault.clock_s:
            self._now_ns += round(fault.clock_s * 1e9)
            self._due_ns = self._now_ns
            self.human.restart()
        super()._begin(fault)

    def _live(self) -> None:
        self._now_ns += TICK_NS
        self._answered(self._clock.publish, Clock(clock=time_to_msg(self._now_ns)))
        pose = np.array(self.commands[-1].positions_rad) if self.commands else ROBOT.home_rad
        handled = self._handled
        if self._publish_joints(JointMeasurement(self._now_ns, ROBOT.joint_names, pose)):
            self._await(handled)
        while self._due_ns <= self._now_ns:
            for message in self._see(self._due_ns):
                self._answered(self._skeletons.publish, message)
            self._due_ns += self._period_ns

    def _meanwhile(self) -> None:
        self._executor.spin_once(timeout_sec=0.1)

    def _answered(self, publish: Any, message: Any) -> None:
        handled = self._handled
        publish(message)
        self._await(handled)

    def _await(self, handled: int) -> None:
        """Wait until one more message is handled than `handled`."""
        deadline_s = time.monotonic() + PATIENCE_S
        while self._handled == handled and time.monotonic() < deadline_s:
            self._executor.spin_once(timeout_sec=PATIENCE_S)

    def _on_handled(self, _: Any) -> None:
        self._handled += 1

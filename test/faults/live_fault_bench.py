# SPDX-License-Identifier: Apache-2.0
"""Real time, three nodes and a simulated robot, as on a real robot: for faults of processes, rates and silence."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from sensor_msgs.msg import JointState

from mild_core.signals import JointMeasurement
from mild_ros.environment.processes import Nodes
from mild_ros.messages.joint_state import joint_measurement_from_msg
from mild_ros.node_kit.quality_of_service import SENSOR
from test.faults.fault_bench import ROBOT, FaultBench, stage_parameters
from test.faults.table import Fault

STAGES = ("perception", "inference", "retargeting")

REPORTED = "robot/joint_states"
"""Where the simulated robot says the truth."""

LONGEST_WAIT_S = 0.005

LATEST_NS = 100_000_000
"""What a busy machine keeps the tracker from saying for longer is left out."""

COUNTING = (sys.executable, "-P", "-S", "-E", "-c", "while True: pass")
"""Keeps a core busy."""


class LiveFaultBench(FaultBench):
    """As on a real robot."""

    def __init__(self, nodes: Nodes, domain: int) -> None:
        super().__init__(nodes, domain, ("simulation", *STAGES))
        self._node.create_subscription(JointState, REPORTED, self._on_measured, SENSOR)
        nodes.start("simulation", {"rate_hz": 50.0}, {"joint_states": REPORTED})
        for name in STAGES:
            rate = {"control_rate_hz": 50.0} if name == "retargeting" else {}
            nodes.start(name, {**stage_parameters(name), **rate})

    def now_ns(self) -> int:
        """The time of the wall."""
        return time.time_ns()

    @contextmanager
    def suffering(self, fault: Fault) -> Iterator[int]:
        """As of any room, and processes suffer too."""
        with super().suffering(fault) as started_ns, self._struck(fault):
            yield started_ns

    @contextmanager
    def _struck(self, fault: Fault) -> Iterator[None]:
        match fault.processes:
            case "killed":
                self._nodes.kill("inference")
                yield
                self._nodes.start("inference", {})
            case "stopped":
                self._nodes.signal("retargeting", signal.SIGSTOP)
                try:
                    yield
                finally:
                    self._nodes.signal("retargeting", signal.SIGCONT)
            case "loaded":
                busy = [subprocess.Popen(COUNTING) for _ in range(2 * (os.cpu_count() or 1))]
                try:
                    yield
                finally:
                    for process in busy:
                        process.kill()
                        process.wait()
            case _:
                yield

    def _live(self) -> None:
        now_ns = self.now_ns()
        self.longest_pause_s = max(self.longest_pause_s, (now_ns - self._due_ns) * 1e-9)
        self._due_ns = max(self._due_ns, now_ns - LATEST_NS)
        while self._due_ns <= now_ns:
            for message in self._see(self._due_ns):
                self._skeletons.publish(message)
            self._due_ns += self._period_ns
        heard = -1
        while heard != self._heard:  # one call takes one message
            heard = self._heard
            wait_s = (self._due_ns - self.now_ns()) * 1e-9
            self._executor.spin_once(timeout_sec=min(max(wait_s, 0.0), LONGEST_WAIT_S))

    def _on_measured(self, message: Any) -> None:
        measured = joint_measurement_from_msg(message)
        of_arm = [measured.joint_names.index(name) for name in ROBOT.joint_names]
        self._publish_joints(JointMeasurement(measured.stamp_ns, ROBOT.joint_names, measured.positions_rad[of_arm]))

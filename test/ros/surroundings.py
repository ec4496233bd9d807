# SPDX-License-Identifier: Apache-2.0
"""What stands around our nodes, played by a test: the robot's own state, a person, an operator who reads."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray
from sensor_msgs.msg import JointState

from mild_core.perception.skeletons import SOURCES, SkeletonSource
from mild_core.retargeting.robots import ROBOTS
from mild_core.shapes import FloatArray
from mild_core.signals import JointMeasurement, SkeletonFrame
from mild_ros.messages.joint_state import joint_measurement_to_msg
from mild_ros.messages.marker_array import people_to_marker_array
from mild_ros.messages.pose_array import person_to_pose_array
from mild_ros.messages.skeletons import ADAPTERS
from mild_ros.simulation.person import bodies, skeleton_frames
from test.ros.processes import Probe
from tools.scenes import SCENES, arm_track

YUMI = ROBOTS["yumi"]
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Surroundings:
    """A robot that says where it is, and ears for commands and diagnostics.

    Args:
        probe: The node that plays it.
        node: Whose diagnostics to read.
    """

    def __init__(self, probe: Probe, node: str) -> None:
        self.probe, self.name = probe, node
        self.states = probe.node.create_publisher(JointState, "joint_states", 100)
        self.commands: list[Any] = probe.listen(JointState, "joint_command")
        self.reports: list[Any] = []
        probe.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 50)

    def _on_report(self, message: Any) -> None:
        self.reports += [status for status in message.status if status.name == self.name]

    def connect(self, *publishers: Any) -> None:
        """Wait until the node hears these and we hear it."""
        for publisher in publishers:
            self.probe.matched(publisher)
        self.probe.until(lambda: self.reports, f"diagnostics of {self.name}")

    def measure(self, positions: FloatArray = YUMI.home_rad) -> None:
        """Say that the robot is there."""
        stamped = JointMeasurement(self.probe.now_ns(), YUMI.joint_names, positions)
        self.states.publish(joint_measurement_to_msg(stamped))

    def obey(self) -> None:
        """Say that the robot is where it was commanded to be; at home before the first command."""
        self.measure(np.array(self.commands[-1].position) if self.commands else YUMI.home_rad)

    def commands_reach(self, pose: FloatArray) -> bool:
        """The newest command is at `pose` to a thousandth of a radian: the end of a smooth stop takes its time."""
        return bool(self.commands) and np.allclose(self.commands[-1].position, pose, rtol=0.0, atol=1e-3)

    def status(self) -> tuple[bytes, str, dict[str, str]]:
        """Level, message and values of the newest report."""
        status = self.reports[-1]
        return status.level, status.message, {pair.key: pair.value for pair in status.values}

    def until_counted(self, *keys: str, meanwhile: Callable[[], Any] = lambda: None) -> None:
        """Wait until the diagnostics count each of these."""
        for key in keys:
            self._until(lambda key=key: key in self.status()[2], f"a count of {key}", meanwhile)

    def until_status(self, level: bytes, text: str, meanwhile: Callable[[], Any] = lambda: None) -> dict[str, str]:
        """Wait for a report of this level with this text in its message; its values."""
        self._until(lambda: self.status()[0] == level and text in self.status()[1], f"status {text!r}", meanwhile)
        return self.status()[2]

    def _until(self, happened: Callable[[], bool], what: str, meanwhile: Callable[[], Any]) -> None:
        def found() -> bool:
            meanwhile()
            return happened()

        self.probe.until(found, what, seen=lambda: [(report.level, report.message) for report in self.reports[-3:]])


class Person:
    """A kinematic person before a tracker at 30 Hz, in real time: the first of our scenes, over and over.

    Args:
        probe: The node that publishes it.
        source: The tracker's convention.
    """

    RATE_HZ = 30.0

    def __init__(self, probe: Probe, source: SkeletonSource = SOURCES["azure_kinect"]) -> None:
        self._source = source
        self.publisher = probe.node.create_publisher(ADAPTERS[source.message].message_type, "skeleton", 100)
        self._frames = list(skeleton_frames(bodies(arm_track(SCENES[1], self.RATE_HZ)), self.RATE_HZ, 0))
        self._start_ns = time.time_ns()
        self._sent = 0

    def act(self, change: Callable[[SkeletonFrame], SkeletonFrame | None] = lambda frame: frame) -> None:
        """Publish what is due, after `change`; None makes it a message without a person in it."""
        period_ns = round(1e9 / self.RATE_HZ)
        due = (time.time_ns() - self._start_ns) // period_ns
        if due <= self._sent:
            return
        self._sent = due
        still = self._frames[0] if due < self.RATE_HZ else self._frames[due % len(self._frames)]
        seen = SkeletonFrame(
            stamp_ns=self._start_ns + due * period_ns,
            frame_id=still.frame_id,
            person_id=still.person_id,
            joint_names=still.joint_names,
            positions_m=still.positions_m + 1e-6 * (due % 7),  # no living person is still to the bit
            confidence=still.confidence,
        )
        changed = change(seen)
        if self._source.message == "pose_array":
            self.publisher.publish(person_to_pose_array(changed, self._source) if changed else PoseArray())
        else:
            self.publisher.publish(people_to_marker_array([changed] if changed else [], self._source))

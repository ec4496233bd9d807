# SPDX-License-Identifier: Apache-2.0
"""`retargeting`: the robot's next motion in, commands inside every limit out."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import JointState, PointCloud2

from mild_core.errors import DataError
from mild_core.retargeting.stage import Request, RetargetingInput
from mild_core.signals import JointMeasurement, PersonPose
from mild_ros.assembly.perception import manifest_of
from mild_ros.assembly.retargeting import make_retargeting
from mild_ros.clock import NodeClock
from mild_ros.commanding import Commanding
from mild_ros.diagnostics import Diagnostics
from mild_ros.fates import Fates
from mild_ros.guarded import GuardedNode
from mild_ros.life_topics import LifeTopics
from mild_ros.messages.motion import motion_from_msgs, motion_type
from mild_ros.messages.person import person_from_msg
from mild_ros.messages.stamps import ns_from_msg
from mild_ros.pairing import StampPairs
from mild_ros.parameters import declare
from mild_ros.quality_of_service import BETWEEN_STAGES, SENSOR
from mild_ros.running import run
from mild_ros.settings import RetargetingParameters


class RetargetingNode(GuardedNode):
    """The retargeting stage and its topics."""

    def __init__(self) -> None:
        super().__init__("retargeting")
        parameters = declare(self, RetargetingParameters)
        manifest = manifest_of(parameters.model)
        self._stage = make_retargeting(parameters, manifest)
        self._state = self._stage.init()
        self._diagnostics = Diagnostics(self, ("motion", "joint_states"), parameters.robot, self._look)
        self._fates = Fates(self, parameters.report_handled)
        self._commanding = Commanding(self, self._diagnostics, self._request, parameters, self._stage)
        self._life = LifeTopics(self, self._request)
        self._time = NodeClock(self, self._diagnostics, self._on_tick, parameters.control_rate_hz)
        pairs = StampPairs(self._on_motion, self._on_single)
        self.create_subscription(PointCloud2, "person", self._on_person, BETWEEN_STAGES)
        self.create_subscription(motion_type(manifest.controlled.kind), "motion", pairs.left, BETWEEN_STAGES)
        self.create_subscription(PointCloud2, "motion_state", pairs.right, BETWEEN_STAGES)
        self.create_subscription(JointState, "joint_states", self._on_joint_states, SENSOR)
        self.get_logger().info(f"commands {parameters.robot} at {parameters.control_rate_hz:g} Hz")

    def _on_tick(self, now_ns: int) -> None:
        self._step(None, now_ns, now_ns)

    def _on_motion(self, trajectory: Any, state: Any) -> None:
        started_ns, now_ns = time.perf_counter_ns(), self._time.now_ns()
        stamp_ns = ns_from_msg(trajectory.header.stamp)
        self._diagnostics.flowed("motion", stamp_ns)
        try:
            motion = motion_from_msgs(trajectory, state)
        except DataError as error:
            self._unreadable("motion", error, stamp_ns)
            return
        self._step(motion, now_ns, stamp_ns)
        self._diagnostics.took("step", time.perf_counter_ns() - started_ns)
        self._diagnostics.took("age of motion", self._time.now_ns() - stamp_ns)

    def _on_single(self, stamp_ns: int) -> None:
        self._unreadable("motion", DataError("unpaired", "motion and motion_state need equal stamps"), stamp_ns)

    def _on_joint_states(self, message: Any) -> None:
        self._read("joint_states", self._commanding.measured, message)

    def _on_person(self, message: Any) -> None:
        self._read("person", person_from_msg, message)

    def _read(self, topic: str, from_msg: Callable[[Any], JointMeasurement | PersonPose], message: Any) -> None:
        now_ns, stamp_ns = self._time.now_ns(), ns_from_msg(message.header.stamp)
        self._diagnostics.flowed(topic)
        try:
            given = from_msg(message)
        except DataError as error:
            self._unreadable(topic, error, stamp_ns)
            return
        self._step(given, now_ns, stamp_ns)

    def _step(self, given: RetargetingInput, now_ns: int, stamp_ns: int) -> None:
        self._state, commands = self._stage.step(self._state, given, now_ns)
        self._life.tell(self._state, commands)
        self._commanding.send(commands, self._state)
        self._fates.report("retargeting", 0, self._state.outcome, stamp_ns)
        self._diagnostics.ended("retargeting", self._state.outcome, self._state.counts, self._state.detail)

    def _unreadable(self, topic: str, error: DataError, stamp_ns: int) -> None:
        self._diagnostics.unreadable(topic, error.reason, error.detail)
        self._fates.report("retargeting", 0, error.reason, stamp_ns)

    def _request(self, request: Request) -> None:
        now_ns = self._time.now_ns()
        self._step(request, now_ns, now_ns)

    def _look(self) -> None:
        self._commanding.look_for_others()
        self._commanding.tell(self._state)


def main() -> int:
    """The executable."""
    return run("retargeting", RetargetingNode, RetargetingParameters)


if __name__ == "__main__":
    raise SystemExit(main())

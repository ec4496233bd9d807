# SPDX-License-Identifier: Apache-2.0
"""`retargeting`: the robot's next motion in, commands inside every limit out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from sensor_msgs.msg import JointState, PointCloud2

from mild_core.errors import DataError
from mild_core.signals import JointMeasurement, PersonPose
from mild_ros.assembly.perception import manifest_of
from mild_ros.assembly.retargeting import make_retargeting
from mild_ros.assembly.settings import RetargetingParameters
from mild_ros.messages.motion import motion_from_msgs, motion_type
from mild_ros.messages.person import person_from_msg
from mild_ros.messages.stamps import ns_from_msg
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.outcomes import OutcomePublisher
from mild_ros.node_kit.parameters import declare
from mild_ros.node_kit.quality_of_service import BETWEEN_STAGES, SENSOR
from mild_ros.node_kit.reception import JOINTS_KEPT, JOINTS_PER_S, Reception
from mild_ros.node_kit.running import run
from mild_ros.node_kit.threads import StageNode
from mild_ros.nodes.control import Control, Given
from mild_ros.replay.pairing import StampPairs


class RetargetingNode(StageNode):
    """The retargeting stage and its topics."""

    def __init__(self) -> None:
        super().__init__("retargeting")
        parameters = declare(self, RetargetingParameters)
        manifest = manifest_of(parameters.model)
        stage = make_retargeting(parameters, manifest)
        self._diagnostics = Diagnostics(self, ("motion", "joint_states"), parameters.robot, self._look)
        self._outcomes = OutcomePublisher(self, parameters.report_handled)
        reception = Reception(self, self._diagnostics)
        self._control = Control(
            self, stage, parameters, self._diagnostics, self._outcomes, lambda: None, "age of motion"
        )
        self._time = self._control.clock
        pairs = StampPairs(self._on_motion, self._on_single)
        reception.subscribe(PointCloud2, "person", partial(self._on, "person", person_from_msg), BETWEEN_STAGES)
        reception.subscribe(motion_type(manifest.controlled.kind), "motion", pairs.left, BETWEEN_STAGES)
        reception.subscribe(PointCloud2, "motion_state", pairs.right, BETWEEN_STAGES)
        joints = partial(self._on, "joint_states", self._control.commanding.measured)
        reception.subscribe(JointState, "joint_states", joints, SENSOR, kept=JOINTS_KEPT, per_s=JOINTS_PER_S)
        self.get_logger().info(f"commands {parameters.robot} at {parameters.control_rate_hz:g} Hz")

    def _on_motion(self, trajectory: Any, state: Any) -> None:
        now_ns, stamp_ns = self._time.now_ns(), ns_from_msg(trajectory.header.stamp)
        self._diagnostics.flowed("motion")
        try:
            motion = motion_from_msgs(trajectory, state)
        except DataError as error:
            self._unreadable("motion", error, stamp_ns)
            return
        self._control.put(Given(motion, now_ns, stamp_ns, stamp_ns))

    def _on_single(self, stamp_ns: int) -> None:
        self._unreadable("motion", DataError("unpaired", "motion and motion_state need equal stamps"), stamp_ns)

    def _on(self, topic: str, from_msg: Callable[[Any], JointMeasurement | PersonPose], message: Any) -> None:
        now_ns, stamp_ns = self._time.now_ns(), ns_from_msg(message.header.stamp)
        self._diagnostics.flowed(topic)
        try:
            given = from_msg(message)
        except DataError as error:
            self._unreadable(topic, error, stamp_ns)
            return
        self._control.put(Given(given, now_ns, stamp_ns))

    def _unreadable(self, topic: str, error: DataError, stamp_ns: int) -> None:
        self._diagnostics.unreadable(topic, error.reason, error.detail)
        self._outcomes.report("retargeting", 0, error.reason, stamp_ns)

    def _look(self) -> None:
        if self.is_in_order:
            self._control.commanding.watch()
        self._control.commanding.report(self._control.state)


def main() -> int:
    """The executable."""
    return run("retargeting", RetargetingNode, RetargetingParameters)


if __name__ == "__main__":
    raise SystemExit(main())

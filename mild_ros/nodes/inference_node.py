# SPDX-License-Identifier: Apache-2.0
"""`inference`: windows of the watched arm in, the robot's next motion out."""

from __future__ import annotations

import time
from typing import Any

from sensor_msgs.msg import JointState, PointCloud2

from mild_core.errors import DataError
from mild_ros.assembly.inference import load, make_inference
from mild_ros.assembly.settings import InferenceParameters
from mild_ros.commands.joint_naming import joint_naming
from mild_ros.messages.feature_window import feature_window_from_msg
from mild_ros.messages.joint_state import joint_measurement_from_msg
from mild_ros.messages.stamps import ns_from_msg
from mild_ros.node_kit.clock import NodeClock
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.operator_services import OperatorServices
from mild_ros.node_kit.outcomes import OutcomePublisher
from mild_ros.node_kit.parameters import declare
from mild_ros.node_kit.quality_of_service import BETWEEN_STAGES, SENSOR
from mild_ros.node_kit.reception import JOINTS_KEPT, JOINTS_PER_S, Reception
from mild_ros.node_kit.running import run
from mild_ros.node_kit.threads import StageNode
from mild_ros.nodes.motion_publishers import MotionPublishers


class InferenceNode(StageNode):
    """The inference stage and its topics."""

    def __init__(self) -> None:
        super().__init__("inference")
        parameters = declare(self, InferenceParameters)
        model = load(parameters.model)
        self._joint_names = model.manifest.observed.joint_names
        self._stage = make_inference(parameters, model)
        self._state = self._stage.init()
        self._diagnostics = Diagnostics(self, expected=("feature_window",))
        self._diagnostics.facts["model"] = parameters.model
        self._outcomes = OutcomePublisher(self, parameters.report_handled)
        self._reception = Reception(self, self._diagnostics)
        self._topics = MotionPublishers(self, model.manifest, self._diagnostics)
        self._time = NodeClock(self, self._diagnostics)
        self._operator = OperatorServices(self, self._diagnostics, self._reset)
        self._reception.subscribe(PointCloud2, "feature_window", self._on_window, BETWEEN_STAGES)
        ours = model.manifest.controlled.joint_names
        self._naming = joint_naming(ours, parameters.robot_joint_names if model.start_pose else ())
        self._reception.subscribe(
            JointState, "joint_states", self._on_joint_states, SENSOR, kept=JOINTS_KEPT, per_s=JOINTS_PER_S
        )
        self.get_logger().info(f"{parameters.model} knows {', '.join(model.manifest.interactions)}")

    def _on_window(self, message: Any) -> None:
        started_ns, now_ns = time.perf_counter_ns(), self._time.now_ns()
        stamp_ns = ns_from_msg(message.header.stamp)
        self._diagnostics.flowed("feature_window")
        try:
            window = feature_window_from_msg(message, self._joint_names)
        except DataError as error:
            self._diagnostics.unreadable("feature_window", error.reason, error.detail)
            self._outcomes.report("inference", 0, error.reason, stamp_ns)
            return
        if not self._operator.enabled:
            self._outcomes.report("inference", 0, "not_enabled", stamp_ns)
            return
        self._state, motions = self._stage.step(self._state, window, now_ns)
        for motion in motions:
            self._topics.publish_motion(motion)
        self._outcomes.report("inference", len(motions), self._state.outcome, stamp_ns)
        for motion in motions:
            self._topics.publish_recognition(motion)
            self._diagnostics.summary = motion.interaction or "unknown"
        self._diagnostics.took("step", time.perf_counter_ns() - started_ns)
        self._diagnostics.ended("inference", self._state.outcome, self._state.counts)

    def _on_joint_states(self, message: Any) -> None:
        now_ns, stamp_ns = self._time.now_ns(), ns_from_msg(message.header.stamp)
        self._diagnostics.flowed("joint_states")
        try:
            measurement = self._naming.understood(joint_measurement_from_msg(message))
        except DataError as error:
            self._diagnostics.unreadable("joint_states", error.reason, error.detail)
            self._outcomes.report("inference", 0, error.reason, stamp_ns)
            return
        self._state, _ = self._stage.step(self._state, measurement, now_ns)
        self._outcomes.report("inference", 0, self._state.outcome, stamp_ns)
        self._diagnostics.ended("inference", self._state.outcome, self._state.counts, self._state.detail)

    def _reset(self) -> str:
        with self._reception.lock:
            self._state = self._stage.reset(self._state)
        return "forgot what it believed"


def main() -> int:
    """The executable."""
    return run("inference", InferenceNode, InferenceParameters)


if __name__ == "__main__":
    raise SystemExit(main())

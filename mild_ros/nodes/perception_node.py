# SPDX-License-Identifier: Apache-2.0
"""`perception`: a tracker's people in, windows of the watched arm out."""

from __future__ import annotations

import time

from sensor_msgs.msg import PointCloud2

from mild_ros.assembly.calibration_file import CalibrationFile
from mild_ros.assembly.perception import make_perception, manifest_of
from mild_ros.assembly.settings import PerceptionParameters
from mild_ros.messages.feature_window import feature_window_to_msg
from mild_ros.messages.person import person_to_msg
from mild_ros.node_kit.clock import NodeClock
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.operator_services import OperatorServices
from mild_ros.node_kit.outcomes import OutcomePublisher
from mild_ros.node_kit.parameters import declare
from mild_ros.node_kit.quality_of_service import BETWEEN_STAGES
from mild_ros.node_kit.reception import Reception
from mild_ros.node_kit.running import run
from mild_ros.node_kit.threads import StageNode
from mild_ros.nodes.tracker import Sighting, Tracker

UNMEASURED = "no contact: robot_from_camera is empty; set it, or allow_unmeasured_contact of retargeting"
"""Said at the start: retargeting learns it from the first person."""


class PerceptionNode(StageNode):
    """The perception stage and its topics."""

    def __init__(self) -> None:
        super().__init__("perception")
        parameters = declare(self, PerceptionParameters)
        tracker = Tracker(parameters, "perception")
        self._stage = make_perception(parameters, manifest_of(parameters.model))
        self._state = self._stage.init()
        self._calibrations = CalibrationFile(parameters.calibration_file)
        self._diagnostics = Diagnostics(self, expected=("skeleton",), hardware_id=parameters.source)
        self._diagnostics.facts["model"] = parameters.model
        self._outcomes = OutcomePublisher(self, parameters.report_handled)
        self._reception = Reception(self, self._diagnostics)
        self._person = self.create_publisher(PointCloud2, "person", BETWEEN_STAGES)
        self._windows = self.create_publisher(PointCloud2, "feature_window", BETWEEN_STAGES)
        self._time = NodeClock(self, self._diagnostics)
        self._operator = OperatorServices(self, self._diagnostics, self._reset)
        tracker.listen(self, self._reception, self._time, self._diagnostics, self._outcomes, self._on_sight)
        self.get_logger().info(f"watching the {parameters.side} arm for {parameters.model}")
        if not parameters.robot_from_camera:
            self.get_logger().warning(UNMEASURED)

    def _on_sight(self, sight: Sighting) -> None:
        if not self._operator.enabled:
            self._outcomes.report("perception", 0, "not_enabled", sight.input_ns)
            return
        self._state, windows = self._stage.step(self._state, sight.people, sight.now_ns)
        self._calibrations.keep(self._state.calibration, self._diagnostics)
        person = self._state.person
        if person is not None:
            self._person.publish(person_to_msg(person))
        for window in windows:
            self._windows.publish(feature_window_to_msg(window))
            self._diagnostics.flowed("feature_window")
        self._outcomes.report("perception", len(windows) + (person is not None), self._state.outcome, sight.input_ns)
        self._diagnostics.took("step", time.perf_counter_ns() - sight.steady_ns)
        self._diagnostics.ended("perception", self._state.outcome, self._state.counts, self._state.detail)
        self._diagnostics.summary = self._state.outcome

    def _reset(self) -> str:
        with self._reception.lock:
            self._state = self._stage.reset(self._state)
        return "stand still for the calibration"


def main() -> int:
    """The executable."""
    return run("perception", PerceptionNode, PerceptionParameters)


if __name__ == "__main__":
    raise SystemExit(main())

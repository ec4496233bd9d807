# SPDX-License-Identifier: Apache-2.0
"""`pipeline`: all three stages in one process: a tracker's people in, commands out, one hop in place of three."""

from __future__ import annotations

import time
from typing import Any

from sensor_msgs.msg import JointState

from mild_core.errors import DataError
from mild_core.pipeline import PipelineInput, PipelineOutput, inputs_of_retargeting
from mild_core.retargeting.stage import Request
from mild_ros.assembly.arguments import check_parameters
from mild_ros.assembly.calibration_file import CalibrationFile
from mild_ros.assembly.inference import load
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.messages.stamps import ns_from_msg
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.outcomes import OutcomePublisher
from mild_ros.node_kit.parameters import declare
from mild_ros.node_kit.quality_of_service import SENSOR
from mild_ros.node_kit.reception import JOINTS_KEPT, JOINTS_PER_S, Reception
from mild_ros.node_kit.running import run
from mild_ros.node_kit.threads import StageNode
from mild_ros.nodes.control import Control, Given
from mild_ros.nodes.motion_publishers import IntermediatePublishers, MotionPublishers
from mild_ros.nodes.tracker import Sighting, Tracker


class PipelineNode(StageNode):
    """The whole system and its topics: reception sees the person and infers, control makes the commands."""

    def __init__(self) -> None:
        super().__init__("pipeline")
        parameters = declare(self, PipelineParameters)
        check_parameters(parameters)
        tracker = Tracker(parameters, "pipeline")
        model = load(parameters.model)
        self._pipeline = make_pipeline(parameters, model)
        self._perception, self._inference = self._pipeline.perception.init(), self._pipeline.inference.init()
        self._calibrations = CalibrationFile(parameters.calibration_file)
        self._diagnostics = Diagnostics(self, ("skeleton", "joint_states"), parameters.robot, self._look)
        self._diagnostics.facts["model"] = parameters.model
        self._outcomes = OutcomePublisher(self, parameters.report_handled)
        self._reception = Reception(self, self._diagnostics)
        stage, ages = self._pipeline.retargeting, ("age of an answer", "age of a tick")
        self._control = Control(self, stage, parameters, self._diagnostics, self._outcomes, self._reset, *ages)
        self._time = self._control.clock
        topics = MotionPublishers(self, model.manifest, self._diagnostics)
        self._inside = IntermediatePublishers(self, topics, parameters.publish_intermediate)
        tracker.listen(self, self._reception, self._time, self._diagnostics, self._outcomes, self._on_sight)
        self._reception.subscribe(
            JointState, "joint_states", self._on_joint_states, SENSOR, kept=JOINTS_KEPT, per_s=JOINTS_PER_S
        )
        self.get_logger().info(f"{parameters.source} to {parameters.robot} through {parameters.model}")

    def _on_sight(self, sight: Sighting) -> None:
        output = self._observe(sight.people, sight.now_ns)
        given = inputs_of_retargeting(sight.people, output)
        self._control.put(*(Given(one, sight.now_ns, behind_ns=sight.input_ns) for one in given))
        self._calibrations.keep(self._perception.calibration, self._diagnostics)
        self._diagnostics.took("step", time.perf_counter_ns() - sight.steady_ns)
        self._outcomes.report("pipeline", 0, self._perception.outcome, sight.input_ns)
        self._inside.publish(output)

    def _on_joint_states(self, message: Any) -> None:
        now_ns, stamp_ns = self._time.now_ns(), ns_from_msg(message.header.stamp)
        self._diagnostics.flowed("joint_states")
        try:
            measurement = self._control.commanding.measured(message)
        except DataError as error:
            self._diagnostics.unreadable("joint_states", error.reason, error.detail)
            self._outcomes.report("retargeting", 0, error.reason, stamp_ns)
            return
        self._observe(measurement, now_ns)
        self._control.put(Given(measurement, now_ns, stamp_ns))

    def _observe(self, given: PipelineInput, now_ns: int) -> PipelineOutput:
        perception, inference = self._perception, self._inference
        self._perception, self._inference, output = self._pipeline.observe(perception, inference, given, now_ns)
        for name, before, after in (
            ("perception", perception, self._perception),
            ("inference", inference, self._inference),
        ):
            if after is not before and given != Request("reset"):
                self._diagnostics.ended(name, after.outcome, after.counts, after.detail)
        return output

    def _reset(self) -> None:
        with self._reception.lock:
            self._observe(Request("reset"), self._time.now_ns())

    def _look(self) -> None:
        if self.is_in_order:
            self._control.commanding.watch()
        self._control.commanding.report(self._control.state)


def main() -> int:
    """The executable."""
    return run("pipeline", PipelineNode, PipelineParameters)


if __name__ == "__main__":
    raise SystemExit(main())

# SPDX-License-Identifier: Apache-2.0
"""`pipeline`: all three stages in one process: a tracker's people in, commands out, one hop in place of three."""

from __future__ import annotations

import time
from typing import Any

from sensor_msgs.msg import JointState

from mild_core.errors import DataError
from mild_core.pipeline import PipelineInput, PipelineOutput
from mild_core.retargeting.stage import Request
from mild_ros.assembly.inference import load
from mild_ros.assembly.pipeline import forgotten, make_pipeline
from mild_ros.calibration_file import CalibrationFile
from mild_ros.clock import NodeClock
from mild_ros.commanding import Commanding
from mild_ros.diagnostics import Diagnostics
from mild_ros.fates import Fates
from mild_ros.guarded import GuardedNode
from mild_ros.life_topics import LifeTopics
from mild_ros.messages.stamps import ns_from_msg
from mild_ros.motion_topics import InsideTopics, MotionTopics
from mild_ros.parameters import declare
from mild_ros.quality_of_service import SENSOR
from mild_ros.running import run
from mild_ros.settings import PipelineParameters
from mild_ros.tracker import Sighting, Tracker


class PipelineNode(GuardedNode):
    """The whole system and its topics."""

    def __init__(self) -> None:
        super().__init__("pipeline")
        parameters = declare(self, PipelineParameters)
        tracker = Tracker(parameters, "pipeline")
        model = load(parameters.model)
        self._pipeline = make_pipeline(parameters, model)
        self._state = self._pipeline.init()
        self._calibrations = CalibrationFile(parameters.calibration_file)
        self._behind_ns = 0
        self._diagnostics = Diagnostics(self, ("skeleton", "joint_states"), parameters.robot, self._look)
        self._diagnostics.facts["model"] = parameters.model
        self._fates = Fates(self, parameters.report_handled)
        self._commanding = Commanding(self, self._diagnostics, self._request, parameters, self._pipeline.retargeting)
        self._life = LifeTopics(self, self._request)
        topics = MotionTopics(self, model.manifest, self._diagnostics)
        self._inside = InsideTopics(self, topics, parameters.publish_intermediate)
        self._time = NodeClock(self, self._diagnostics, self._on_tick, parameters.control_rate_hz)
        tracker.listen(self, self._time, self._diagnostics, self._fates, self._on_sight)
        self.create_subscription(JointState, "joint_states", self._on_joint_states, SENSOR)
        self.get_logger().info(f"{parameters.source} to {parameters.robot} through {parameters.model}")

    def _on_sight(self, sight: Sighting) -> None:
        output = self._step(sight.people, sight.now_ns)
        self._calibrations.keep(self._state.perception.calibration, self._diagnostics)
        self._diagnostics.took("step", time.perf_counter_ns() - sight.steady_ns)
        if output.motions:
            self._behind_ns = sight.input_ns
            self._tell_age("age of an answer", output)
        self._fates.report("pipeline", 0, self._state.perception.outcome, sight.input_ns)
        self._inside.publish(output)

    def _on_joint_states(self, message: Any) -> None:
        now_ns, stamp_ns = self._time.now_ns(), ns_from_msg(message.header.stamp)
        self._diagnostics.flowed("joint_states")
        try:
            measurement = self._commanding.measured(message)
        except DataError as error:
            self._diagnostics.unreadable("joint_states", error.reason, error.detail)
            self._fates.report("retargeting", 0, error.reason, stamp_ns)
            return
        self._step(measurement, now_ns)
        self._fates.report("retargeting", 0, self._state.retargeting.outcome, stamp_ns)

    def _on_tick(self, now_ns: int) -> None:
        self._tell_age("age of a tick", self._step(None, now_ns))
        self._fates.report("retargeting", 0, self._state.retargeting.outcome, now_ns)

    def _step(self, given: PipelineInput, now_ns: int) -> PipelineOutput:
        before = self._state
        self._state, output = self._pipeline.step(before, given, now_ns)
        self._life.tell(self._state.retargeting, output.commands)
        self._commanding.send(output.commands, self._state.retargeting)
        for stage in ("perception", "inference", "retargeting"):
            after = getattr(self._state, stage)
            if after is not getattr(before, stage):
                self._diagnostics.ended(stage, after.outcome, after.counts, getattr(after, "detail", ""))
        return output

    def _tell_age(self, what: str, output: PipelineOutput) -> None:
        """How long ago the newest skeleton behind a command was seen."""
        if output.commands and output.commands[-1].motion_stamp_ns:
            self._diagnostics.took(what, self._time.now_ns() - self._behind_ns)

    def _request(self, request: Request) -> None:
        if request.kind == "reset":
            self._state = forgotten(self._pipeline, self._state)
        now_ns = self._time.now_ns()
        self._step(request, now_ns)
        self._fates.report("retargeting", 0, self._state.retargeting.outcome, now_ns)

    def _look(self) -> None:
        self._commanding.look_for_others()
        self._commanding.tell(self._state.retargeting)


def main() -> int:
    """The executable."""
    return run("pipeline", PipelineNode, PipelineParameters)


if __name__ == "__main__":
    raise SystemExit(main())

# SPDX-License-Identifier: Apache-2.0
"""`camera`: where the tracker's camera is, from a hand that is held at the arm's tool.

The routine is `mild_core.retargeting.camera_calibration`; the arm moves by the stage of retargeting, as ever. In place
of the pipeline: two nodes that command one robot both fall silent.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from mild_core.errors import DataError, SetupError
from mild_core.printable import printable_lines
from mild_core.retargeting.modes import Mode
from mild_core.retargeting.stage import Request
from mild_core.signals import JointMeasurement, SkeletonFrame
from mild_ros.assembly.camera import CameraParameters, check_target, make_camera, write_pose
from mild_ros.messages.stamps import ns_from_msg
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.outcomes import OutcomePublisher
from mild_ros.node_kit.parameters import declare
from mild_ros.node_kit.quality_of_service import SENSOR, SERVICE
from mild_ros.node_kit.reception import JOINTS_KEPT, JOINTS_PER_S, Reception
from mild_ros.node_kit.running import end, run
from mild_ros.node_kit.threads import StageNode
from mild_ros.nodes.control import Control, Given
from mild_ros.nodes.tracker import Sighting, Tracker

PERIOD_S = 0.05
"""How often it is looked where the arm is."""


class CameraNode(StageNode):
    """Asks for hands, sends the arm to places, and writes where the camera is."""

    def __init__(self) -> None:
        super().__init__("camera")
        given = declare(self, CameraParameters)
        # Of an arm that people move nothing is commanded, whatever an operator's file says.
        self._set = replace(given, enabled=given.enabled and not given.by_hand)
        check_target(self._set.write_to)
        tracker = Tracker(self._set, "camera")
        stage, self._calibration = make_camera(self._set)
        self._robot = stage.robot
        self._state, self._runs, self._wanted = self._calibration.init(), False, self._set.begin
        self._lock = threading.Lock()
        self._diagnostics = Diagnostics(self, ("skeleton", "joint_states"), self._set.robot, self._look)
        outcomes = OutcomePublisher(self, False)
        self._reception = Reception(self, self._diagnostics)
        self._control = Control(self, stage, self._set, self._diagnostics, outcomes, self._stop, "age of a command")
        self._time = self._control.clock
        tracker.listen(self, self._reception, self._time, self._diagnostics, outcomes, self._on_sight)
        self._reception.subscribe(
            JointState, "joint_states", self._on_joint_states, SENSOR, kept=JOINTS_KEPT, per_s=JOINTS_PER_S
        )
        self.create_service(Trigger, "~/calibrate", self._on_calibrate, qos_profile=SERVICE)
        self.create_timer(PERIOD_S, self.guard("camera", self._on_time))
        self.get_logger().info(f"{self._set.source} before {self._set.robot}")

    def _on_joint_states(self, message: Any) -> None:
        now_ns, stamp_ns = self._time.now_ns(), ns_from_msg(message.header.stamp)
        self._diagnostics.flowed("joint_states")
        try:
            measurement = self._control.commanding.measured(message)
        except DataError as error:
            self._diagnostics.unreadable("joint_states", error.reason, error.detail)
            return
        self._control.put(Given(measurement, now_ns, stamp_ns))

    def _on_sight(self, sight: Sighting) -> None:
        self._step(sight.people, sight.now_ns)

    def _on_time(self) -> None:
        state, now_ns = self._control.state, self._time.now_ns()
        if self._wanted and not self._runs and (self._set.by_hand or not self._control.commanding.silent):
            with self._lock:
                self._state, self._runs, self._wanted = self._calibration.init(), True, False
        fresh = state.measured_ns is not None and not state.silent
        if self._runs and fresh:
            joints = np.array(state.measured_rad)
            self._step(JointMeasurement(now_ns, self._robot.joint_names, joints), now_ns)
        self._step(None, now_ns)
        if self._set.begin and self._state.phase in ("done", "failed") and self._rests():
            failed = self._state.phase == "failed"
            end(self, SetupError("camera", self._state.problem, "see docs/camera.md") if failed else None)

    def _rests(self) -> bool:
        """Whether the arm is back where it waits."""
        return self._set.by_hand or self._control.state.mode in (Mode.IDLE, Mode.HELD, Mode.DISABLED)

    def _step(self, given: tuple[SkeletonFrame, ...] | JointMeasurement | None, now_ns: int) -> None:
        if not self._runs:
            return
        with self._lock:
            self._state, outputs = self._calibration.step(self._state, given, now_ns)
        for one in outputs:
            if isinstance(one, Request):
                if not self._set.by_hand:
                    self._control.ask(one)
            else:
                self._diagnostics.summary = one
                (print if self._set.begin else self.get_logger().info)(printable_lines(one))
        if self._state.phase in ("done", "failed"):
            self._runs = False
            if self._state.fit is not None and self._set.write_to:
                write_pose(self._set.write_to, self._state.fit.text(), self._set)
                said = f"written into {self._set.write_to}; start the pipeline with it"
                (print if self._set.begin else self.get_logger().info)(printable_lines(said))

    def _on_calibrate(self, _wish: Any, answer: Any) -> Any:
        answer.success = not (self._runs or self._wanted)
        answer.message = "begins: see the log and /diagnostics" if answer.success else "is under way; ~/reset ends it"
        self._wanted = self._wanted or answer.success
        return answer

    def _stop(self) -> None:
        """The operator has called `~/reset`."""
        self._runs = self._wanted = False

    def _look(self) -> None:
        self._control.commanding.report(self._control.state)
        alarms = self._diagnostics.alarms
        alarms.pop("camera", None)
        if self._state.problem:
            alarms["camera"] = (DiagnosticStatus.WARN, f"not calibrated: {self._state.problem}")
        self._diagnostics.facts["places"] = f"{len(self._state.taken)} of {self._set.places}"
        if self._state.fit is not None:
            self._diagnostics.facts["robot_from_camera"] = self._state.fit.text()
            self._diagnostics.facts["error over the reach [cm]"] = f"{100 * self._state.fit.error_m:.1f}"


def main() -> int:
    """The executable."""
    return run("camera", CameraNode, CameraParameters)


if __name__ == "__main__":
    raise SystemExit(main())

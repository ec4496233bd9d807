# SPDX-License-Identifier: Apache-2.0
"""`markers`: for people who look on: both hands, all bodies, the predicted way of the robot's hand and its components.

It infers once more, by itself, so the robot waits for none of this.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from sensor_msgs.msg import JointState, PointCloud2
from visualization_msgs.msg import MarkerArray

from mild_core.errors import DataError
from mild_core.retargeting.human_track import AssumedPlacement
from mild_core.signals import PersonPose
from mild_ros.assembly.inference import load, make_inference
from mild_ros.assembly.marker_settings import MarkersParameters
from mild_ros.assembly.robot import check_fit, make_robot
from mild_ros.assembly.settings import InferenceParameters
from mild_ros.messages.feature_window import feature_window_from_msg
from mild_ros.messages.joint_state import joint_measurement_from_msg
from mild_ros.messages.person import person_from_msg
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.guarded import GuardedNode
from mild_ros.node_kit.parameters import declare
from mild_ros.node_kit.quality_of_service import BETWEEN_STAGES, SENSOR
from mild_ros.node_kit.running import run
from mild_ros.nodes.markers import PERSON_COLOUR, Drawing

PERIOD_S = 0.1


class MarkersNode(GuardedNode):
    """What the pipeline sees and expects, ten times a second."""

    def __init__(self) -> None:
        super().__init__("markers")
        given = declare(self, MarkersParameters)
        model = load(given.model)
        manifest = model.manifest
        self._robot = make_robot(given.robot, given.robot_description)
        check_fit(given.model, manifest.controlled, self._robot)
        self._joint_names = manifest.observed.joint_names
        self._stage = make_inference(InferenceParameters(model=given.model, interaction=given.interaction), model)
        self._state = self._stage.init()
        there = manifest.robot_from_human
        self._standing = AssumedPlacement(there.translation_m, there.yaw_rad, there.by_interaction)
        self._drawing = Drawing(self._robot)
        self._published_s = self._bodies_published_s = 0.0
        self._interaction = ""
        self._person: PersonPose | None = None
        self._diagnostics = Diagnostics(self, expected=("feature_window",))
        self._markers = self.create_publisher(MarkerArray, "markers", BETWEEN_STAGES)
        self.create_subscription(PointCloud2, "feature_window", self._on_window, BETWEEN_STAGES)
        self.create_subscription(PointCloud2, "person", self._on_person, BETWEEN_STAGES)
        self.create_subscription(JointState, "joint_states", self._on_joint_states, SENSOR)
        self._joints = np.full(len(self._robot.joint_names), np.nan)

    def _on_person(self, message: Any) -> None:
        try:
            self._person = person_from_msg(message)
        except DataError as error:
            self._diagnostics.unreadable("person", error.reason, error.detail)
            return
        if time.monotonic() - self._bodies_published_s < PERIOD_S or not self._markers.get_subscription_count():
            return
        self._bodies_published_s, segments = time.monotonic(), self._person.segments
        standing = self._standing.place(self._interaction, None, 0.0)
        ends_m = self._standing.placed(segments.ends_m, self._person.frame_id, standing)
        now_ns = self.get_clock().now().nanoseconds
        self._markers.publish(MarkerArray(markers=self._drawing.bodies(segments, ends_m, now_ns)))

    def _on_joint_states(self, message: Any) -> None:
        try:
            measured = joint_measurement_from_msg(message)
        except DataError as error:
            self._diagnostics.unreadable("joint_states", error.reason, error.detail)
            return
        places = dict(zip(measured.joint_names, measured.positions_rad.tolist(), strict=True))
        self._joints = np.array([places.get(name, np.nan) for name in self._robot.joint_names])

    def _on_window(self, message: Any) -> None:
        self._diagnostics.flowed("feature_window")
        try:
            window = feature_window_from_msg(message, self._joint_names)
        except DataError as error:
            self._diagnostics.unreadable("feature_window", error.reason, error.detail)
            return
        before = self._state
        self._state, motions = self._stage.step(before, window, 0)
        self._diagnostics.ended("inference", self._state.outcome, self._state.counts, self._state.detail)
        if not motions or time.monotonic() - self._published_s < PERIOD_S or not self._markers.get_subscription_count():
            return
        self._published_s, (motion,) = time.monotonic(), motions
        self._interaction = motion.interaction
        now_ns, draw = self.get_clock().now().nanoseconds, self._drawing
        markers = draw.predicted(motion, now_ns) + draw.robot_hand(self._joints, now_ns)
        markers += draw.components(self._stage.by_component(before, window), motion.belief, now_ns)
        if self._person is not None:
            standing = self._standing.place(self._interaction, None, 0.0)
            hand = self._standing.placed(self._person.hand_m, self._person.frame_id, standing)
            markers += draw.hand("person_hand", PERSON_COLOUR, hand, now_ns)
        self._markers.publish(MarkerArray(markers=markers))


def main() -> int:
    """The executable."""
    return run("markers", MarkersNode, MarkersParameters)


if __name__ == "__main__":
    raise SystemExit(main())

# SPDX-License-Identifier: Apache-2.0
"""The markers node: hands where they are, predictions where the model says, and nothing that stays for ever."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState, PointCloud2
from visualization_msgs.msg import Marker, MarkerArray

from mild_core.inference.stage import Inference
from mild_core.perception.stage import Perception
from mild_core.retargeting.kinematics import forward_kinematics
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.shapes import FloatArray
from mild_core.signals import JointMeasurement
from mild_ros.assembly.inference import load
from mild_ros.messages.feature_window import feature_window_to_msg
from mild_ros.messages.joint_state import joint_measurement_to_msg
from mild_ros.messages.person import person_to_msg
from mild_ros.quality_of_service import BETWEEN_STAGES, STATE
from test.core.perception.scene import SETTINGS, at_rate, seen
from test.ros.processes import NodeProcess, Probe

pytestmark = pytest.mark.slow


def place(point: object) -> FloatArray:
    return np.array([point.x, point.y, point.z])  # type: ignore[attr-defined]


def test_hands_and_predictions_are_shown(start: Callable[..., NodeProcess], probe: Probe, random_model: Path) -> None:
    shown = probe.listen(MarkerArray, "markers")
    start("markers", model=random_model, interaction="hand_shake")
    windows_out = probe.node.create_publisher(PointCloud2, "feature_window", BETWEEN_STAGES)
    person_out = probe.node.create_publisher(PointCloud2, "person", BETWEEN_STAGES)
    states_out = probe.node.create_publisher(JointState, "joint_states", STATE)
    for publisher in (windows_out, person_out, states_out):
        probe.matched(publisher)
    perception = Perception(SETTINGS)
    state, windows = perception.init(), []
    for people in seen(at_rate(40.0, 2.2)):
        state, made = perception.step(state, people, people[0].stamp_ns)
        windows += made
    assert state.person is not None
    states_out.publish(joint_measurement_to_msg(JointMeasurement(1, YUMI.joint_names, YUMI.home_rad + 0.1)))
    person_out.publish(person_to_msg(state.person))

    stage = Inference(load(str(random_model)), "hand_shake")
    expected, inferred = {}, stage.init()
    for window in windows:
        before = inferred
        inferred, (motion,) = stage.step(before, window, 0)
        expected[motion.positions.tobytes()] = stage.by_component(before, window)
    sending = iter(windows)

    def send_one() -> bool:
        if (window := next(sending, None)) is not None:
            windows_out.publish(feature_window_to_msg(window))
        probe.spin(0.02)
        return any(len(array.markers) > 3 for array in shown) and window is None

    probe.until(send_one, "markers of all kinds")
    newest = max(shown, key=lambda array: len(array.markers))
    markers = {(marker.ns, marker.id): marker for marker in newest.markers}
    assert {name for name, _ in markers} == {"person_hand", "robot_hand", "predicted", "components"}
    assert all(marker.lifetime.nanosec > 0 and marker.action == Marker.ADD for marker in newest.markers)
    assert {marker.header.frame_id for marker in newest.markers} == {YUMI.base_link}
    hand = forward_kinematics(YUMI, YUMI.home_rad + 0.1, YUMI.tool_link)[:3, 3]
    np.testing.assert_allclose(place(markers["robot_hand", 0].pose.position), hand, atol=1e-9)
    drawn = np.array([place(point) for point in markers["predicted", 0].points])
    ways = {
        data: forward_kinematics(YUMI, np.frombuffer(data).reshape(-1, 7), YUMI.tool_link)[:, :3, 3]
        for data in expected
    }
    data = min(ways, key=lambda data: float(np.abs(ways[data] - drawn).max()))
    np.testing.assert_allclose(drawn, ways[data], atol=1e-5, err_msg="the way of one of the windows that were sent")
    for number, alone in enumerate(expected[data]):
        end = forward_kinematics(YUMI, alone.positions[-1], YUMI.tool_link)[:3, 3]
        np.testing.assert_allclose(place(markers["components", number].pose.position), end, atol=1e-5)

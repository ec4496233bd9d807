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
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.shapes import FloatArray
from mild_core.signals import BODY_PARTS, FeatureWindow, JointMeasurement, MotionWindow, PersonPose
from mild_ros.assembly.inference import load
from mild_ros.messages.feature_window import feature_window_to_msg
from mild_ros.messages.joint_state import joint_measurement_to_msg
from mild_ros.messages.person import person_to_msg
from mild_ros.node_kit.quality_of_service import BETWEEN_STAGES, STATE
from test.core.perception.scene import SETTINGS, at_rate, seen
from test.core.perception.test_person_tracker import beside
from test.ros.processes import NodeProcess, Probe

pytestmark = pytest.mark.slow


def place(point: object) -> FloatArray:
    return np.array([point.x, point.y, point.z])  # type: ignore[attr-defined]


def seen_and_expected(model: Path) -> tuple[PersonPose, list[FeatureWindow], dict[bytes, tuple[MotionWindow, ...]]]:
    """A person, their windows, and by the motion that answers each what its components expect."""
    perception, windows = Perception(SETTINGS), []
    state = perception.init()
    for (frame,) in seen(at_rate(40.0, 2.2)):
        people = (frame, beside(frame))
        state, made = perception.step(state, people, people[0].stamp_ns)
        windows += made
    stage = Inference(load(str(model)), "hand_shake")
    expected, inferred = {}, stage.init()
    for window in windows:
        before = inferred
        inferred, (motion,) = stage.step(before, window, 0)
        expected[motion.positions.tobytes()] = stage.by_component(before, window)
    assert state.person is not None
    return state.person, windows, expected


def hands(positions_rad: FloatArray) -> FloatArray:
    return forward_kinematics(YUMI, positions_rad, YUMI.tool_link)[..., :3, 3]


def shown_markers(probe: Probe, person: PersonPose, windows: list[FeatureWindow]) -> list[Marker]:
    """The fullest of all motions, and of all bodies, that were shown while these were sent."""
    shown = probe.listen(MarkerArray, "markers")
    sent = probe.node.create_publisher(PointCloud2, "feature_window", BETWEEN_STAGES)
    person_out = probe.node.create_publisher(PointCloud2, "person", BETWEEN_STAGES)
    states_out = probe.node.create_publisher(JointState, "joint_states", STATE)
    for publisher in (sent, person_out, states_out):
        probe.matched(publisher)
    waiting = iter(windows)

    def all_are_sent() -> bool:
        if (window := next(waiting, None)) is not None:
            # With every window, as a robot and perception send them: one message alone may come after all windows.
            states_out.publish(joint_measurement_to_msg(JointMeasurement(1, YUMI.joint_names, YUMI.home_rad + 0.1)))
            person_out.publish(person_to_msg(person))
            sent.publish(feature_window_to_msg(window))
        probe.spin(0.02)
        kinds = {marker.ns for array in shown for marker in array.markers}
        return {"predicted", "person_hand", "robot_hand", "watched_person"} <= kinds and window is None

    probe.until(all_are_sent, "markers of all kinds")
    motions = [array.markers for array in shown if array.markers and array.markers[0].ns == "predicted"]
    bodies = [array.markers for array in shown if array.markers and array.markers[0].ns == "watched_person"]
    return [*max(motions, key=len), *max(bodies, key=len)]


def test_hands_and_predictions_are_shown(start: Callable[..., NodeProcess], probe: Probe, random_model: Path) -> None:
    start("markers", model=random_model, interaction="hand_shake")
    person, windows, expected = seen_and_expected(random_model)
    found = shown_markers(probe, person, windows)
    markers = {(marker.ns, marker.id): marker for marker in found}
    shown = {"person_hand", "robot_hand", "predicted", "components", "watched_person", "bystanders"}
    assert {name for name, _ in markers} == shown
    bodies = [marker for marker in found if marker.ns in ("watched_person", "bystanders")]
    assert len(bodies) == len({(marker.ns, marker.id) for marker in bodies}) == 2 * len(BODY_PARTS)
    assert {marker.type for marker in bodies} == {Marker.SPHERE_LIST}
    assert sorted(marker.scale.x for marker in bodies) == sorted(2.0 * person.segments.radii_m)
    assert all(marker.lifetime.nanosec > 0 and marker.action == Marker.ADD for marker in found)
    assert {marker.header.frame_id for marker in found} == {YUMI.base_link}
    np.testing.assert_allclose(place(markers["robot_hand", 0].pose.position), hands(YUMI.home_rad + 0.1), atol=1e-9)
    drawn = np.array([place(point) for point in markers["predicted", 0].points])
    ways = {data: hands(np.frombuffer(data).reshape(-1, 7)) for data in expected}
    data = min(ways, key=lambda data: float(np.abs(ways[data] - drawn).max()))
    np.testing.assert_allclose(drawn, ways[data], atol=1e-5, err_msg="the way of one of the windows that were sent")
    for number, alone in enumerate(expected[data]):
        end = markers["components", number].pose.position
        np.testing.assert_allclose(place(end), hands(alone.positions[-1]), atol=1e-5)

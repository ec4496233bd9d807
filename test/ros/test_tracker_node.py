# SPDX-License-Identifier: Apache-2.0
"""The perception node with trackers that are not the one that was set, and with one that sends joint by joint."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState, PointCloud2
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from mild_core.signals import SkeletonFrame
from mild_ros.simulation.person import bodies, skeleton_frames
from test.core.perception.scene import swing
from test.ros.driver_messages import BODIES, DRIVERS
from test.ros.processes import NodeProcess, Probe
from test.ros.surroundings import OK, WARN, Surroundings

RATE_HZ = 30.0
Act = Callable[[], None]


def acting(probe: Probe, driver: str, publish: Callable[[str, Any], None]) -> Act:
    """Publishes what is due of a person who stands still, as this driver does."""
    start_ns, period_ns = probe.now_ns(), round(1e9 / RATE_HZ)
    still = next(skeleton_frames(bodies(swing(np.zeros(1))), RATE_HZ, start_ns))
    sent = [0]

    def act() -> None:
        due = (probe.now_ns() - start_ns) // period_ns
        if due > sent[0]:
            sent[0] = due
            alive = still.positions_m + 1e-6 * (due % 7)  # no person is still to the bit
            frame: SkeletonFrame = replace(still, stamp_ns=start_ns + due * period_ns, positions_m=alive)
            for topic, message in DRIVERS[driver].messages(frame):
                publish(topic, message)

    return act


def reports_until(around: Surroundings, text: str, act: Act) -> Iterator[str]:
    """Messages of the diagnostics that come until one has this text."""
    heard = len(around.reports)
    around.until_status(WARN, text, act)
    return (report.message for report in around.reports[heard:])


def test_a_tracker_that_was_not_set_is_named_at_once(start: Callable[..., NodeProcess], probe: Probe) -> None:
    node = start("perception")
    around = Surroundings(probe, "perception")
    around.connect()
    elsewhere = probe.node.create_publisher(MarkerArray, "/k4a/body_tracking_data", qos_profile_sensor_data)
    around.until_status(WARN, "no publisher on /skeleton (visualization_msgs/msg/MarkerArray): remap it, e.g. -r")
    assert "-r skeleton:=/k4a/body_tracking_data" in around.status()[1]
    probe.node.destroy_publisher(elsewhere)

    poses = probe.node.create_publisher(PoseArray, "skeleton", qos_profile_sensor_data)
    around.until_status(WARN, "publishes geometry_msgs/msg/PoseArray on /skeleton, but source azure_kinect reads")
    assert "set source to pose_array" in around.status()[1]
    probe.node.destroy_publisher(poses)

    skeletons = probe.node.create_publisher(MarkerArray, "skeleton", qos_profile_sensor_data)
    probe.matched(skeletons)
    nuitrack = acting(probe, "nuitrack", lambda _, message: skeletons.publish(message))
    lines = list(
        reports_until(
            around,
            "/skeleton brings markers 0 to 26 in frame 'camera_color_optical_frame', but azure_kinect has 0 to 31 "
            "+ 100 per person: set source to nuitrack",
            nuitrack,
        )
    )
    with_messages = [line for line in lines if "no skeleton" not in line and "no publisher on" not in line]
    assert len(with_messages) <= 2, lines  # a report a second: within two of them
    around.until_status(OK, "accepted", acting(probe, "azure_kinect", lambda _, message: skeletons.publish(message)))
    assert node.output().count("set source to nuitrack") >= 1


def test_another_robots_tracker_is_not_offered(start: Callable[..., NodeProcess], probe: Probe) -> None:
    """What lies beside another robot, and what another pipeline reads wherever it lies; a free tracker is."""
    others = Probe("/left")
    try:
        rival = probe.node.create_publisher(MarkerArray, "/left/bodies", qos_profile_sensor_data)
        taken = probe.node.create_publisher(MarkerArray, "/camera_left/bodies", qos_profile_sensor_data)
        others.node.create_publisher(JointState, "joint_states", 10)
        others.node.create_publisher(JointState, "/joint_command", 10)
        others.listen(MarkerArray, "/camera_left/bodies", qos_profile_sensor_data)
        others.matched(taken)
        start("perception", "-r", "__ns:=/right")
        around = Surroundings(probe, "right/perception")
        around.connect()
        around.until_status(WARN, "no publisher on /right/skeleton (visualization_msgs/msg/MarkerArray): start the")
        assert "left" not in around.status()[1]
        free = probe.node.create_publisher(MarkerArray, "/camera_right/bodies", qos_profile_sensor_data)
        around.until_status(WARN, "remap it, e.g. -r skeleton:=/camera_right/bodies")
        for publisher in (rival, taken, free):
            probe.node.destroy_publisher(publisher)
    finally:
        others.close()


def test_motion_capture_is_put_together_and_its_calibration_kept(
    start: Callable[..., NodeProcess], probe: Probe, tmp_path: Path
) -> None:
    topics = [f"/vrpn_mocap/{name}/pose" for name in BODIES]
    words: dict[str, Any] = {"source": "motion_capture", "source_axes": "rep103"}
    words |= {"joint_names": BODIES, "joint_places": topics, "calibration_file": tmp_path / "calibration.json"}
    first = start("perception", **words)
    around = Surroundings(probe, "perception")
    windows = probe.listen(PointCloud2, "feature_window")
    publishers = {topic: probe.node.create_publisher(PoseStamped, topic, qos_profile_sensor_data) for topic in topics}
    for publisher in publishers.values():
        probe.matched(publisher)
    act = acting(probe, "motion_capture", lambda topic, message: publishers[topic].publish(message))
    around._until(lambda: len(windows) > 10, "windows", act)
    around.until_status(OK, "accepted", act)
    assert first.stop() == 0

    kept = (tmp_path / "calibration.json").read_bytes()
    windows.clear()
    start("perception", **words)
    for publisher in publishers.values():
        probe.until(lambda publisher=publisher: publisher.get_subscription_count() == 1, "the new node alone")
    around.reports.clear()
    around._until(lambda: len(windows) > 3 and around.reports, "windows again", act)
    values = around.until_status(OK, "accepted", act)
    assert "perception calibrating" not in values
    assert (tmp_path / "calibration.json").read_bytes() == kept
    assert probe.call(Trigger, "perception/reset", Trigger.Request()).success
    around.until_counted("perception calibrated", meanwhile=act)
    around._until(lambda: (tmp_path / "calibration.json").read_bytes() != kept, "a new calibration", act)

# SPDX-License-Identifier: Apache-2.0
"""Messages become the same bytes every time, and stamps can be moved without touching anything else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose, PoseArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import Float64MultiArray, String
from visualization_msgs.msg import Marker, MarkerArray

from mild_ros.bag.encoding import encode, restamped, type_name_of
from mild_ros.bag.reader import jazzy_types

SHIFT_NS = 1_234_567_891


def stamped(message: Any, sec: int = 5, nanosec: int = 999_999_999) -> Any:
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    return message


def marker_array(*stamps: tuple[int, int]) -> MarkerArray:
    return MarkerArray(markers=[stamped(Marker(id=i, text="a"), *stamp) for i, stamp in enumerate(stamps)])


MESSAGES = [
    stamped(JointState(name=["a", "bc"], position=[1.0, -2.5], velocity=[0.1, 0.2])),
    stamped(PoseArray(poses=[Pose(), Pose()])),
    stamped(PointCloud2(fields=[PointField(name="x", datatype=8, count=1)], data=bytes(range(16)))),
    stamped(DiagnosticArray(status=[DiagnosticStatus(level=b"\x02", values=[KeyValue(key="a", value="b")])])),
    Float64MultiArray(data=np.arange(3.0)),
    String(data="ä"),
    marker_array((5, 6), (5, 6), (5, 6)),
    MarkerArray(),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_message_survives_the_way_to_bytes_and_back_into_ros(message: Any) -> None:
    assert deserialize_message(encode(message), type(message)) == message


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_message_of_rosbags_gives_the_same_bytes(message: Any) -> None:
    data = encode(message)
    assert encode(jazzy_types().deserialize_cdr(data, type_name_of(message))) == data


def reader(message: Any) -> Callable[[], Any]:
    return lambda: message


@pytest.mark.parametrize(
    "message",
    [*MESSAGES[:2], marker_array((5, 6), (5, 6)), marker_array((5, 6), (7, 8)), marker_array((0, 0), (7, 8))],
    ids=["joint_state", "pose_array", "equal stamps", "unequal stamps", "a stamp of none"],
)
def test_every_stamp_is_moved_and_nothing_else(message: Any) -> None:
    data, name = encode(message), type_name_of(message)
    moved = deserialize_message(restamped(data, name, reader(message), SHIFT_NS, jazzy_types()), type(message))
    for before, after in zip(getattr(message, "markers", [message]), getattr(moved, "markers", [moved]), strict=True):
        before_ns = before.header.stamp.sec * 10**9 + before.header.stamp.nanosec
        after_ns = after.header.stamp.sec * 10**9 + after.header.stamp.nanosec
        assert after_ns == (before_ns + SHIFT_NS if before_ns else 0)
        after.header.stamp = before.header.stamp
    assert moved == message

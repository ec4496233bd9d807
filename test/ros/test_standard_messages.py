# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for the classes of the standard messages are written as ROS's own are."""

from __future__ import annotations

from typing import Any

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from mild_ros.bag.encoding import encode
from mild_ros.messages.standard import _stand_in, standard_message

KINDS = ["geometry_msgs/msg/Pose", "sensor_msgs/msg/PointCloud2", "trajectory_msgs/msg/JointTrajectory"]


def test_where_ros_is_its_own_classes_are_taken() -> None:
    assert standard_message("std_msgs/msg/Header") is Header


@pytest.mark.parametrize("type_name", [*KINDS, "visualization_msgs/msg/Marker", "sensor_msgs/msg/CameraInfo"])
def test_a_new_stand_in_holds_what_a_new_message_holds(type_name: str) -> None:
    ours: Any = _stand_in(type_name)()
    theirs = standard_message(type_name)()
    assert ours.__msgtype__ == type_name
    names = set(theirs.get_fields_and_field_types())
    assert set(vars(ours)) == names
    for name in names:
        value = getattr(theirs, name)
        if isinstance(value, bool | int | float | str):
            assert getattr(ours, name) == value
            assert type(getattr(ours, name)) is type(value)
        elif hasattr(value, "__len__"):
            assert list(getattr(ours, name)) == list(value)


def test_a_filled_stand_in_is_written_byte_for_byte_as_the_message() -> None:
    stamp = Time(sec=3, nanosec=7)
    given: dict[str, Any] = {
        "header": Header(stamp=stamp, frame_id="base"),
        "name": ["a", "b"],
        "position": [0.5, -1.0],
    }
    assert encode(_stand_in("sensor_msgs/msg/JointState")(**given)) == encode(JointState(**given))
    points = {"markers": [Marker(id=4, type=Marker.SPHERE, points=[Point(x=1.0)])]}
    assert encode(_stand_in("visualization_msgs/msg/MarkerArray")(**points)) == encode(MarkerArray(**points))


def test_constants_are_there_and_unknown_fields_are_refused() -> None:
    kind = _stand_in("visualization_msgs/msg/Marker")
    assert (kind.SPHERE, kind.DELETEALL) == (Marker.SPHERE, Marker.DELETEALL)
    with pytest.raises(TypeError, match="Marker has no field colour"):
        kind(colour=1)

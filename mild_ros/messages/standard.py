# SPDX-License-Identifier: Apache-2.0
"""Classes of the standard messages: of ROS 2 where it is installed, stand-ins with the same fields elsewhere.

Bags are replayed, viewed and cut into trials without ROS. A stand-in is made from the definition that rosbags has of
the message, and `encoding.encode` writes it like any other.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_ZEROS = {"bool": False, "string": "", "float32": 0.0, "float64": 0.0}
"""Values of fields that nothing was given for; those of all other kinds are 0."""


def standard_message(type_name: str) -> Any:
    """The class of a standard message, e.g. `std_msgs/msg/Header`."""
    package, kind, name = type_name.split("/")
    try:
        return getattr(import_module(f"{package}.{kind}"), name)
    except ModuleNotFoundError:
        return _stand_in(type_name)


def _stand_in(type_name: str) -> type[Any]:
    """A class with the fields and constants of a message, every field given by name or zero."""
    from rosbags.typesys import Stores, get_typestore  # here: nodes have ROS, and do not wait for rosbags

    constants, fields = get_typestore(Stores.ROS2_JAZZY).fielddefs[type_name]

    def start(self: Any, **given: Any) -> None:
        for field, definition in fields:
            setattr(self, field, given.pop(field) if field in given else _zero(definition))
        if given:
            raise TypeError(f"{type_name} has no field {', '.join(given)}")

    members = {name: value for name, _, value in constants}
    return type(type_name.rsplit("/", 1)[-1], (), {**members, "__init__": start, "__msgtype__": type_name})


def _zero(definition: Any) -> Any:
    from rosbags.interfaces import Nodetype

    node, detail = definition
    if node is Nodetype.NAME:
        return standard_message(detail)()
    if node is Nodetype.BASE:
        return _ZEROS.get(detail[0], 0)
    return [_zero(detail[0]) for _ in range(detail[1])] if node is Nodetype.ARRAY else []


Duration = standard_message("builtin_interfaces/msg/Duration")
Time = standard_message("builtin_interfaces/msg/Time")
Point = standard_message("geometry_msgs/msg/Point")
Pose = standard_message("geometry_msgs/msg/Pose")
PoseArray = standard_message("geometry_msgs/msg/PoseArray")
Vector3 = standard_message("geometry_msgs/msg/Vector3")
Image = standard_message("sensor_msgs/msg/Image")
JointState = standard_message("sensor_msgs/msg/JointState")
PointCloud2 = standard_message("sensor_msgs/msg/PointCloud2")
PointField = standard_message("sensor_msgs/msg/PointField")
ColorRGBA = standard_message("std_msgs/msg/ColorRGBA")
Float64MultiArray = standard_message("std_msgs/msg/Float64MultiArray")
Header = standard_message("std_msgs/msg/Header")
MultiArrayDimension = standard_message("std_msgs/msg/MultiArrayDimension")
MultiArrayLayout = standard_message("std_msgs/msg/MultiArrayLayout")
JointTrajectory = standard_message("trajectory_msgs/msg/JointTrajectory")
JointTrajectoryPoint = standard_message("trajectory_msgs/msg/JointTrajectoryPoint")
Marker = standard_message("visualization_msgs/msg/Marker")
MarkerArray = standard_message("visualization_msgs/msg/MarkerArray")

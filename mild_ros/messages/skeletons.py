# SPDX-License-Identifier: Apache-2.0
"""Which messages can hold people, and how each is read: the table from a source's kind of message to its adapter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import PoseArray
from visualization_msgs.msg import MarkerArray

from mild_core.perception.skeletons import SkeletonSource
from mild_core.signals import SkeletonFrame
from mild_ros.messages.marker_array import people_from_marker_array
from mild_ros.messages.pose_array import people_from_pose_array


@dataclass(frozen=True)
class SkeletonAdapter:
    """How one kind of message is subscribed to and read.

    Attributes:
        type_name: As bags and `ros2 topic` spell it.
        message_type: The class to subscribe with.
        people: (message, source, now_ns) to everyone in it; reads attributes only.
    """

    type_name: str
    message_type: type[Any]
    people: Callable[[Any, SkeletonSource, int], tuple[SkeletonFrame, ...]]


ADAPTERS: dict[str, SkeletonAdapter] = {
    "marker_array": SkeletonAdapter("visualization_msgs/msg/MarkerArray", MarkerArray, people_from_marker_array),
    "pose_array": SkeletonAdapter("geometry_msgs/msg/PoseArray", PoseArray, people_from_pose_array),
}


def people_from_msg(message: Any, source: SkeletonSource, now_ns: int) -> tuple[SkeletonFrame, ...]:
    """Everyone in a tracker's message.

    Args:
        message: Of the kind that `source.message` names.
        source: How it numbers joints and people.
        now_ns: When it came; the stamp [ns] of people in messages without one.
    """
    return ADAPTERS[source.message].people(message, source, now_ns)

# SPDX-License-Identifier: Apache-2.0
"""Which messages can hold people, and how each is read: the table from a source's kind of message to its adapter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mild_core.errors import SetupError
from mild_core.perception.skeletons import SkeletonSource
from mild_core.signals import SkeletonFrame
from mild_ros.messages import joint_poses, transforms
from mild_ros.messages.feeds import SKELETON_TOPIC, Feed
from mild_ros.messages.landmark_array import people_from_landmark_array
from mild_ros.messages.marker_array import people_from_marker_array
from mild_ros.messages.message_types import required_message_class
from mild_ros.messages.pose_array import people_from_pose_array
from mild_ros.messages.skeleton_cloud import people_from_skeleton_cloud
from mild_ros.messages.yolo_detections import people_from_yolo_detections
from mild_ros.messages.zed_objects import people_from_zed_objects


@dataclass(frozen=True)
class SkeletonAdapter:
    """How one kind of message is subscribed to and read.

    Attributes:
        type_name: As bags and `ros2 topic` spell it.
        people: (message, source, now_ns) to everyone in it; reads attributes only. None for trackers of which one
            message does not show a whole person.
        several_feeds: Makes the feeds of such a tracker.
    """

    type_name: str
    people: Callable[[Any, SkeletonSource, int], tuple[SkeletonFrame, ...]] | None
    several_feeds: Callable[[SkeletonSource], tuple[Feed, ...]] | None = None

    @property
    def message_type(self) -> type[Any]:
        """The class to subscribe with; SetupError when its package is not installed."""
        return required_message_class(self.type_name)

    def feeds(self, source: SkeletonSource) -> tuple[Feed, ...]:
        """The topics to listen to; what is read from them shares one memory."""
        if self.several_feeds is not None:
            return self.several_feeds(source)
        return (Feed(SKELETON_TOPIC, self.type_name, lambda message, now_ns: people_from_msg(message, source, now_ns)),)


ADAPTERS: dict[str, SkeletonAdapter] = {
    "marker_array": SkeletonAdapter("visualization_msgs/msg/MarkerArray", people_from_marker_array),
    "pose_array": SkeletonAdapter("geometry_msgs/msg/PoseArray", people_from_pose_array),
    "point_cloud": SkeletonAdapter("sensor_msgs/msg/PointCloud2", people_from_skeleton_cloud),
    "landmark_array": SkeletonAdapter("std_msgs/msg/Float32MultiArray", people_from_landmark_array),
    "joint_poses": SkeletonAdapter(joint_poses.TYPE_NAME, None, joint_poses.pose_feeds),
    "transforms": SkeletonAdapter(transforms.TRANSFORMS, None, transforms.transform_feeds),
    "tracked_bodies": SkeletonAdapter(transforms.TRANSFORMS, None, transforms.tracked_body_feeds),
    "zed_objects": SkeletonAdapter("zed_msgs/msg/ObjectsStamped", people_from_zed_objects),
    "yolo_detections": SkeletonAdapter("yolo_msgs/msg/DetectionArray", people_from_yolo_detections),
}


def people_from_msg(message: Any, source: SkeletonSource, now_ns: int) -> tuple[SkeletonFrame, ...]:
    """Everyone in a tracker's message.

    Args:
        message: Of the kind that `source.message` names.
        source: How it numbers joints and people.
        now_ns: When it came; the stamp [ns] of people in messages without one.

    Raises:
        SetupError: People of this source take several messages; read them through its adapter's feeds.
    """
    people = ADAPTERS[source.message].people
    if people is None:
        raise SetupError(f"source {source.name}", "shows people joint by joint", "listen to it live")
    return people(message, source, now_ns)

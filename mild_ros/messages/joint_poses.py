# SPDX-License-Identifier: Apache-2.0
"""A person as one `geometry_msgs/PoseStamped` per joint, each on a topic of its own."""

from __future__ import annotations

from functools import partial
from typing import Any

from mild_core.perception.skeletons import SkeletonSource
from mild_ros.messages.feeds import Feed
from mild_ros.messages.joint_by_joint import JointByJoint, People, Sample
from mild_ros.messages.stamps import ns_from_msg

TYPE_NAME = "geometry_msgs/msg/PoseStamped"


def pose_feeds(source: SkeletonSource) -> tuple[Feed, ...]:
    """A feed per joint; a place that is no topic's full name lies below `skeleton/`."""
    joints = JointByJoint(tuple(source.places))
    return tuple(
        Feed(place if place.startswith("/") else f"skeleton/{place}", TYPE_NAME, partial(_read, joints, joint))
        for joint, (place, *_) in source.places.items()
    )


def _read(joints: JointByJoint, joint: str, message: Any, now_ns: int) -> People | None:
    position = message.pose.position
    place = (float(position.x), float(position.y), float(position.z))
    return joints.add("0", joint, Sample(ns_from_msg(message.header.stamp) or now_ns, message.header.frame_id, place))

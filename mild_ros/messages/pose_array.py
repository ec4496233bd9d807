# SPDX-License-Identifier: Apache-2.0
"""One person as `geometry_msgs/PoseArray`: joints in an order that the source gives."""

from __future__ import annotations

from typing import Any

import numpy as np

from mild_core.perception.skeletons import SkeletonSource
from mild_core.signals import SkeletonFrame
from mild_ros.messages.stamps import ns_from_msg, time_to_msg
from mild_ros.messages.standard import Header, Point, Pose, PoseArray


def people_from_pose_array(message: Any, source: SkeletonSource, now_ns: int) -> tuple[SkeletonFrame, ...]:
    """The person in a message; none when it holds no pose that the source names.

    Args:
        message: A PoseArray of rclpy or of rosbags.
        source: Which joint each pose is.
        now_ns: Stamp [ns] for a message without one.
    """
    names, positions = [], []
    for place, pose in enumerate(message.poses):
        name = source.joint_ids.get(place)
        if name is not None:
            names.append(name)
            positions.append((pose.position.x, pose.position.y, pose.position.z))
    if not names:
        return ()
    stamp_ns = ns_from_msg(message.header.stamp)
    return (
        SkeletonFrame(
            stamp_ns=stamp_ns if stamp_ns else now_ns,
            frame_id=str(message.header.frame_id),
            person_id=0,
            joint_names=tuple(names),
            positions_m=np.array(positions, dtype=np.float64),
            confidence=np.ones(len(names)),
        ),
    )


def person_to_pose_array(person: SkeletonFrame, source: SkeletonSource) -> PoseArray:
    """The message of a person; a joint the person lacks is not-a-number, so that places keep their meaning."""
    places = dict(zip(person.joint_names, person.positions_m.tolist(), strict=True))
    lost = [float("nan")] * 3
    poses = []
    for place in range(max(source.joint_ids) + 1):
        x, y, z = places.get(source.joint_ids.get(place, ""), lost)
        poses.append(Pose(position=Point(x=x, y=y, z=z)))
    return PoseArray(header=Header(stamp=time_to_msg(person.stamp_ns), frame_id=person.frame_id), poses=poses)

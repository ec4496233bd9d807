# SPDX-License-Identifier: Apache-2.0
"""People as `yolo_msgs/DetectionArray` with keypoints in space."""

from __future__ import annotations

from typing import Any

import numpy as np

from mild_core.perception.skeletons import SkeletonSource
from mild_core.signals import SkeletonFrame
from mild_ros.messages.stamps import ns_from_msg


def people_from_yolo_detections(message: Any, source: SkeletonSource, now_ns: int) -> tuple[SkeletonFrame, ...]:
    """Everyone in a message; detections without keypoints in space are passed over.

    Args:
        message: A DetectionArray of rclpy or of rosbags.
        source: Joints by number of keypoint.
        now_ns: Stamp [ns] for a message without one.
    """
    stamp_ns = ns_from_msg(message.header.stamp) or now_ns
    people = []
    for place, detection in enumerate(message.detections):
        points = [point for point in detection.keypoints3d.data if point.id in source.joint_ids]
        if not points:
            continue
        people.append(
            SkeletonFrame(
                stamp_ns=stamp_ns,
                frame_id=str(detection.keypoints3d.frame_id) or str(message.header.frame_id),
                person_id=int(detection.id) if detection.id.isdecimal() else place,
                joint_names=tuple(source.joint_ids[point.id] for point in points),
                positions_m=np.array([(point.point.x, point.point.y, point.point.z) for point in points]),
                confidence=np.array([point.score for point in points], dtype=np.float64),
            )
        )
    return tuple(people)

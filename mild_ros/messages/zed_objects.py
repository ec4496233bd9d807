# SPDX-License-Identifier: Apache-2.0
"""People as `zed_msgs/ObjectsStamped`: the skeletons of a ZED camera."""

from __future__ import annotations

from typing import Any

import numpy as np

from mild_core.errors import DataError
from mild_core.perception.skeletons import SkeletonSource
from mild_core.signals import SkeletonFrame
from mild_ros.messages.stamps import ns_from_msg

_SEARCHING = 2
GUESSED = 0.3
"""Confidence of a body whose way is only estimated, as that of joints that an Azure Kinect guesses."""


def people_from_zed_objects(message: Any, source: SkeletonSource, now_ns: int) -> tuple[SkeletonFrame, ...]:
    """Everyone in a message; objects without a skeleton are passed over.

    Args:
        message: An ObjectsStamped of rclpy or of rosbags.
        source: Joints of each body format.
        now_ns: Stamp [ns] for a message without one.

    Raises:
        DataError: `wrong_layout` for a body format that the source does not know.
    """
    stamp_ns = ns_from_msg(message.header.stamp) or now_ns
    people = []
    for body in message.objects:
        if not body.skeleton_available:
            continue
        if not 0 <= body.body_format < len(source.formats):
            raise DataError("wrong_layout", f"body format {body.body_format}, expected BODY_18, BODY_34 or BODY_38")
        joint_ids = source.formats[body.body_format]
        keypoints = body.skeleton_3d.keypoints
        confidence = GUESSED if body.tracking_state == _SEARCHING else body.confidence / 100.0
        people.append(
            SkeletonFrame(
                stamp_ns=stamp_ns,
                frame_id=str(message.header.frame_id),
                person_id=int(body.label_id),
                joint_names=tuple(joint_ids.values()),
                positions_m=np.array([keypoints[place].kp for place in joint_ids], dtype=np.float64),
                confidence=np.full(len(joint_ids), confidence),
            )
        )
    return tuple(people)

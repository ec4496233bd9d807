# SPDX-License-Identifier: Apache-2.0
"""One person as `std_msgs/Float32MultiArray`: x y z, or x y z visibility, landmark by landmark."""

from __future__ import annotations

from typing import Any

import numpy as np

from mild_core.errors import DataError
from mild_core.perception.skeletons import SkeletonSource
from mild_core.perception.skeletons.mediapipe import LANDMARKS
from mild_core.signals import SkeletonFrame


def people_from_landmark_array(message: Any, source: SkeletonSource, now_ns: int) -> tuple[SkeletonFrame, ...]:
    """The person in a message; none when it is empty.

    Args:
        message: A Float32MultiArray of rclpy or of rosbags; its layout is not needed, wrappers leave it empty.
        source: Which joint each landmark is.
        now_ns: Stamp [ns], as the message has none.

    Raises:
        DataError: `wrong_layout` when it holds another number of values.
    """
    values = np.asarray(message.data, dtype=np.float64)
    if not values.size:
        return ()
    if values.size not in (3 * LANDMARKS, 4 * LANDMARKS):
        raise DataError("wrong_layout", f"{values.size} numbers, expected {LANDMARKS} landmarks x 3 or x 4")
    rows = values.reshape(LANDMARKS, -1)[list(source.joint_ids)]
    return (
        SkeletonFrame(
            stamp_ns=now_ns,
            frame_id="",
            person_id=0,
            joint_names=tuple(source.joint_ids.values()),
            positions_m=rows[:, :3],
            confidence=rows[:, 3] if rows.shape[1] == 4 else np.ones(len(rows)),
        ),
    )

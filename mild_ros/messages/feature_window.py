# SPDX-License-Identifier: Apache-2.0
"""`FeatureWindow` as an organised `sensor_msgs/PointCloud2`: height = W frames, width = J joints.

The fields are x y z [m] and, when the model wants them, vx vy vz [m/s]. Joint names do not travel: both ends read
them from the same model folder.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mild_core.errors import DataError
from mild_core.signals import FeatureWindow
from mild_ros.messages.point_cloud import array_from_msg, array_to_msg
from mild_ros.messages.stamps import ns_from_msg, time_to_msg
from mild_ros.messages.standard import Header, PointCloud2

POSITION_FIELDS = ("x", "y", "z")
VELOCITY_FIELDS = ("vx", "vy", "vz")


def feature_window_to_msg(window: FeatureWindow) -> PointCloud2:
    """The message of a window; frames run down, joints across."""
    frames, joints = window.features.shape[0], len(window.joint_names)
    quantities = window.features.reshape(frames, -1, joints, 3)
    values = np.concatenate(list(quantities.swapaxes(0, 1)), axis=-1)
    names = POSITION_FIELDS if values.shape[-1] == 3 else POSITION_FIELDS + VELOCITY_FIELDS
    header = Header(stamp=time_to_msg(window.stamp_ns), frame_id=window.frame_id)
    return array_to_msg(values, names, header)


def feature_window_from_msg(message: Any, joint_names: tuple[str, ...]) -> FeatureWindow:
    """The window in a message, for a model that observes `joint_names`.

    Raises:
        DataError: `wrong_layout` when the message holds something else or another number of joints.
    """
    values, names = array_from_msg(message)
    if names not in (POSITION_FIELDS, POSITION_FIELDS + VELOCITY_FIELDS) or values.shape[1] != len(joint_names):
        raise DataError("wrong_layout", f"{values.shape[1]} joints with {names}, expected {len(joint_names)}: x y z …")
    quantities = [values[..., start : start + 3].reshape(values.shape[0], -1) for start in range(0, len(names), 3)]
    return FeatureWindow(
        stamp_ns=ns_from_msg(message.header.stamp),
        frame_id=str(message.header.frame_id),
        joint_names=joint_names,
        features=np.concatenate(quantities, axis=1),
    )

# SPDX-License-Identifier: Apache-2.0
"""`PersonPose` as a `sensor_msgs/PointCloud2` of four points: hand, head, middle of the shoulders and of the hips."""

from __future__ import annotations

from typing import Any

import numpy as np

from mild_core.errors import DataError
from mild_core.signals import PersonPose
from mild_ros.messages.point_cloud import array_from_msg, array_to_msg
from mild_ros.messages.stamps import ns_from_msg, time_to_msg
from mild_ros.messages.standard import Header, PointCloud2

FIELDS = ("x", "y", "z")


def person_to_msg(person: PersonPose) -> PointCloud2:
    """The message of a pose; points that were not seen are NaN."""
    points = np.stack([person.hand_m, person.head_m, *person.trunk_m])[None]
    message = array_to_msg(points, FIELDS, Header(stamp=time_to_msg(person.stamp_ns), frame_id=person.frame_id))
    message.is_dense = bool(np.isfinite(points).all())
    return message


def person_from_msg(message: Any) -> PersonPose:
    """The pose in a message.

    Raises:
        DataError: `wrong_layout` when the message holds something else.
    """
    values, names = array_from_msg(message)
    if names != FIELDS or values.shape != (1, 4, 3):
        raise DataError("wrong_layout", f"{values.shape} values {names}, expected 4 points x y z")
    hand, head, *trunk = values[0]
    return PersonPose(ns_from_msg(message.header.stamp), str(message.header.frame_id), hand, head, np.stack(trunk))

# SPDX-License-Identifier: Apache-2.0
"""Messages of packages that PyPI does not have: made from their definitions by rosbags, travelling through CDR."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

DEFINITIONS = {
    "hri_msgs/msg/IdsList": "std_msgs/Header header\nstring[] ids",
    "zed_msgs/msg/Keypoint2Di": "uint32[2] kp",
    "zed_msgs/msg/Keypoint2Df": "float32[2] kp",
    "zed_msgs/msg/Keypoint3D": "float32[3] kp",
    "zed_msgs/msg/BoundingBox2Di": "zed_msgs/Keypoint2Di[4] corners",
    "zed_msgs/msg/BoundingBox2Df": "zed_msgs/Keypoint2Df[4] corners",
    "zed_msgs/msg/BoundingBox3D": "zed_msgs/Keypoint3D[8] corners",
    "zed_msgs/msg/Skeleton2D": "zed_msgs/Keypoint2Df[70] keypoints",
    "zed_msgs/msg/Skeleton3D": "zed_msgs/Keypoint3D[70] keypoints",
    "zed_msgs/msg/Object": "string label\nint16 label_id\nstring sublabel\nfloat32 confidence\nfloat32[3] position\n"
    "float32[6] position_covariance\nfloat32[3] velocity\nbool tracking_available\nint8 tracking_state\n"
    "int8 action_state\nzed_msgs/BoundingBox2Di bounding_box_2d\nzed_msgs/BoundingBox3D bounding_box_3d\n"
    "float32[3] dimensions_3d\nbool skeleton_available\nint8 body_format\n"
    "zed_msgs/BoundingBox2Df head_bounding_box_2d\nzed_msgs/BoundingBox3D head_bounding_box_3d\n"
    "float32[3] head_position\nzed_msgs/Skeleton2D skeleton_2d\nzed_msgs/Skeleton3D skeleton_3d",
    "zed_msgs/msg/ObjectsStamped": "std_msgs/Header header\nzed_msgs/Object[] objects",
    "yolo_msgs/msg/Point2D": "float64 x\nfloat64 y",
    "yolo_msgs/msg/Vector2": "float64 x\nfloat64 y",
    "yolo_msgs/msg/Pose2D": "yolo_msgs/Point2D position\nfloat64 theta",
    "yolo_msgs/msg/BoundingBox2D": "yolo_msgs/Pose2D center\nyolo_msgs/Vector2 size",
    "yolo_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\nstring frame_id",
    "yolo_msgs/msg/Mask": "int32 height\nint32 width\nyolo_msgs/Point2D[] data",
    "yolo_msgs/msg/KeyPoint2D": "int32 id\nyolo_msgs/Point2D point\nfloat64 score",
    "yolo_msgs/msg/KeyPoint2DArray": "yolo_msgs/KeyPoint2D[] data",
    "yolo_msgs/msg/KeyPoint3D": "int32 id\ngeometry_msgs/Point point\nfloat64 score",
    "yolo_msgs/msg/KeyPoint3DArray": "yolo_msgs/KeyPoint3D[] data\nstring frame_id",
    "yolo_msgs/msg/Detection": "int32 class_id\nstring class_name\nfloat64 score\nstring id\n"
    "yolo_msgs/BoundingBox2D bbox\nyolo_msgs/BoundingBox3D bbox3d\nyolo_msgs/Mask mask\n"
    "yolo_msgs/KeyPoint2DArray keypoints\nyolo_msgs/KeyPoint3DArray keypoints3d",
    "yolo_msgs/msg/DetectionArray": "std_msgs/Header header\nyolo_msgs/Detection[] detections",
}


@cache
def foreign_types() -> Typestore:
    """The types of Jazzy and those of trackers that are no part of it."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


def foreign(type_name: str, **values: Any) -> Any:
    """A message of `foreign_types`; fields that are not given are zero, as a driver leaves them."""
    store = foreign_types()
    fields = {name: values[name] if name in values else _zero(kind) for name, kind in store.fielddefs[type_name][1]}
    return store.types[type_name](**fields)


def _zero(kind: Any) -> Any:
    node, detail = kind
    if node.name == "NAME":
        return foreign(detail)
    if node.name == "BASE":
        return {"string": "", "bool": False}.get(detail[0], 0)
    element, count = detail
    if element[0].name == "BASE" and element[1][0] != "string":
        return np.zeros(count if node.name == "ARRAY" else 0, element[1][0])
    return [_zero(element) for _ in range(count if node.name == "ARRAY" else 0)]


def received(message: Any) -> Any:
    """What a subscriber gets of a foreign message."""
    store, name = foreign_types(), message.__msgtype__
    return store.deserialize_cdr(store.serialize_cdr(message, name), name)


def header(stamp_ns: int, frame_id: str) -> Any:
    stamp = foreign("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return foreign("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)

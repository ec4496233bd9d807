# SPDX-License-Identifier: Apache-2.0
"""YOLO pose estimation with depth as `yolo_ros` publishes it on `/yolo/detections_3d`.

Source: `yolo_msgs/DetectionArray`; `yolo_node.py`: numbers are those of COCO plus one, points below its threshold are
left out, so places in the list say nothing; `detect_3d_node.py`: metres in its `target_frame`, by default `base_link`.
"""

from __future__ import annotations

from mild_core.perception.skeletons.source import SkeletonSource

_COCO = (
    *("nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder"),
    *("left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip"),
    *("left_knee", "right_knee", "left_ankle", "right_ankle"),
)

YOLO = SkeletonSource(
    name="yolo",
    message="yolo_detections",
    driver="yolo_ros",
    start="`ros2 launch yolo_bringup yolo.launch.py model:=yolov8m-pose.pt use_3d:=True`,"
    " then `-r skeleton:=/yolo/detections_3d`",
    confidence="score of the point",
    joint_ids=dict(enumerate(_COCO, start=1)),
    axes="rep103",
    tested="messages as its driver makes them, live and from a bag",
)

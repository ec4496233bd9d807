# SPDX-License-Identifier: Apache-2.0
"""Azure Kinect body tracking as `Azure_Kinect_ROS_Driver` publishes it on `body_tracking_data`.

Source: `k4abt_joint_id_t` of the Azure Kinect Body Tracking SDK 1.1; the driver's `getBodyMarker`: one sphere per
joint in the depth camera's optical frame, metres, id = body * 100 + joint, the whole body in one colour of a palette.
"""

from __future__ import annotations

from mild_core.perception.skeletons.source import SkeletonSource

_ORDER = (
    *("pelvis", "spine", "chest", "neck"),
    *("left_clavicle", "left_shoulder", "left_elbow", "left_wrist", "left_hand", "left_hand_tip", "left_thumb"),
    *("right_clavicle", "right_shoulder", "right_elbow", "right_wrist", "right_hand", "right_hand_tip", "right_thumb"),
    *("left_hip", "left_knee", "left_ankle", "left_foot"),
    *("right_hip", "right_knee", "right_ankle", "right_foot"),
    *("head", "nose", "left_eye", "left_ear", "right_eye", "right_ear"),
)

AZURE_KINECT = SkeletonSource(
    name="azure_kinect",
    message="marker_array",
    driver="Azure_Kinect_ROS_Driver",
    start="`ros2 launch azure_kinect_ros_driver driver.launch.py body_tracking_enabled:=true`,"
    " then `-r skeleton:=body_tracking_data`",
    confidence="colour, in forks that paint it: green 1, blue 0.3",
    tested="a real bag of 62 s; messages as its driver makes them, live and from a bag",
    joint_ids=dict(enumerate(_ORDER)),
    axes="optical",
    ids_per_person=100,
    # Forks paint joints that the tracker only guesses (confidence LOW) blue among green ones.
    confidence_of_colour=(((0.0, 1.0, 0.0), 1.0), ((0.0, 0.0, 1.0), 0.3)),
)

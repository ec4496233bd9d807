# SPDX-License-Identifier: Apache-2.0
"""MediaPipe Pose (BlazePose) as the wrappers around it publish it: 33 landmarks in one `std_msgs/Float32MultiArray`.

Nothing travels but the numbers: x y z, or x y z visibility, landmark by landmark; no stamp, no frame, one person. World
landmarks are metres from the middle of the hips, x right, y down, z away from the camera. Landmarks in parts of the
image have the same axes in another unit: only the directions of the arm count then, and the image has to be square.

Source: MediaPipe's `PoseLandmark`. Finger landmarks are knuckles and no hand: the wrist stands in for it.
"""

from __future__ import annotations

from mild_core.perception.skeletons.source import SkeletonSource

_BY_ID = {
    0: "nose",
    **{2: "left_eye", 5: "right_eye", 7: "left_ear", 8: "right_ear"},
    **{11: "left_shoulder", 12: "right_shoulder", 13: "left_elbow", 14: "right_elbow"},
    **{15: "left_wrist", 16: "right_wrist", 23: "left_hip", 24: "right_hip", 25: "left_knee", 26: "right_knee"},
    **{27: "left_ankle", 28: "right_ankle", 31: "left_foot", 32: "right_foot"},
}

LANDMARKS = 33

MEDIAPIPE = SkeletonSource(
    name="mediapipe",
    message="landmark_array",
    driver="any wrapper of MediaPipe Pose",
    start="let it publish `pose_world_landmarks`, 33 x 3 or 33 x 4 numbers; `-p side:=` by the person, not the image",
    confidence="visibility, when there are four numbers a landmark",
    joint_ids=_BY_ID,
    axes="optical",
    other_ids=frozenset(range(LANDMARKS)) - _BY_ID.keys(),
    tested="messages as its driver makes them, live and from a bag",
)

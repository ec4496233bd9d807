# SPDX-License-Identifier: Apache-2.0
"""Stereolabs ZED body tracking as `zed_wrapper` publishes it on `~/body_trk/skeletons`.

Source: `zed_msgs/ObjectsStamped`; `BODY_18_PARTS`, `BODY_34_PARTS` and `BODY_38_PARTS` of the ZED SDK, chosen in the
message by `body_format` 0, 1, 2; `zed_camera_component_bodytrk.cpp`: 70 places of which the first 18, 34 or 38 are
used, NaN for a joint that is not seen; metres in `<camera>_left_camera_frame`, x forward and z up.
"""

from __future__ import annotations

from mild_core.perception.skeletons.azure_kinect import AZURE_KINECT
from mild_core.perception.skeletons.source import SkeletonSource

_BODY_18 = (
    *("nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist"),
    *("right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle"),
    *("right_eye", "left_eye", "right_ear", "left_ear"),
)
_PAIRED_38 = ("clavicle", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")
_BODY_38 = {
    **{0: "pelvis", 2: "spine", 3: "chest", 4: "neck", 5: "nose"},
    **{6: "left_eye", 7: "right_eye", 8: "left_ear", 9: "right_ear"},
    **{
        10 + 2 * pair + place: f"{side}_{part}"
        for pair, part in enumerate(_PAIRED_38)
        for place, side in enumerate(("left", "right"))
    },
    **{30: "left_thumb", 31: "right_thumb"},
}

ZED = SkeletonSource(
    name="zed",
    message="zed_objects",
    driver="zed_wrapper",
    start="`ros2 launch zed_wrapper zed_camera.launch.py camera_model:=zed2i` with `body_tracking.bt_enabled`,"
    " then `-r skeleton:=/zed/zed_node/body_trk/skeletons`",
    confidence="of the body, / 100; 0.3 while it is only searched for",
    joint_ids=_BODY_38,
    axes="rep103",
    formats=(dict(enumerate(_BODY_18)), AZURE_KINECT.joint_ids, _BODY_38),  # BODY_34 begins as the Azure Kinect's
    tested="messages as its driver makes them, live and from a bag",
)

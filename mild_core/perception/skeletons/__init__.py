# SPDX-License-Identifier: Apache-2.0
"""One file per tracker convention; the joints that all of them are translated to, and the table of sources."""

from mild_core.perception.skeletons.azure_kinect import AZURE_KINECT
from mild_core.perception.skeletons.hri import HRI
from mild_core.perception.skeletons.mediapipe import MEDIAPIPE
from mild_core.perception.skeletons.motion_capture import MOTION_CAPTURE
from mild_core.perception.skeletons.nuitrack import NUITRACK
from mild_core.perception.skeletons.point_cloud import POINT_CLOUD
from mild_core.perception.skeletons.pose_array import POSE_ARRAY
from mild_core.perception.skeletons.source import AXES, JOINTS, SkeletonSource
from mild_core.perception.skeletons.tf import TF
from mild_core.perception.skeletons.yolo import YOLO
from mild_core.perception.skeletons.zed import ZED

SOURCES: dict[str, SkeletonSource] = {
    source.name: source
    for source in (
        *(AZURE_KINECT, NUITRACK, POSE_ARRAY, POINT_CLOUD, MEDIAPIPE, MOTION_CAPTURE),
        *(TF, HRI, ZED, YOLO),
    )
}

__all__ = ["AXES", "JOINTS", "SOURCES", "SkeletonSource"]

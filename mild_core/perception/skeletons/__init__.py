# SPDX-License-Identifier: Apache-2.0
"""One file per tracker convention; the joints that all of them are translated to, and the table of sources."""

from mild_core.perception.skeletons.azure_kinect import AZURE_KINECT
from mild_core.perception.skeletons.pose_array import POSE_ARRAY
from mild_core.perception.skeletons.source import AXES, JOINTS, SkeletonSource

SOURCES: dict[str, SkeletonSource] = {source.name: source for source in (AZURE_KINECT, POSE_ARRAY)}

__all__ = ["AXES", "JOINTS", "SOURCES", "SkeletonSource"]

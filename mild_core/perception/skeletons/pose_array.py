# SPDX-License-Identifier: Apache-2.0
"""Any tracker that publishes one person's joints as `geometry_msgs/PoseArray`, in an order given by parameter."""

from __future__ import annotations

from mild_core.perception.skeletons.source import SkeletonSource

POSE_ARRAY = SkeletonSource(
    name="pose_array",
    message="pose_array",
    driver="any",
    start="`-p joint_names:=[...]` in the order of its poses, `-p source_axes:=...`",
    tested="messages as its driver makes them, live and from a bag",
)

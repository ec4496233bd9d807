# SPDX-License-Identifier: Apache-2.0
"""Any tracker that publishes people as `sensor_msgs/PointCloud2`: a row per person, a point per joint.

The order of the joints is given by parameter. Fields x, y, z [m] and, if there, `confidence`, `score` or `visibility`.
"""

from __future__ import annotations

from mild_core.perception.skeletons.source import SkeletonSource

POINT_CLOUD = SkeletonSource(
    name="point_cloud",
    message="point_cloud",
    driver="any",
    start="`-p joint_names:=[...]` in the order of a row's points, `-p source_axes:=...`",
    confidence="field `confidence`, `score` or `visibility`, else none",
    tested="messages as its driver makes them, live and from a bag",
)

# SPDX-License-Identifier: Apache-2.0
"""Trackers that publish a tf frame per joint: OpenNI and NiTE, Xsens, Nuitrack's and others.

Names of frames differ, so parameters give them; `{}` in them stands for the number of the person.
"""

from __future__ import annotations

from mild_core.perception.skeletons.source import SkeletonSource

TF = SkeletonSource(
    name="tf",
    message="transforms",
    driver="openni_tracker, Xsens, ...",
    start='`-p joint_names:=[right_shoulder, ...] -p joint_places:=["right_shoulder_{}", ...]`;'
    " `frame_id` is the frame to see them in, by default the root of the tree",
    tested="messages as its driver makes them, live and from a bag",
)

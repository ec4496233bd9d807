# SPDX-License-Identifier: Apache-2.0
"""Nuitrack as the node of the paper's authors publishes it: 14 spheres of the upper body, then lines between them.

Source: `nuitrack_node.py` and `utils/nuitrack.py` of github souljaboy764/mild_hri_ros: namespace `nuitrack_skeleton`,
ids 0 to 13 are the SDK's joints 1 to 14 without fingertips, 14 to 26 are line strips; metres, y turned downwards, in
the colour camera's optical frame. Nothing is published while no person is seen, and a joint that Nuitrack lost stays
where it was: its confidence does not travel.
"""

from __future__ import annotations

from mild_core.perception.skeletons.source import SkeletonSource

_ORDER = (
    *("head", "neck", "chest", "pelvis"),
    *("left_clavicle", "left_shoulder", "left_elbow", "left_wrist", "left_hand"),
    *("right_clavicle", "right_shoulder", "right_elbow", "right_wrist", "right_hand"),
)

NUITRACK = SkeletonSource(
    name="nuitrack",
    message="marker_array",
    driver="nuitrack_node of mild_hri_ros",
    start="`nuitrack_node.py`, bridged from ROS 1, then `-r skeleton:=visualization_marker_array`",
    tested="two real streams of 62 s of the SDK, as the node would publish them, live and from a bag",
    joint_ids=dict(enumerate(_ORDER)),
    axes="optical",
    other_ids=frozenset(range(14, 27)),
)

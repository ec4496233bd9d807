# SPDX-License-Identifier: Apache-2.0
"""Bodies of ROS4HRI: their names on `/humans/bodies/tracked`, and a tf frame per joint with the name behind it.

Source: REP-155, kinematic model of the human (`l_shoulder_<id>`, ...); `hri_fullbody` for the first name of each
(`left_shoulder_<id>`, raw positions, with its parameter `stickman_debug`). A body's own frame lies between the hips.
"""

from __future__ import annotations

from mild_core.perception.skeletons.source import PERSON, SkeletonSource

_PLACES = {
    "pelvis": (f"body_{PERSON}",),
    "head": (f"head_{PERSON}",),
    **{
        f"{side}_{part}": (f"{side}_{part}_{PERSON}", f"{side[0]}_{part}_{PERSON}")
        for side in ("left", "right")
        for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    },
}

HRI = SkeletonSource(
    name="hri",
    message="tracked_bodies",
    driver="hri_fullbody and other ROS4HRI nodes",
    start="`ros2 launch hri_fullbody hri_fullbody.launch.py`; it marks its own arm angles as unreliable:"
    " `stickman_debug:=True` gives the raw positions",
    joint_ids=dict(enumerate(_PLACES)),
    places=_PLACES,
    tested="messages as its driver makes them, live and from a bag",
)

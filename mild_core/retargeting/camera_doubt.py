# SPDX-License-Identifier: Apache-2.0
"""What shows that the camera's measured pose is wrong: people who are where, or as, no people are."""

from __future__ import annotations

import numpy as np

from mild_core.retargeting.obstacles import Crowd
from mild_core.retargeting.robot_model.chain import nearest_points
from mild_core.shapes import FloatArray
from mild_core.signals import WATCHED_PERSON

UPSIDE_DOWN = "people are upside down: the angles of robot_from_camera are wrong; give x y z roll pitch yaw [m, rad]"
INSIDE = "a person stands inside the robot: robot_from_camera is wrong; measure it again"
BEHIND = "a person stands behind the robot: if they do not, the yaw of robot_from_camera is wrong"

INVERTED_M = 0.1
"""Hips are so much above the shoulders of who is upside down."""

BEHIND_M = 0.3
"""People's trunks are so far behind the robot's shoulder: no arm that is made for people ahead meets them."""


def camera_doubt(crowd: Crowd, shoulder_m: FloatArray) -> str:
    """What is wrong with where the watched person is; "" for nothing.

    Args:
        crowd: Everyone, in the robot's base frame.
        shoulder_m: (3,) the robot's first joint in that frame.
    """
    segments = crowd.segments
    for person, part, ends_m, radius_m in zip(
        segments.people, segments.parts, segments.ends_m, segments.radii_m, strict=True
    ):
        if person != WATCHED_PERSON or part != "trunk":
            continue
        if ends_m[1, 2] - ends_m[0, 2] > INVERTED_M:  # from the shoulders to the hips
            return UPSIDE_DOWN
        if float(nearest_points(shoulder_m, shoulder_m, ends_m[0], ends_m[1])[0]) < float(radius_m):
            return INSIDE
        if float(np.mean(ends_m[:, 0])) < float(shoulder_m[0]) - BEHIND_M:
            return BEHIND
    return ""

# SPDX-License-Identifier: Apache-2.0
"""ABB YuMi (IRB 14000), right arm controlled.

Kinematic order of an arm's joints is axes 1, 2, 7, 3, 4, 5, 6. Joint and link names are those of the public
KTH/Orebro description. `yumi_description.py` writes `yumi.urdf` from the numbers here.
"""

from __future__ import annotations

from math import radians
from pathlib import Path

from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import read_only

AXES = ("1", "2", "7", "3", "4", "5", "6")
"""ABB's numbers of an arm's axes in kinematic order."""

POSITION_LIMITS_DEG = (
    (-168.5, 168.5),
    (-143.5, 43.5),
    (-168.5, 168.5),
    (-123.5, 80),
    (-290, 290),
    (-88, 138),
    (-229, 229),
)
"""Range of each axis in kinematic order; source: ABB product specification IRB 14000."""

VELOCITY_LIMITS_DEG_S = (180, 180, 180, 180, 400, 400, 400)
"""Largest speed of each axis in kinematic order; source: ABB product specification IRB 14000."""

HOME_RAD = (0.91, -1.46, -2.19, 0.06, 1.35, 0.19, 1.44)
"""Upper arm beside the body, forearm raised in front: the mean first frame of the 32 training trials, to 0.01 rad."""

LEFT_REST_RAD = (-0.91, -1.46, 2.19, 0.06, -1.35, 0.19, -1.44)
"""The left arm while the right one works: the mirror image of home."""

GRIPPER_REST_M = 0.004
"""Each finger of a gripper nearly closed."""


def joint_name(axis: str, side: str) -> str:
    """The description's name of an axis: `side` is "r" or "l"."""
    return f"yumi_joint_{axis}_{side}"


YUMI = RobotModel(
    name="yumi",
    joint_names=tuple(joint_name(axis, "r") for axis in AXES),
    lower_rad=read_only([radians(lower) for lower, _ in POSITION_LIMITS_DEG]),
    upper_rad=read_only([radians(upper) for _, upper in POSITION_LIMITS_DEG]),
    velocity_rad_s=read_only([radians(velocity) for velocity in VELOCITY_LIMITS_DEG_S]),
    acceleration_rad_s2=read_only([30.0] * len(AXES)),
    jerk_rad_s3=read_only([600.0] * len(AXES)),
    home_rad=read_only(HOME_RAD),
    urdf_path=Path(__file__).with_name("yumi.urdf"),
    base_link="yumi_base_link",
    tool_link="tool_r",
    arm_links=("yumi_link_1_r", "yumi_link_4_r"),
    on_table=True,
    rest=(
        *((joint_name(axis, "l"), position) for axis, position in zip(AXES, LEFT_REST_RAD, strict=True)),
        *((f"gripper_{side}_joint{finger}", GRIPPER_REST_M) for side in "rl" for finger in ("", "_m")),
    ),
)

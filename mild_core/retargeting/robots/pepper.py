# SPDX-License-Identifier: Apache-2.0
"""SoftBank Pepper, right arm controlled: it does what a partner's arm does, joint by joint.

Names, kinematics and limits are the vendor's. `pepper_description.py` writes `pepper.urdf` from the numbers here.
"""

from __future__ import annotations

from pathlib import Path

from mild_core.retargeting.robot_model.arm_mapping import FourJointArm
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import read_only

ARM = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
"""The vendor's names of an arm's joints, base to hand, without their side."""

LOWER_RAD = (-2.08567, -1.56207, -2.08567, 0.00872665, -1.82387)
"""Smallest position of each joint of the right arm; source: the vendor's description in ros-naoqi/pepper_robot."""

UPPER_RAD = (2.08567, -0.00872665, 2.08567, 1.56207, 1.82387)
"""The largest; source: as above."""

VELOCITY_LIMITS_RAD_S = (7.33998, 9.22756, 7.33998, 9.22756, 17.3835)
"""Largest speed of each joint; source: as above."""

ELBOW_M = (0.1812, -0.015, 0.00013)
"""From the shoulder to the right elbow with the arm straight ahead; the left one's y is positive."""

ELBOW_PITCH_RAD = -0.157079
"""The elbow's axes are raised so much in the upper arm."""

FLOOR_M = -0.82
"""Height of the floor in `base_link`, which lies in the trunk."""

HOME_RAD = (1.59, -0.16, 1.34, 0.24, 0.0)
"""The arm hangs relaxed beside the body as people's do: the median of NuiSI's first frames, mapped, to 0.01 rad."""

HAND_OPEN = 0.98
"""Position of `RHand` and `LHand` with open fingers."""


def mirrored(name: str, position: float) -> float:
    """What a joint of the left arm must have for what the right one's `name` has."""
    return position if name == "ShoulderPitch" else -position


CONTROLLED = ARM[:4]
"""Joints that follow from a person's shoulder, elbow and hand; wrist and fingers rest, straight and open."""

PEPPER = RobotModel(
    name="pepper",
    joint_names=tuple(f"R{name}" for name in CONTROLLED),
    lower_rad=read_only(LOWER_RAD[:4]),
    upper_rad=read_only(UPPER_RAD[:4]),
    velocity_rad_s=read_only(VELOCITY_LIMITS_RAD_S[:4]),
    acceleration_rad_s2=read_only([30.0] * len(CONTROLLED)),
    jerk_rad_s3=read_only([600.0] * len(CONTROLLED)),
    home_rad=read_only(HOME_RAD[:4]),
    urdf_path=Path(__file__).with_name("pepper.urdf"),
    base_link="base_link",
    tool_link="r_gripper",
    rest=(
        *((f"L{name}", mirrored(name, position)) for name, position in zip(ARM, HOME_RAD, strict=True)),
        ("RWristYaw", HOME_RAD[4]),
        ("RHand", HAND_OPEN),
        ("LHand", HAND_OPEN),
        ("HeadPitch", -0.2),
    ),
    floor_m=FLOOR_M,
    arm=FourJointArm(
        ELBOW_M,
        ELBOW_PITCH_RAD,
        (LOWER_RAD[0], LOWER_RAD[1], LOWER_RAD[2], LOWER_RAD[3]),
        (UPPER_RAD[0], UPPER_RAD[1], UPPER_RAD[2], UPPER_RAD[3]),
    ),
)

# SPDX-License-Identifier: Apache-2.0
"""Writes `yumi.urdf`: our own drawing of ABB's YuMi in primitive shapes, with the vendor's kinematics and limits.

    python -m tools.yumi_description > mild_core/retargeting/robots/yumi.urdf

No mesh of the vendor is used. Lengths are metres, angles radians.
"""

from __future__ import annotations

import sys
from math import pi, radians

from mild_core.retargeting.robots.yumi import AXES, POSITION_LIMITS_DEG, VELOCITY_LIMITS_DEG_S, joint_name
from tools.urdf_writing import (
    ORIGIN,
    Description,
    Shape,
    Vector,
    ball,
    box,
    cushion,
    movable,
    pill,
    rod,
)

SHOULDERS: dict[str, tuple[Vector, Vector]] = {
    "r": ((0.05355, -0.0725, 0.41492), (-0.9795, -0.5682, -2.3155)),
    "l": ((0.05355, 0.0725, 0.41492), (0.9781, -0.5716, 2.3180)),
}
"""Place and turn of each arm's first axis on the body. Source: measured on the real robot's own log (FK test)."""

NEXT_AXES: tuple[tuple[Vector, Vector], ...] = (
    ((0.03, 0.0, 0.1), (pi / 2, 0.0, 0.0)),
    ((-0.03, 0.17283, 0.0), (-pi / 2, 0.0, 0.0)),
    ((-0.04188, 0.0, 0.07873), (pi / 2, -pi / 2, 0.0)),
    ((0.0405, 0.16461, 0.0), (-pi / 2, 0.0, 0.0)),
    ((-0.027, 0.0, 0.10039), (pi / 2, 0.0, 0.0)),
    ((0.027, 0.029, 0.0), (-pi / 2, 0.0, 0.0)),
)
"""Place and turn of axes 2, 7, 3, 4, 5, 6, each in the link before it; both arms alike."""

EFFORTS_N_M = (150.0, 150.0, 80.0, 80.0, 40.0, 40.0, 20.0)
"""Ours: ample for the arm's own weight at 30 rad/s^2."""

MASSES_KG = (2.0, 1.9, 1.4, 1.5, 1.0, 0.7, 0.3)
"""Ours: 9.5 kg an arm with its gripper, a quarter of the robot's 38 kg; spread by the links' sizes."""

COLOURS = {
    "shell": (0.90, 0.90, 0.89, 1.0),
    "padding": (0.66, 0.67, 0.69, 1.0),
    "joint": (0.30, 0.31, 0.33, 1.0),
    "dark": (0.13, 0.13, 0.14, 1.0),
    "accent": (0.80, 0.10, 0.12, 1.0),
}


def body() -> tuple[Shape, ...]:
    """The base with its two feet, the column and the shoulders."""
    feet = tuple(
        shape
        for side in (-1.0, 1.0)
        for shape in (
            *cushion((0.20, 0.115, 0.05), (0.035, side * 0.139, -0.075), 0.03, "shell"),
            box((0.26, 0.095, 0.05), (-0.005, side * 0.139, -0.040), "shell", (0.0, 0.21, 0.0)),
        )
    )
    base = (
        box((0.36, 0.387, 0.008), (-0.178, 0.0, -0.1), "dark"),
        *cushion((0.355, 0.393, 0.075), (-0.178, 0.0, -0.0605), 0.05, "shell"),
        *cushion((0.315, 0.335, 0.04), (-0.198, 0.0, -0.005), 0.07, "shell"),
    )
    column = (
        *cushion((0.245, 0.245, 0.03), (-0.237, 0.0, 0.027), 0.07, "joint"),
        *cushion((0.235, 0.235, 0.28), (-0.237, 0.0, 0.18), 0.07, "shell"),
    )
    chest = (
        *cushion((0.35, 0.265, 0.115), (-0.185, 0.0, 0.3725), 0.09, "shell"),
        *cushion((0.27, 0.215, 0.02), (-0.205, 0.0, 0.44), 0.09, "padding"),
        box((0.004, 0.052, 0.017), (-0.0085, 0.0, 0.375), "accent"),
    )
    return (*base, *feet, *column, *chest)


def shoulder_mounts() -> tuple[Shape, ...]:
    """What carries the first axis of each arm: a cone of steps from the chest to the flange."""
    axis = (0.8138, 0.342, 0.4698)
    shapes: list[Shape] = []
    for side in (-1.0, 1.0):
        x, y, z = 0.05355, side * 0.0725, 0.41492
        for back, front, radius, colour in ((0.11, 0.03, 0.07, "shell"), (0.03, 0.0, 0.063, "joint")):
            ends = [(x - d * axis[0], y - d * side * axis[1], z - d * axis[2]) for d in (back, front)]
            shapes.append(rod(ends[0], ends[1], radius, colour))
    return tuple(shapes)


def arm_links() -> tuple[tuple[Shape, ...], ...]:
    """The seven links of an arm, base to flange, each in the frame of the axis that turns it."""
    return (
        (
            rod((0.0, 0.0, 0.0), (0.0, 0.0, 0.075), 0.056, "shell", solid=True),
            *pill((0.03, -0.05, 0.1), (0.03, 0.05, 0.1), 0.052, "shell", solid=True),
            rod((0.03, -0.078, 0.1), (0.03, -0.062, 0.1), 0.047, "joint"),
        ),
        (
            rod((0.0, 0.0, -0.076), (0.0, 0.0, -0.05), 0.05, "joint"),
            rod((0.0, 0.0, -0.07), (0.0, 0.0, 0.05), 0.046, "padding", solid=True),
            *pill((-0.02, 0.02, 0.0), (-0.03, 0.12, 0.0), 0.05, "padding", solid=True),
            rod((-0.03, 0.12, 0.0), (-0.03, 0.158, 0.0), 0.05, "padding"),
            rod((-0.03, 0.158, 0.0), (-0.03, 0.173, 0.0), 0.046, "joint"),
        ),
        (
            rod((0.0, 0.0, 0.0), (0.0, 0.0, 0.06), 0.047, "shell", solid=True),
            *pill((0.0, 0.0, 0.045), (-0.042, 0.0, 0.079), 0.046, "shell"),
            *pill((-0.042, -0.045, 0.079), (-0.042, 0.025, 0.079), 0.046, "shell", solid=True),
        ),
        (
            rod((0.0, 0.0, -0.05), (0.0, 0.0, -0.035), 0.044, "joint"),
            rod((0.0, 0.0, -0.07), (0.0, 0.0, 0.045), 0.042, "padding", solid=True),
            *pill((0.02, 0.02, 0.0), (0.0405, 0.115, 0.0), 0.043, "padding", solid=True),
            rod((0.0405, 0.115, 0.0), (0.0405, 0.15, 0.0), 0.043, "padding"),
            rod((0.0405, 0.15, 0.0), (0.0405, 0.165, 0.0), 0.039, "joint"),
        ),
        (
            rod((0.0, 0.0, 0.0), (0.0, 0.0, 0.08), 0.041, "shell", solid=True),
            *pill((0.0, 0.0, 0.07), (-0.027, 0.0, 0.1), 0.036, "shell"),
            rod((-0.027, -0.06, 0.1004), (-0.027, 0.035, 0.1004), 0.033, "shell", solid=True),
            rod((-0.027, -0.068, 0.1004), (-0.027, -0.06, 0.1004), 0.029, "joint"),
        ),
        (
            rod((0.0, 0.0, -0.06), (0.0, 0.0, 0.025), 0.031, "padding"),
            rod((0.027, -0.055, 0.0), (0.027, 0.018, 0.0), 0.034, "padding", solid=True),
            ball((0.027, -0.055, 0.0), 0.034, "padding"),
            rod((0.027, 0.018, 0.0), (0.027, 0.029, 0.0), 0.031, "joint"),
        ),
        (rod((0.0, 0.0, -0.002), (0.0, 0.0, 0.010), 0.031, "joint", solid=True),),
    )


def gripper() -> tuple[Shape, ...]:
    """The housing of the gripper, fingers towards +z."""
    return (
        *cushion((0.078, 0.06, 0.066), (0.0, 0.0, 0.033), 0.018, "shell"),
        box((0.07, 0.05, 0.018), (0.0, 0.0, 0.075), "joint"),
        rod((0.0, -0.032, 0.035), (0.0, 0.032, 0.035), 0.014, "dark"),
    )


def finger() -> tuple[Shape, ...]:
    """One finger."""
    return (
        box((0.016, 0.012, 0.022), (0.008, 0.0, 0.011), "dark", solid=True),
        box((0.008, 0.012, 0.034), (0.004, 0.0, 0.037), "dark"),
    )


def add_arm(robot: Description, side: str) -> None:
    """Add the arm, the gripper and the tool frame of `side`, "r" or "l"."""
    parent, places = "yumi_body", (SHOULDERS[side], *NEXT_AXES)
    for number, (axis, shapes) in enumerate(zip(AXES, arm_links(), strict=True)):
        link = f"yumi_link_{number + 1}_{side}"
        robot.link(link, shapes, MASSES_KG[number])
        lower, upper = (radians(limit) for limit in POSITION_LIMITS_DEG[number])
        velocity = radians(VELOCITY_LIMITS_DEG_S[number])
        joint = robot.joint(joint_name(axis, side), parent, link, *places[number])
        movable(joint, "revolute", (0.0, 0.0, 1.0), (lower, upper), velocity, EFFORTS_N_M[number])
        parent = link
    base = f"gripper_{side}_base"
    robot.link(base, gripper(), 0.28)
    robot.joint(f"yumi_link_7_{side}_joint", parent, base, (0.0, 0.0, 0.007), (0.0, 0.0, pi))
    for name, ending, turn in (("finger_r", "", 0.0), ("finger_l", "_m", pi)):
        robot.link(f"gripper_{side}_{name}", finger(), 0.02)
        place = (0.0, 0.0, 0.0837), (0.0, 0.0, turn)
        joint = robot.joint(f"gripper_{side}_joint{ending}", base, f"gripper_{side}_{name}", *place)
        movable(joint, "prismatic", (1.0, 0.0, 0.0), (0.0, 0.025), 2.0, 20.0)
    robot.link(f"tool_{side}")
    robot.joint(f"tool_{side}_fixed", base, f"tool_{side}", (0.0, 0.0, 0.136))


def yumi() -> str:
    """The URDF of the whole robot."""
    robot = Description("yumi", "SPDX-License-Identifier: Apache-2.0. Written by yumi_description.py: change that.")
    for name, rgba in COLOURS.items():
        robot.material(name, rgba)
    robot.link("yumi_base_link")
    robot.link("yumi_body", (*body(), *shoulder_mounts()), 19.0)
    robot.joint("yumi_base_link_to_body", "yumi_base_link", "yumi_body", ORIGIN)
    for side in "rl":
        add_arm(robot, side)
    return robot.text()


if __name__ == "__main__":
    sys.stdout.write(yumi())

# SPDX-License-Identifier: Apache-2.0
"""Writes `pepper.urdf`: our own drawing of SoftBank's Pepper in primitive shapes, with the vendor's kinematics.

    python -m tools.pepper_description > mild_core/retargeting/robots/pepper.urdf

No mesh of the vendor is used. Lengths are metres, angles radians, masses and places of joints the vendor's.
"""

from __future__ import annotations

import sys

from mild_core.retargeting.robots.pepper import (
    ARM,
    ELBOW_M,
    ELBOW_PITCH_RAD,
    HAND_OPEN,
    LOWER_RAD,
    UPPER_RAD,
    VELOCITY_LIMITS_RAD_S,
    mirrored,
)
from tools.urdf_writing import (
    ORIGIN,
    Description,
    Shape,
    Vector,
    ball,
    box,
    cushion,
    lathed,
    movable,
    pill,
    rod,
)

SHOULDER_M = (-0.057, -0.14974, 0.08682)
"""Of the right arm, in the trunk."""

EFFORTS_N_M = (20.0, 20.0, 20.0, 20.0, 5.0)
"""Ours: ample for the arm's own weight at 30 rad/s^2."""

BODY_JOINTS = (
    ("HipRoll", "torso", "Hip", (2e-5, 0.0, -0.139), (1.0, 0.0, 0.0), (-0.514872, 0.514872), 2.27032),
    ("HipPitch", "Hip", "Pelvis", (0.0, 0.0, -0.079), (0.0, 1.0, 0.0), (-1.03847, 1.03847), 2.93276),
    ("KneePitch", "Pelvis", "Tibia", (0.0, 0.0, -0.268), (0.0, 1.0, 0.0), (-0.514872, 0.514872), 2.93276),
    ("HeadYaw", "torso", "Neck", (-0.038, 0.0, 0.1699), (0.0, 0.0, 1.0), (-2.08567, 2.08567), 7.33998),
    ("HeadPitch", "Neck", "Head", ORIGIN, (0.0, 1.0, 0.0), (-0.706858, 0.637045), 9.22756),
)
"""Name, parent, child, place, axis, limits and speed of what turns in body and head."""

BODY_EFFORT_N_M = 150.0
"""Ours: ample to stand upright."""

COLOURS = {
    "shell": (0.96, 0.96, 0.96, 1.0),
    "shade": (0.80, 0.82, 0.85, 1.0),
    "joint": (0.45, 0.47, 0.50, 1.0),
    "dark": (0.08, 0.08, 0.10, 1.0),
    "screen": (0.16, 0.19, 0.26, 1.0),
    "glow": (0.30, 0.66, 0.95, 1.0),
}


def trunk() -> tuple[Shape, ...]:
    """The chest, slimmer downwards, with the tablet that leans back on it, and the foot of the neck."""
    layers = (
        (0.100, (0.105, 0.150, 0.016), -0.040),
        (0.088, (0.124, 0.205, 0.016), -0.040),
        (0.068, (0.140, 0.230, 0.028), -0.036),
        (0.040, (0.150, 0.228, 0.030), -0.031),
        (0.010, (0.152, 0.218, 0.032), -0.026),
        (-0.022, (0.150, 0.205, 0.034), -0.021),
        (-0.054, (0.142, 0.190, 0.032), -0.016),
        (-0.084, (0.132, 0.172, 0.030), -0.011),
    )
    chest = [shape for z, size, x in layers for shape in cushion(size, (x, 0.0, z), 0.38 * size[0], "shell")]
    tilt = (0.0, -0.32, 0.0)
    tablet = (
        box((0.016, 0.256, 0.182), (0.072, 0.0, 0.018), "shade", tilt, solid=True),
        box((0.010, 0.246, 0.172), (0.078, 0.0, 0.020), "dark", tilt),
        box((0.004, 0.214, 0.134), (0.083, 0.0, 0.0217), "screen", tilt),
    )
    neck = (
        *lathed(((0.104, 0.062), (0.122, 0.048)), "shell", (-0.038, 0.0)),
        rod((-0.038, 0.0, 0.11), (-0.038, 0.0, 0.165), 0.032, "joint", solid=True),
    )
    shoulders = rod((-0.05, -0.13, 0.085), (-0.05, 0.13, 0.085), 0.042, "joint")
    return (*chest, *tablet, *neck, shoulders, *lathed(((-0.098, 0.060), (-0.135, 0.052)), "joint"))


def hip() -> tuple[Shape, ...]:
    """The slim waist."""
    return (rod((0.0, 0.0, -0.05), (0.0, 0.0, 0.01), 0.052, "joint", solid=True),)


def pelvis() -> tuple[Shape, ...]:
    """Hips and thighs in one, narrower towards the knee."""
    hips = ((0.045, 0.056), (0.03, 0.082), (0.005, 0.100), (-0.03, 0.108), (-0.07, 0.106))
    outline = (*hips, (-0.13, 0.098), (-0.20, 0.087), (-0.245, 0.078))
    return (
        *lathed(outline, "shell"),
        rod((0.0, 0.0, -0.24), (0.0, 0.0, 0.03), 0.077, "shell", solid=True),
        rod((0.0, 0.0, -0.268), (0.0, 0.0, -0.24), 0.070, "joint"),
    )


def tibia() -> tuple[Shape, ...]:
    """The skirt that widens into the base, which is a triangle with round corners on three wheels."""
    shin = ((-0.008, 0.078), (-0.05, 0.086), (-0.10, 0.098), (-0.15, 0.114))
    outline = (*shin, (-0.19, 0.134), (-0.225, 0.162), (-0.25, 0.192))
    corners = ((0.105, 0.150), (0.105, -0.150), (-0.150, 0.0))
    base: list[Shape] = []
    for low, high, widening in ((-0.268, -0.25, -0.022), (-0.29, -0.268, -0.006), (-0.315, -0.29, 0.0)):
        base += lathed(((low, 0.196 + widening), (high, 0.196 + widening)), "shell", step=0.03)
        for x, y in corners:
            base += lathed(((low, 0.085 + widening), (high, 0.085 + widening)), "shell", (x, y), step=0.03)
    wheels = [rod((x, y - 0.025, -0.303), (x, y + 0.025, -0.303), 0.031, "dark") for x, y in corners]
    light = [rod((0.150, side * 0.157, -0.28), (0.190, side * 0.167, -0.28), 0.010, "glow") for side in (-1.0, 1.0)]
    solid = (
        rod((0.0, 0.0, -0.24), (0.0, 0.0, -0.02), 0.08, "shell", solid=True),
        rod((-0.02, 0.0, -0.315), (-0.02, 0.0, -0.25), 0.20, "shell", solid=True),
    )
    return (*lathed(outline, "shell"), *base, *solid, *wheels, *light)


def head() -> tuple[Shape, ...]:
    """A big round head: large eyes with a ring of light, a small mouth, and the loudspeakers as ears."""
    face = [
        ball((0.010, 0.0, 0.120), 0.104, "shell", solid=True),
        ball((0.018, 0.0, 0.095), 0.099, "shell"),
        ball((0.028, 0.0, 0.072), 0.080, "shell"),
        rod((-0.004, 0.0, -0.004), (0.0, 0.0, 0.03), 0.042, "joint"),
        ball((0.104, 0.0, 0.052), 0.0075, "dark"),
        ball((0.098, 0.0, 0.166), 0.008, "dark"),
    ]
    for side in (-1.0, 1.0):
        looks = (0.87, side * 0.46, 0.07)
        for depth, radius, colour in ((0.1105, 0.027, "dark"), (0.1125, 0.021, "glow"), (0.1145, 0.0155, "dark")):
            start, end = (
                tuple(o + d * a for o, a in zip((0.012, 0.0, 0.108), looks, strict=True)) for d in (0.08, depth)
            )
            face.append(rod(_vector(start), _vector(end), radius, colour))
        face.append(ball((0.108, side * 0.051, 0.125), 0.005, "shell"))
        face.append(rod((0.0, side * 0.08, 0.115), (0.0, side * 0.112, 0.117), 0.043, "shade"))
        face.append(rod((0.0, side * 0.11, 0.117), (0.0, side * 0.116, 0.117), 0.031, "joint"))
        face.append(rod((0.0, side * 0.11, 0.117), (0.0, side * 0.119, 0.117), 0.012, "glow"))
    return tuple(face)


def _vector(numbers: tuple[float, ...]) -> Vector:
    return numbers[0], numbers[1], numbers[2]


def hand(side: float) -> tuple[Shape, ...]:
    """An open hand, palm down, in the wrist's axes; `side` is -1 for the right one."""
    fingers: list[Shape] = []
    for y, z, reach in (
        (0.028, -0.002, 0.050),
        (0.0095, 0.003, 0.056),
        (-0.0095, 0.003, 0.054),
        (-0.028, -0.001, 0.047),
    ):
        y *= -side
        middle = (0.080 + 0.55 * reach, 1.15 * y, z - 0.006)
        tip = (0.080 + reach, 1.2 * y, z - 0.020)
        fingers += (*pill((0.076, y, z), middle, 0.0092, "shade"), *pill(middle, tip, 0.0085, "shade"))
    root, joint, tip = ((0.035, 0.030, -0.012), (0.058, 0.050, -0.022), (0.078, 0.055, -0.030))
    for start, end in ((root, joint), (joint, tip)):
        ends = [(x, -side * y, z) for x, y, z in (start, end)]
        fingers += pill(ends[0], ends[1], 0.0095, "shade")
    return (
        rod((0.0, 0.0, 0.0), (0.022, 0.0, 0.0), 0.030, "joint"),
        *pill((0.034, -0.020, 0.0), (0.034, 0.020, 0.0), 0.018, "shell"),
        box((0.050, 0.072, 0.032), (0.052, 0.0, 0.0), "shell", solid=True),
        *pill((0.074, -0.028, 0.0), (0.074, 0.028, 0.0), 0.0155, "shell"),
        *fingers,
    )


def upper_arm(elbow_y: float) -> tuple[Shape, ...]:
    """From shoulder to elbow."""
    return (
        *pill((0.025, 0.0, 0.0), (0.115, 0.7 * elbow_y, 0.0), 0.046, "shell", solid=True),
        *pill((0.115, 0.7 * elbow_y, 0.0), (0.150, 0.9 * elbow_y, 0.0), 0.041, "shell"),
        ball((ELBOW_M[0], elbow_y, 0.0), 0.038, "joint"),
    )


def forearm() -> tuple[Shape, ...]:
    """From elbow to wrist."""
    return (
        *pill((0.030, 0.0, 0.0), (0.075, 0.0, 0.0), 0.040, "shell"),
        rod((0.010, 0.0, 0.0), (0.138, 0.0, 0.0), 0.035, "shell", solid=True),
        rod((0.075, 0.0, 0.0), (0.110, 0.0, 0.0), 0.0375, "shell"),
    )


def add_arm(robot: Description, side: str) -> None:
    """Add the arm and hand of `side`, "R" or "L"."""
    sign = -1.0 if side == "R" else 1.0
    to_shoulder = (SHOULDER_M[0], -sign * SHOULDER_M[1], SHOULDER_M[2])
    to_elbow = (ELBOW_M[0], -sign * ELBOW_M[1], ELBOW_M[2])
    raised = (0.0, ELBOW_PITCH_RAD, 0.0)
    shoulder = (ball(ORIGIN, 0.057, "shell", solid=True), rod((0.0, -0.045 * sign, 0.0), ORIGIN, 0.050, "joint"))
    wrist, elbow = f"{side.lower()}_wrist", (ball(ORIGIN, 0.039, "joint", solid=True),)
    links = (
        (f"{side}Shoulder", shoulder, 0.3125, to_shoulder, ORIGIN, (0.0, 1.0, 0.0)),
        (f"{side}Bicep", upper_arm(to_elbow[1]), 0.50527, ORIGIN, ORIGIN, (0.0, 0.0, 1.0)),
        (f"{side}Elbow", elbow, 0.27495, to_elbow, raised, (1.0, 0.0, 0.0)),
        (f"{side}ForeArm", forearm(), 0.16579, ORIGIN, ORIGIN, (0.0, 0.0, 1.0)),
        (wrist, hand(sign), 0.27555, (0.15, 0.0, 0.0), ORIGIN, (1.0, 0.0, 0.0)),
    )
    parent = "torso"
    for number, (link, shapes, mass, place, turn, axis) in enumerate(links):
        robot.link(link, shapes, mass)
        lower, upper = LOWER_RAD[number], UPPER_RAD[number]
        if side == "L":
            lower, upper = sorted(mirrored(ARM[number], limit) for limit in (lower, upper))
        joint = robot.joint(f"{side}{ARM[number]}", parent, link, place, turn)
        movable(joint, "revolute", axis, (lower, upper), VELOCITY_LIMITS_RAD_S[number], EFFORTS_N_M[number])
        parent = link
    gripper = f"{side.lower()}_gripper"
    robot.link(gripper)
    joint = robot.joint(f"{side}Hand", wrist, gripper, (0.025, 0.0, 0.0))
    movable(joint, "revolute", (1.0, 0.0, 0.0), (0.02, HAND_OPEN), 12.56, 1.0)


def pepper() -> str:
    """The URDF of the whole robot."""
    robot = Description("pepper", "SPDX-License-Identifier: Apache-2.0. Written by pepper_description.py: change that.")
    for name, rgba in COLOURS.items():
        robot.material(name, rgba)
    robot.link("base_link")
    robot.link("torso", trunk(), 3.99533)
    robot.joint("base_link_fixedjoint", "base_link", "torso", ORIGIN)
    neck = (rod((0.0, 0.0, -0.02), (0.0, 0.0, 0.02), 0.032, "joint", solid=True),)
    parts = {"Hip": (hip(), 1.02338), "Pelvis": (pelvis(), 2.45917), "Tibia": (tibia(), 11.6015)}
    parts |= {"Neck": (neck, 0.27391), "Head": (head(), 1.51893)}
    for name, parent, child, place, axis, limits, velocity in BODY_JOINTS:
        robot.link(child, *parts[child])
        movable(robot.joint(name, parent, child, place), "revolute", axis, limits, velocity, BODY_EFFORT_N_M)
    robot.link("base_footprint")
    robot.joint("base_footprint_joint", "Tibia", "base_footprint", (0.0, 0.0, -0.334))
    for side in "RL":
        add_arm(robot, side)
    return robot.text()


if __name__ == "__main__":
    sys.stdout.write(pepper())

# SPDX-License-Identifier: Apache-2.0
"""Pepper: its drawing has the real one's kinematics and limits, and stands as a Pepper stands."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from mild_core.retargeting.robot_model.kinematics import forward_kinematics, read_tree
from mild_core.retargeting.robots.pepper import ARM, FLOOR_M, LOWER_RAD, PEPPER, UPPER_RAD, mirrored
from tools.pepper_description import pepper


def about(axis: str, angle: float) -> NDArray[np.float64]:
    """(4, 4) turn about an axis."""
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    turned = np.eye(4)
    turned[first, first] = turned[second, second] = np.cos(angle)
    turned[second, first], turned[first, second] = np.sin(angle), -np.sin(angle)
    return turned


def by(x: float, y: float, z: float) -> NDArray[np.float64]:
    """(4, 4) move."""
    moved = np.eye(4)
    moved[:3, 3] = x, y, z
    return moved


def wrist_by_hand(
    pitch: float, roll: float, yaw: float, augment: float, turn: float, side: float
) -> NDArray[np.float64]:
    """The wrist's pose from the vendor's numbers, written out; `side` is -1 on the right."""
    pose = by(-0.057, side * 0.14974, 0.08682) @ about("y", pitch) @ about("z", roll)
    pose = pose @ by(0.1812, side * 0.015, 0.00013) @ about("y", -0.157079) @ about("x", yaw) @ about("z", augment)
    return pose @ by(0.15, 0, 0) @ about("x", turn)


def test_forward_kinematics_are_those_of_the_vendor() -> None:
    rng = np.random.default_rng(1)
    tree = read_tree(PEPPER.urdf_path)
    for joints in rng.uniform(LOWER_RAD, UPPER_RAD, (50, 5)):
        right = tree.pose("r_wrist", {f"R{name}": joint for name, joint in zip(ARM, joints, strict=True)})
        np.testing.assert_allclose(right, wrist_by_hand(*joints, side=-1), atol=5e-6)  # 5 um: the bound of the task
        left = {f"L{name}": mirrored(name, joint) for name, joint in zip(ARM, joints, strict=True)}
        np.testing.assert_allclose(
            tree.pose("l_wrist", left), wrist_by_hand(*(left[f"L{name}"] for name in ARM), side=1), atol=5e-6
        )
        np.testing.assert_allclose(tree.pose("l_wrist", left)[:3, 3], right[:3, 3] * [1, -1, 1], atol=5e-6)


def test_the_description_is_what_its_program_writes() -> None:
    assert PEPPER.urdf_path.read_text() == pepper()


def test_limits_of_model_and_description_agree() -> None:
    joints = {joint.get("name"): joint for joint in ElementTree.parse(PEPPER.urdf_path).getroot().findall("joint")}
    for place, name in enumerate(PEPPER.joint_names):
        limit = joints[name].find("limit")
        assert limit is not None
        written = [float(limit.get(key, "nan")) for key in ("lower", "upper", "velocity")]
        model = (PEPPER.lower_rad, PEPPER.upper_rad, PEPPER.velocity_rad_s)
        np.testing.assert_allclose(written, [values[place] for values in model], rtol=1e-8)  # nine digits are written


def test_it_stands_on_the_floor_with_its_arms_down() -> None:
    foot = read_tree(PEPPER.urdf_path).pose("base_footprint", {}, PEPPER.base_link)
    np.testing.assert_allclose(foot[:3, 3], [0, 0, FLOOR_M], atol=1e-4)
    shoulder, hand = (forward_kinematics(PEPPER, PEPPER.home_rad, link)[:3, 3] for link in ("RShoulder", "r_gripper"))
    # 35.8 cm of arm, nearly straight, hang down beside the body.
    assert shoulder[2] - hand[2] > 0.33
    assert hand[1] < shoulder[1]

# SPDX-License-Identifier: Apache-2.0
"""A robot from a file of the user's: read whole, or refused in one line that says what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.retargeting.robot_file import find_robot, read_robot
from mild_core.retargeting.robots import ROBOTS
from mild_core.retargeting.robots.yumi import LEFT_REST_RAD, YUMI

FILE = f"""
name = "left yumi"
description = "{YUMI.urdf_path}"
base_link = "yumi_base_link"
tool_link = "tool_l"
shoulder_link = "yumi_link_1_l"
elbow_link = "yumi_link_4_l"
joint_names = {[name.replace("_r", "_l") for name in YUMI.joint_names]}
home_rad = {list(LEFT_REST_RAD)}
acceleration_rad_s2 = 30
jerk_rad_s3 = [600, 600, 600, 600, 600, 600, 500]
[rest]
gripper_l_joint = 0.01
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "robot.toml"
    path.write_text(text)
    return path


def test_a_robot_file_makes_a_robot(tmp_path: Path) -> None:
    robot = find_robot(str(written(tmp_path, FILE)))
    assert robot.joint_names[2] == "yumi_joint_7_l"
    for name in ("lower_rad", "upper_rad", "velocity_rad_s"):
        # The description's limits, which has nine digits of them.
        np.testing.assert_allclose(getattr(robot, name), getattr(YUMI, name), rtol=1e-8)
    np.testing.assert_array_equal(robot.acceleration_rad_s2, [30.0] * 7)
    np.testing.assert_array_equal(robot.jerk_rad_s3[-2:], [600.0, 500.0])
    assert robot.rest == (("gripper_l_joint", 0.01),)
    assert robot.arm_links == ("yumi_link_1_l", "yumi_link_4_l")
    assert robot.follows_arms
    assert robot.floor_m is None


def test_limits_of_the_file_come_before_those_of_the_description(tmp_path: Path) -> None:
    robot = read_robot(written(tmp_path, FILE.replace("[rest]", "velocity_rad_s = 0.5\n[rest]")))
    np.testing.assert_array_equal(robot.velocity_rad_s, [0.5] * 7)


@pytest.mark.parametrize("name", ROBOTS)
def test_our_own_robots_go_by_name(name: str) -> None:
    assert find_robot(name) is ROBOTS[name]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('name = "left yumi"', "", "key 'name' is missing"),
        ('"tool_l"', '"tool_x"', "key 'tool_link' is 'tool_x', which yumi.urdf has not; did you mean tool_r, tool_l?"),
        ("yumi_link_1_l", "yumi_link_4_l", "shoulder link 'yumi_link_4_l' moves with the arm"),
        ("yumi_joint_7_l", "yumi_joint_8_l", "holds 'yumi_joint_8_l', which yumi.urdf has not"),
        ("jerk_rad_s3 = [600, ", "jerk_rad_s3 = [", "no list of 7 numbers"),
        ("acceleration_rad_s2 = 30", "acceleration_rad_s2 = -1", "not positive"),
        ("acceleration_rad_s2 = 30", 'acceleration_rad_s2 = "quick"', "no finite number"),
        ("acceleration_rad_s2 = 30", "acceleration_rads2 = 30", "key 'acceleration_rads2' is unknown"),
        ("gripper_l_joint", "gripper_joint", "key 'rest.gripper_joint' is unknown"),
        (f"{LEFT_REST_RAD[0]}, ", "9.0, ", "home_rad lies outside"),
        (".urdf", ".xml", "there is no such file"),
        ("[rest]", "[rest", "is no TOML"),
        ('elbow_link = "yumi_link_4_l"', "", "key 'elbow_link' is missing"),
    ],
)
def test_what_is_wrong_with_a_robot_file_is_said_in_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in FILE
    with pytest.raises(SetupError) as refused:
        read_robot(written(tmp_path, FILE.replace(old, new)))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_robot_that_is_nowhere_is_named_with_those_that_are(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="did you mean 'pepper'"):
        find_robot("peper")
    with pytest.raises(SetupError, match="there is no such file"):
        find_robot(str(tmp_path / "none.toml"))
    with pytest.raises(SetupError, match="larger than"):
        read_robot(written(tmp_path, "# long\n" * 20_000))


def test_a_description_without_limits_asks_for_them(tmp_path: Path) -> None:
    joint = '<joint name="turn" type="continuous"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/></joint>'
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm"><link name="base"/><link name="tip"/>{joint}</robot>')
    lines = ['name = "arm"', 'description = "arm.urdf"', 'base_link = "base"', 'tool_link = "tip"']
    lines += ['joint_names = ["turn"]', "home_rad = [0]", "acceleration_rad_s2 = 1", "jerk_rad_s3 = 1"]
    path = written(tmp_path, "\n".join(lines))
    with pytest.raises(SetupError, match="key 'velocity_rad_s' is missing, and"):
        read_robot(path)
    path.write_text("\n".join([*lines, "lower_rad = -2", "upper_rad = 2", "velocity_rad_s = 1"]))
    assert read_robot(path).upper_rad.tolist() == [2.0]

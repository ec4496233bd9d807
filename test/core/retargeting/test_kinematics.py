# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics against geometry done by hand, and descriptions that are not to be trusted."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.kinematics import forward_kinematics, read_tree
from mild_core.retargeting.robot_model.urdf import SIZE_LIMIT, rotation_from_rpy
from mild_core.retargeting.robots.yumi import YUMI

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/><link name="upper"/><link name="fore"/><link name="tip"/><link name="thumb"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 1"/><axis xyz="0 0 2"/>
  </joint>
  <joint name="slide" type="prismatic"><parent link="upper"/><child link="fore"/><axis xyz="0 1 0"/></joint>
  <joint name="end" type="fixed"><parent link="fore"/><child link="tip"/><origin xyz="1 0 0" rpy="0 0 0.5"/></joint>
  <joint name="thumb" type="continuous">
    <parent link="fore"/><child link="thumb"/><mimic joint="shoulder" multiplier="-1" offset="0.25"/><axis xyz="0 0 1"/>
  </joint>
</robot>
"""


def _written(folder: Path, text: str | bytes) -> Path:
    path = folder / "arm.urdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_poses_are_those_of_geometry(tmp_path: Path) -> None:
    tree = read_tree(_written(tmp_path, ARM))
    tip = tree.pose("tip", {"shoulder": np.pi / 2, "slide": 0.5})
    # One metre along x and half a metre along y, turned by a right angle.
    np.testing.assert_allclose(tip[:3, 3], [-0.5, 1, 1], atol=1e-12)
    np.testing.assert_allclose(tip[:3, :3], rotation_from_rpy(0, 0, np.pi / 2 + 0.5), atol=1e-12)
    np.testing.assert_allclose(tree.pose("tip", {"slide": 0.5}, base="fore")[:3, 3], [1, 0, 0], atol=1e-12)


def test_a_mimicking_joint_copies_another(tmp_path: Path) -> None:
    thumb = read_tree(_written(tmp_path, ARM)).pose("thumb", {"shoulder": 0.1})
    np.testing.assert_allclose(thumb[:3, :3], rotation_from_rpy(0, 0, 0.1 - 0.1 + 0.25), atol=1e-12)


def test_rotation_turns_about_fixed_axes_in_order() -> None:
    expected = rotation_from_rpy(0, 0, 0.3) @ rotation_from_rpy(0, 0.2, 0) @ rotation_from_rpy(0.1, 0, 0)
    np.testing.assert_allclose(rotation_from_rpy(0.1, 0.2, 0.3), expected, atol=1e-12)


def test_many_poses_at_once_are_the_single_ones() -> None:
    positions = np.random.default_rng(0).uniform(YUMI.lower_rad, YUMI.upper_rad, (5, 3, 7))
    together = forward_kinematics(YUMI, positions, YUMI.tool_link)
    alone = [[forward_kinematics(YUMI, one, YUMI.tool_link) for one in row] for row in positions]
    np.testing.assert_allclose(together, alone, atol=1e-12)


def test_links_and_shapes_are_checked(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="did you mean 'tool_r'"):
        forward_kinematics(YUMI, YUMI.home_rad, "tol_r")
    with pytest.raises(ValueError, match=r"expected \(\.\.\., 7\)"):
        forward_kinematics(YUMI, YUMI.home_rad[:6], "tool_r")
    with pytest.raises(SetupError, match="does not carry"):
        read_tree(_written(tmp_path, ARM)).chain("tip", base="thumb")


def test_a_link_is_placed_in_the_frame_of_one_that_does_not_carry_it(tmp_path: Path) -> None:
    """As what an arm is mounted on, where the arm's own base is the robot's."""
    tree, positions = read_tree(_written(tmp_path, ARM)), {"shoulder": 0.3, "slide": -0.4}
    for link, base in itertools.product(tree.links, tree.links):
        found = tree.pose(base, positions) @ tree.pose(link, positions, base)
        np.testing.assert_allclose(found, tree.pose(link, positions), atol=1e-12)


BOMB = '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>' + ARM.split("?>")[1]
OUTSIDE = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/hostname">]><robot name="&x;"/>'


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (BOMB, "document type"),
        (BOMB.encode("utf-16"), "document type"),
        (OUTSIDE, "document type"),
        ("<robot>", "no element found"),
        ("", "no element found"),
        (b"\xff\xfe\x00binary", "no robot description"),
        ("<sdf/>", "<sdf>"),
        (" " * (SIZE_LIMIT + 1), "larger than"),
        (ARM.replace('"revolute"', '"screw"'), "of type 'screw' cannot be computed"),
        (ARM.replace("0 0 1", "0 nan 1", 1), "finite"),
        (ARM.replace("0 0 1", "0 1", 1), "3 finite"),
        (ARM.replace("0 0 1", "0 x 1", 1), "no robot description"),
        (ARM.replace("0 0 2", "0 0 0"), "no axis"),
        (ARM.replace('<child link="tip"/>', ""), "a child"),
        (ARM.replace('child link="tip"', 'child link="upper"'), "'upper' hangs on two joints"),
        (ARM.replace('child link="tip"', 'child link="fore"'), "joins link 'fore' to itself"),
        (ARM.replace('name="slide"', 'name="shoulder"'), "two joints are called 'shoulder'"),
        (ARM.replace('parent link="base"', 'parent link="tip"'), "hangs on no joint"),
        (ARM.replace('<parent link="upper"/>', '<parent link="tip"/>'), "loop"),
    ],
    ids=range(19),
)
def test_a_bad_description_is_one_clear_line(tmp_path: Path, text: str | bytes, problem: str) -> None:
    with pytest.raises(SetupError, match=problem) as caught:
        read_tree(_written(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_a_missing_description_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="no such file"):
        forward_kinematics(replace(YUMI, urdf_path=tmp_path / "none.urdf"), YUMI.home_rad, "tool_r")

# SPDX-License-Identifier: Apache-2.0
"""Arms that are no good for meeting hands: each in one line, or refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from mild_core.errors import SetupError
from mild_core.retargeting.robot_checks import _other_side, arm_notes, check_reach
from mild_core.retargeting.robot_file import read_robot
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robots import ROBOTS
from test.core.retargeting.panda import panda_file
from test.core.retargeting.small_arm import ARM, joint, link, with_more, written

SLIDE = '<limit lower="0" upper="0.05" velocity="1" effort="5"/>'


def _robot(folder: Path, description: str = ARM, old: str = "", new: str = "") -> RobotModel:
    path = written(folder, description)
    path.write_text(path.read_text().replace(old, new) if old else path.read_text())
    return read_robot(path)


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_nothing_is_said_of_our_own_arms(name: str) -> None:
    check_reach(ROBOTS[name])
    assert arm_notes(ROBOTS[name], "right") == arm_notes(ROBOTS[name], "") == ()


def test_nothing_is_said_of_the_panda(tmp_path: Path) -> None:
    panda = read_robot(panda_file(tmp_path))
    check_reach(panda)
    assert arm_notes(panda, "right") == ()


def test_an_arm_that_reaches_no_person_is_refused(tmp_path: Path) -> None:
    short = _robot(tmp_path, ARM.replace('xyz="0.3 0 0"/><axis', 'xyz="0.05 0 0"/><axis'))
    with pytest.raises(SetupError, match="cannot reach any person: its hand comes no further"):
        check_reach(short)
    turned = _robot(tmp_path, ARM.replace('xyz="0.3 0 0"/><axis', 'xyz="-0.3 0 0"/><axis').replace("1.5", "0.5"))
    with pytest.raises(SetupError, match="never ahead along base_link's x axis"):
        check_reach(turned)
    whole = _robot(tmp_path)
    check_reach(replace(whole, floor_m=-1.0))
    with pytest.raises(SetupError, match=r"its hand comes .* m above the floor; people hold theirs at 0.4 to 2 m"):
        check_reach(replace(whole, floor_m=-5.0))


def test_an_arm_of_three_joints_is_named(tmp_path: Path) -> None:
    (said,) = arm_notes(_robot(tmp_path), "right")
    assert said.startswith("robot arm: its arm has 3 joints: hands meet, but nothing is left for the elbow; name all")


def test_a_base_that_drives_is_named(tmp_path: Path) -> None:
    wheel = link("disc") + joint("wheel_left_joint", "base", "disc", more="", kind="continuous")
    _, said = arm_notes(_robot(tmp_path, with_more(wheel)), "")
    assert "it drives ('wheel_left_joint'): robot_from_camera holds while base_link 'base' stands still" in said


def test_a_tool_that_is_a_finger_or_behind_a_gripper_is_named(tmp_path: Path) -> None:
    gripper = link("finger") + joint("slide", "hand", "finger", more=SLIDE, kind="prismatic")
    _, said = arm_notes(_robot(tmp_path, with_more(gripper), 'tool_link = "hand"', 'tool_link = "finger"'), "")
    assert said.endswith("its tool_link 'finger' moves with 'slide', which nothing commands: name 'hand'")
    _, said = arm_notes(_robot(tmp_path, with_more(gripper)), "")
    assert "its tool_link 'hand' lies behind a gripper, whose 'finger' is 0.30 m further out" in said
    near = with_more(gripper.replace('xyz="0.3 0 0"/><axis', 'xyz="0.05 0 0"/><axis'))
    assert len(arm_notes(_robot(tmp_path, near), "")) == 1, "a short gripper is part of the hand"


@pytest.mark.parametrize(("name", "said"), [("left_{}", True), ("right_{}", False), ("arm_l_{}", True), ("{}", False)])
def test_a_left_arm_under_a_model_of_a_right_one_is_named(tmp_path: Path, name: str, said: bool) -> None:
    arm = _robot(tmp_path)
    renamed = tuple(name.format(joint) for joint in arm.joint_names)
    named = _other_side(_named(arm, renamed), "right")
    assert bool(named) is said
    if said:
        assert named == "its arm is a left one, and the model moves a right arm: it does as that does, mirrored"
        assert not _other_side(_named(arm, renamed), "left")


def _named(arm: RobotModel, names: tuple[str, ...]) -> RobotModel:
    """The same arm under other names, in a description of its own."""
    text = arm.urdf_path.read_text()
    for old, new in zip(arm.joint_names, names, strict=True):
        text = text.replace(f'name="{old}"', f'name="{new}"')
    path = arm.urdf_path.with_name(f"{names[0]}.urdf")
    path.write_text(text)
    return replace(arm, urdf_path=path, joint_names=names)

# SPDX-License-Identifier: Apache-2.0
"""Robot files from descriptions alone: arms of every build, and what is no arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.retargeting.robot_file import read_robot
from mild_core.retargeting.robot_model.kinematics import read_tree
from mild_core.retargeting.robot_proposal import Proposal, find_limbs, propose
from mild_core.retargeting.robots import ROBOTS

LIMIT = '<limit lower="-2" upper="2" velocity="2" effort="60"/>'
SHORT = '<limit lower="0" upper="0.04" velocity="1" effort="5"/>'


def edge(
    name: str, parent: str, at: str, axis: str = "0 1 0", kind: str = "revolute", more: str = LIMIT, child: str = ""
) -> str:
    """A joint and the link that it carries."""
    child = child or f"{name}_link"
    more = "" if kind == "fixed" else f'<axis xyz="{axis}"/>{more}'
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
    return f'<link name="{child}"/><joint name="{name}" type="{kind}">{ends}{more}</joint>'


def arm(prefix: str, parent: str, at: str, more: str = "") -> str:
    """Six joints: two in the shoulder, two in the elbow, two in the wrist; it hangs down at zero."""
    parts = (("pan", at, "0 0 1"), ("lift", "0 0 0", "0 1 0"), ("bend", "0 0 -0.3", "0 1 0"))
    parts += (("roll", "0 0 0", "0 0 1"), ("wrist", "0 0 -0.25", "0 1 0"), ("twist", "0 0 -0.05", "0 0 1"))
    text, above = "", parent
    for name, place, axis in parts:
        text += edge(f"{prefix}{name}", above, place, axis, more=more or LIMIT)
        above = f"{prefix}{name}_link"
    return text


def gripper(prefix: str) -> str:
    """A flange, a frame between the fingertips, a camera, and two fingers of which one copies the other."""
    hand = f"{prefix}twist_link"
    copies = SHORT + f'<mimic joint="{prefix}left_finger"/>'
    return (
        edge(f"{prefix}flange", hand, "0 0 -0.05", kind="fixed")
        + edge(f"{prefix}tcp", f"{prefix}flange_link", "0 0 -0.1", kind="fixed")
        + edge(f"{prefix}wrist_camera", hand, "0.05 0 -0.2", kind="fixed")
        + edge(f"{prefix}left_finger", f"{prefix}flange_link", "0 0.02 -0.06", "0 1 0", "prismatic", SHORT)
        + edge(f"{prefix}right_finger", f"{prefix}flange_link", "0 -0.02 -0.06", "0 -1 0", "prismatic", copies)
    )


def legs() -> str:
    """Two of them, of six joints each, down to the floor."""
    text = ""
    for side, y in (("a", 0.1), ("b", -0.1)):
        above, places = "pelvis", (f"0 {y} 0", "0 0 0", "0 0 0", "0 0 -0.4", "0 0 -0.4", "0 0 0")
        for number, place in enumerate(places):
            text += edge(f"{side}{number}", above, place)
            above = f"{side}{number}_link"
    return text


def trunk() -> str:
    """Two joints of the waist, a chest, and a head on two more."""
    text = edge("waist", "pelvis", "0 0 0.1", "0 0 1") + edge("chest", "waist_link", "0 0 0.2")
    return text + edge("nod", "chest_link", "0 0 0.3") + edge("shake", "nod_link", "0 0 0.02", "0 0 1")


HUMANOID = legs() + trunk() + arm("x_", "chest_link", "0 0.2 0.2") + arm("y_", "chest_link", "0 -0.2 0.2")
BENCH = arm("", "pelvis", "0 0 0.1") + gripper("")


def proposed(folder: Path, text: str, side: str = "", tool: str = "") -> Proposal:
    """What is proposed, after the file was written and read again."""
    path = folder / "made.urdf"
    path.write_text(f'<robot name="made"><link name="pelvis"/>{text}</robot>')
    read_tree.cache_clear()
    proposal = propose(path, side, tool)
    file = folder / "made.toml"
    file.write_text(proposal.text("made.urdf"))
    again = read_robot(file)
    for name in ("joint_names", "base_link", "tool_link", "arm_links", "rest", "floor_m"):
        assert getattr(again, name) == getattr(proposal.robot, name)
    for name in ("home_rad", "lower_rad", "upper_rad", "velocity_rad_s", "acceleration_rad_s2", "jerk_rad_s3"):
        np.testing.assert_allclose(getattr(again, name), getattr(proposal.robot, name), atol=6e-4)
    return proposal


@pytest.mark.parametrize(("side", "prefix"), [("left", "x_"), ("right", "y_"), ("", "y_")])
def test_each_arm_of_a_humanoid_is_found_by_its_place(tmp_path: Path, side: str, prefix: str) -> None:
    proposal = proposed(tmp_path, HUMANOID, side)
    robot = proposal.robot
    assert robot.joint_names == tuple(
        f"{prefix}{name}" for name in ("pan", "lift", "bend", "roll", "wrist", "twist")
    ), "neither the waist nor another limb"
    assert (robot.base_link, robot.tool_link) == ("pelvis", f"{prefix}twist_link")
    assert robot.arm_links == (f"{prefix}lift_link", f"{prefix}bend_link")
    assert robot.floor_m == pytest.approx(-0.8)
    assert proposal.reached >= 0.9 * proposal.reachable > 20
    other = "x_" if prefix == "y_" else "y_"
    assert {name for name, _ in robot.rest} >= {f"{other}lift"}, "the other arm waits too"


def test_a_robot_that_looks_back_has_its_front_where_its_arms_bend_to(tmp_path: Path) -> None:
    bent = '<limit lower="-2.4" upper="0" velocity="2" effort="60"/>'  # ahead of x by the right-hand rule
    ahead = HUMANOID.replace('name="x_lift"', 'name="x_lift" ').replace(LIMIT, bent)
    turned = '<limit lower="0" upper="2.4" velocity="2" effort="60"/>'
    back = HUMANOID.replace(LIMIT, turned) + edge("mark", "pelvis", "0 0 -0.8", kind="fixed")
    back = back.replace('<origin xyz="0 0 -0.8"/></joint>', '<origin xyz="0 0 -0.8" rpy="0 0 3.14159265"/></joint>')
    assert proposed(tmp_path, ahead, "left").robot.joint_names[0] == "x_pan"
    proposal = proposed(tmp_path, back, "left")
    assert proposal.robot.base_link == "mark_link"
    assert proposal.robot.joint_names[0] == "y_pan", "left is the other one, seen from there"
    assert proposal.reached > 20


@pytest.mark.parametrize(
    ("text", "tool"),
    [
        (BENCH, "tcp_link"),
        (arm("", "pelvis", "0 0 0.1"), "twist_link"),
        (
            arm("", "pelvis", "0 0 0.1")
            + edge("frame", "twist_link", "0 0 -0.12", kind="fixed")
            + edge("last", "twist_link", "0.01 0 -0.04"),
            "frame_link",
        ),
        (arm("", "pelvis", "0 0 0.1") + edge("hand_gripper", "twist_link", "0 0 -0.05", "0 1 0"), "hand_gripper_link"),
    ],
    ids=["two fingers", "bare wrist", "a jaw without a name", "a gripper by its name"],
)
def test_the_tool_is_in_front_of_the_fingers_and_none_of_them(tmp_path: Path, text: str, tool: str) -> None:
    proposal = proposed(tmp_path, text)
    assert proposal.robot.tool_link == tool
    assert proposal.robot.joint_names == ("pan", "lift", "bend", "roll", "wrist", "twist")
    assert not [check for check in proposal.checks if "behind a gripper" in check or "moves with" in check]


def test_a_trunk_that_slides_is_raised_and_not_commanded(tmp_path: Path) -> None:
    slide = '<limit lower="0" upper="0.6" velocity="0.1" effort="500"/>'
    wheels = "".join(
        edge(f"wheel_{n}", "pelvis", f"0 {y} 0", kind="continuous", more="") for n, y in (("l", 0.2), ("r", -0.2))
    )
    lift = edge("lift_trunk", "pelvis", "0 0 0.5", "0 0 1", "prismatic", slide)
    proposal = proposed(tmp_path, wheels + lift + arm("", "lift_trunk_link", "0 0 0.1"))
    assert proposal.robot.joint_names[0] == "pan"
    assert dict(proposal.robot.rest)["lift_trunk"] == pytest.approx(0.5, abs=0.01)
    assert any("it drives" in check for check in proposal.checks)


def test_joints_that_copy_others_are_not_commanded(tmp_path: Path) -> None:
    text = BENCH.replace('<joint name="roll"', '<joint name="rolls"')
    copying = LIMIT + '<mimic joint="pan" multiplier="0.5"/>'
    text = text.replace(f'<axis xyz="0 0 1"/>{LIMIT}</joint><link name="wrist_link"/>', "HERE")
    before, found, after = text.partition("HERE")
    assert found
    text = f'{before}<axis xyz="0 0 1"/>{copying}</joint><link name="wrist_link"/>{after}'
    assert proposed(tmp_path, text).robot.joint_names == ("pan", "lift", "bend", "wrist", "twist")


def test_what_no_description_says_is_guessed_and_said(tmp_path: Path) -> None:
    proposal = proposed(tmp_path, BENCH.replace(LIMIT, '<limit effort="60"/>'))
    assert proposal.robot.lower_rad.tolist() == [-1.5] * 6
    guesses = ("guess: the description has none", "are guesses: the description has none")
    assert sum(check.endswith(guesses) for check in proposal.checks) == 2


def test_a_link_may_be_named(tmp_path: Path) -> None:
    assert proposed(tmp_path, BENCH, tool="flange_link").robot.tool_link == "flange_link"
    with pytest.raises(SetupError, match="--tool pelvis: fewer than 3 turning joints carry it"):
        propose(tmp_path / "made.urdf", tool="pelvis")


def test_what_has_no_arm_is_named(tmp_path: Path) -> None:
    for text, said in (
        (legs(), "it has no arm: its 2 limbs are legs"),
        (edge("one", "pelvis", "0 0 0.3") + edge("two", "one_link", "0 0 0.3"), "it has no arm: no limb has 3 joints"),
        (arm("x_", "pelvis", "0 0.3 0.5"), "it has no right arm; there are: a left one ends in 'x_twist_link'"),
    ):
        text = text if "x_" in text else text.replace('"a0"', '"hip_a0"').replace('"b0"', '"hip_b0"')
        if "legs" in said:
            for number in range(6):
                text = text.replace(f'"a{number}"', f'"leg_a{number}"').replace(f'"b{number}"', f'"leg_b{number}"')
        with pytest.raises(SetupError, match=said):
            proposed(tmp_path, text, "right" if "right" in said else "")


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_our_own_arms_are_found(name: str) -> None:
    ours = ROBOTS[name]
    found = {limb.tool_link: limb for limb in find_limbs(ours.urdf_path) if not limb.leg}
    assert found[ours.tool_link].names[: len(ours.joint_names)] == ours.joint_names

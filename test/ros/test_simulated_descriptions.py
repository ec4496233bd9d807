# SPDX-License-Identifier: Apache-2.0
"""The simulated arm stands and goes where it is sent, whatever its description says or leaves out."""

from __future__ import annotations

import logging
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.kinematics import forward_kinematics, read_tree
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.signals import JointCommand
from mild_ros.assembly.robot import make_robot
from mild_ros.simulation.bullet import BulletRobot
from test.core.retargeting.small_arm import ARM, COPYING, LIMIT, joint, link, with_more, written

BAD_INERTIA = '<inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="0.02"/>'
LEG = link("leg") + joint("hip", "base", "leg", more=LIMIT.replace("60", "0"))
TOES = "".join(link(f"t{n}") + joint(f"k{n}", "leg", f"t{n}") for n in range(150))
CART = link("cart") + joint("wheels", "base", "cart", "0 0 1", "", "floating")
SOLE = link("sole") + joint("slips", "leg", "sole", "0 0 1", "", "planar")
MESH = '<visual><geometry><mesh filename="package://no_such/a.dae"/></geometry></visual>'
ARMS = {
    "as it should be": ARM,
    "no effort": re.sub(r'effort="[^"]*"', 'effort="0"', ARM),
    "no effort written": re.sub(r' effort="[^"]*"', "", ARM),
    "less effort than it weighs": ARM.replace('effort="60"', 'effort="5"'),
    "an inertia that no body has": re.sub("<inertia .*?/>", BAD_INERTIA, ARM),
    "no inertia": re.sub("<inertial>.*?</inertial>", "", ARM),
    "no mass": ARM.replace('<mass value="2"/>', '<mass value="0"/>'),
    "150 more links": with_more(LEG + TOES),
    "a free cart and a leg that nothing drives": with_more(LEG + SOLE + CART),
    "a mesh that is nowhere": ARM.replace('<link name="hand">', f'<link name="hand">{MESH}'),
}


def goes_to(simulated: BulletRobot, at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where its commanded joints are after some seconds of being sent there."""
    home = simulated.robot.home_rad
    for share in np.linspace(0.0, 1.0, 50):
        goal = home + share * (at - home)
        simulated.step(JointCommand(0, simulated.robot.joint_names, goal, np.zeros(len(at))), 0.03)
    simulated.step(None, 1.0)
    return simulated.measure(0).positions_rad[: len(at)]


def hand_of(simulated: BulletRobot) -> NDArray[np.float64]:
    """(3,) where PyBullet has its hand."""
    number = simulated._joints["j3"].number
    state = simulated._bullet.getLinkState(
        simulated._body, number, computeForwardKinematics=1, physicsClientId=simulated._client
    )
    return np.array(state[4])


@pytest.mark.parametrize("text", ARMS.values(), ids=ARMS)
def test_an_arm_of_any_description_stands_and_goes_where_it_is_sent(tmp_path: Path, text: str) -> None:
    robot = make_robot(str(written(tmp_path, text)))
    at = np.array([-0.6, 0.4, -0.3])
    with BulletRobot(robot) as simulated:
        # Half a degree: a robot that holds. Without a motor's force it falls by a radian.
        np.testing.assert_allclose(goes_to(simulated, at), at, atol=np.deg2rad(0.5))
        movable = [each.name for each in read_tree(robot.urdf_path).by_child.values() if each.kind == "revolute"]
        assert sorted(simulated.measure(0).joint_names) == sorted(movable)


@pytest.mark.parametrize(
    ("name", "said"), [("no effort", "say no effort"), ("less effort than it weighs", "less effort")]
)
def test_a_force_that_is_assumed_is_reported(
    tmp_path: Path, name: str, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    robot = make_robot(str(written(tmp_path, ARMS[name])))
    with caplog.at_level(logging.WARNING), BulletRobot(robot):
        assert said in caplog.text
        assert str(tmp_path / "arm.urdf") in caplog.text


def test_a_soft_arm_bears_its_weight_whatever_its_motors_have(tmp_path: Path) -> None:
    with BulletRobot(make_robot(str(written(tmp_path, ARMS["less effort than it weighs"])))) as simulated:
        simulated.stiffen(0.0)
        at = np.zeros(3)  # stretched out
        np.testing.assert_allclose(goes_to(simulated, at), at, atol=np.deg2rad(1.0))


def test_what_copies_is_in_the_simulation_where_kinematics_says(tmp_path: Path) -> None:
    robot = make_robot(str(written(tmp_path, COPYING, ("j1", "j3"))))
    with BulletRobot(robot) as simulated:
        found = goes_to(simulated, np.array([0.6, -0.3]))
        assert simulated.measure(0).joint_names == ("j1", "j3", "j2")
        # A centimetre; 24 cm where one of both forgets that the joint copies.
        np.testing.assert_allclose(hand_of(simulated), forward_kinematics(robot, found, "hand")[:3, 3], atol=0.01)


def test_the_base_frame_is_the_worlds_whatever_is_below_it(tmp_path: Path) -> None:
    text = with_more(link("foot") + joint("lift", "foot", "base", "0 0 1", LIMIT, "prismatic"))
    robot = make_robot(str(written(tmp_path, text, more="[rest]\nlift = 0.7\n")))
    with BulletRobot(robot) as simulated:
        expected = forward_kinematics(robot, robot.home_rad, "hand")[:3, 3]
        np.testing.assert_allclose(hand_of(simulated), expected, atol=1e-4)


@pytest.mark.parametrize("display", ["", ":77"])
def test_a_window_without_a_display_is_one_line(monkeypatch: pytest.MonkeyPatch, display: str) -> None:
    monkeypatch.setenv("DISPLAY", display)
    with pytest.raises(SetupError, match=f"PyBullet opens no window: .*{display}.*; run without gui") as refused:
        BulletRobot(YUMI, gui=True)
    assert "\n" not in str(refused.value)


def test_a_base_that_is_not_there_is_reported_with_the_users_file(tmp_path: Path) -> None:
    path = tmp_path / "theirs.urdf"
    path.write_text(YUMI.urdf_path.read_text().replace('"yumi_base_link"', '"world"'))
    with pytest.raises(SetupError) as refused:
        make_robot("yumi", str(path))
    assert str(refused.value).startswith(f"{path}: it has no link 'yumi_base_link', which is the base of yumi; ")
    assert "its first link is 'world'" in str(refused.value)
    with pytest.raises(SetupError, match=r"key 'base_link' is 'base', which arm.urdf has not; did you mean 'bases'"):
        make_robot(str(written(tmp_path, ARM.replace('"base"', '"bases"'))))


def test_narrower_limits_of_a_vendors_description_count(tmp_path: Path) -> None:
    text = YUMI.urdf_path.read_text()
    place = text.index("<limit", text.index(f'name="{YUMI.joint_names[0]}"'))
    soft = '<safety_controller k_velocity="9" soft_lower_limit="-2" soft_upper_limit="2"/>'
    path = tmp_path / "theirs.urdf"
    path.write_text(text[:place] + soft + text[place:])
    robot = make_robot("yumi", str(path))
    assert (robot.lower_rad[0], robot.upper_rad[0]) == (-2.0, 2.0)
    np.testing.assert_allclose(robot.upper_rad[1:], YUMI.upper_rad[1:], rtol=1e-8)

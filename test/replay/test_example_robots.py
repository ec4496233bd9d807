# SPDX-License-Identifier: Apache-2.0
"""The robots of examples/robots: each loads, waits where it may, reaches hands ahead, and stands in the simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.packages import package_file
from mild_core.retargeting.robot_checks import arm_notes, check_reach
from mild_core.retargeting.robot_file import find_robot, read_robot
from mild_core.retargeting.robot_proposal import Collision, Hands
from mild_core.retargeting.robots import ROBOTS
from mild_ros.assembly.robot import make_robot
from mild_ros.simulation.bullet import BulletRobot

FOLDER = Path(__file__).parents[2] / "examples" / "robots"
FILES = sorted(FOLDER.glob("*.toml"))
EXPECTED = {"baxter", "g1", "icub", "panda", "pr2", "romeo", "talos", "tiago", "ur10", "ur5"}


def descriptions() -> None:
    """Skip where vendors' descriptions are not installed."""
    try:
        package_file("package://example-robot-data/robots/panda_description/urdf/panda.urdf")
    except SetupError as error:
        pytest.skip(str(error))


def test_ten_robots_are_there_beside_ours() -> None:
    assert {file.stem for file in FILES} >= EXPECTED
    assert set(ROBOTS) >= {"pepper", "yumi"}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_it_waits_where_it_may_and_reaches_hands(file: Path) -> None:
    descriptions()
    robot = read_robot(file)
    check_reach(robot)
    assert not [note for note in arm_notes(robot, "right") if "lies behind" in note or "moves with" in note]
    assert robot.follows_arms
    room = np.minimum(robot.home_rad - robot.lower_rad, robot.upper_rad - robot.home_rad)
    assert room.min() > 0.05
    assert Collision(robot).clearance_m(robot.home_rad) > 0.0
    hands = Hands(robot, starts=3)
    assert hands.reachable >= 24, "of 48 hands ahead"
    assert hands.met >= 0.9 * hands.reachable


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_it_stands_in_the_simulation(file: Path) -> None:
    descriptions()
    robot = make_robot(str(file))
    with BulletRobot(robot) as simulated:
        simulated.step(None, 2.0)
        held = simulated.measure(0).positions_rad[: len(robot.joint_names)]
    # An arm of which a link sags falls by a third of a radian and more.
    np.testing.assert_allclose(held, robot.home_rad, atol=np.deg2rad(0.2))


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_models_of_two_people_move_ours_too(name: str) -> None:
    robot = find_robot(name)
    assert robot.follows_arms
    hands = Hands(robot, starts=2)
    assert hands.met >= 0.9 * hands.reachable

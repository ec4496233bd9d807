# SPDX-License-Identifier: Apache-2.0
"""The simulated robot obeys, with real dynamics, and can be looked at."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mild_core.errors import SetupError
from mild_core.retargeting.robots import ROBOTS
from mild_core.signals import JointCommand
from mild_ros.simulation.backend import RenderCamera, SimulatedScene
from mild_ros.simulation.bullet import PHYSICS_RATE_HZ, BulletRobot

YUMI = ROBOTS["yumi"]
CAMERA = RenderCamera(width=160, height=120, smoothing=1)


@pytest.fixture
def simulated() -> Iterator[BulletRobot]:
    with BulletRobot(YUMI, scene=SimulatedScene()) as robot:
        yield robot


def _command(positions: NDArray[np.float64], velocities: NDArray[np.float64]) -> JointCommand:
    return JointCommand(0, YUMI.joint_names, positions, velocities)


def test_it_starts_at_home_with_the_other_arm_at_rest(simulated: BulletRobot) -> None:
    measured = simulated.measure(7)
    assert measured.stamp_ns == 7
    assert measured.joint_names[:7] == YUMI.joint_names
    np.testing.assert_allclose(measured.positions_rad[:7], YUMI.home_rad, atol=1e-12)
    others = dict(zip(measured.joint_names[7:], measured.positions_rad[7:], strict=True))
    assert others == pytest.approx(dict(YUMI.rest))


def test_it_tracks_a_smooth_motion_within_a_degree(simulated: BulletRobot) -> None:
    steps, speed = 3 * PHYSICS_RATE_HZ, 3.0
    phase = np.arange(7) * 0.3
    errors = []
    for step in range(1, steps + 1):
        time_s = step / PHYSICS_RATE_HZ
        amplitude = 0.4 * min(1.0, time_s) ** 2  # from rest: the robot cannot start at full speed
        wanted = YUMI.home_rad + amplitude * np.sin(speed * time_s + phase)
        simulated.step(_command(wanted, amplitude * speed * np.cos(speed * time_s + phase)), 1 / PHYSICS_RATE_HZ)
        errors.append(simulated.measure(0).positions_rad[:7] - wanted)
    rmse_deg = np.rad2deg(np.sqrt(np.mean(np.square(errors), axis=0)))
    assert rmse_deg.max() < 1.0
    # It is physics, not a copy of the command.
    assert rmse_deg.min() > 1e-4
    measured = simulated.measure(0)
    left = dict(zip(measured.joint_names[7:], measured.positions_rad[7:], strict=True))
    # A tenth of a degree: the left arm holds still against gravity.
    assert left == pytest.approx(dict(YUMI.rest), abs=np.deg2rad(0.1))


def test_an_arm_without_force_falls(simulated: BulletRobot) -> None:
    for name in YUMI.joint_names:
        simulated._joints[name] = replace(simulated._joints[name], force=0.0)
    simulated.step(_command(YUMI.home_rad, np.zeros(7)), 0.5)
    # Gravity alone moves it by far more than the tenth of a degree that a holding arm keeps.
    assert np.abs(simulated.measure(0).positions_rad[:7] - YUMI.home_rad).max() > np.deg2rad(5)


def test_time_shorter_than_a_step_is_owed_not_lost(simulated: BulletRobot) -> None:
    wanted = YUMI.home_rad + 0.2
    with BulletRobot(YUMI, scene=SimulatedScene()) as other:
        for _ in range(100):
            simulated.step(_command(wanted, np.zeros(7)), 0.01)
        other.step(_command(wanted, np.zeros(7)), 1.0)
        assert np.array_equal(simulated.measure(0).positions_rad, other.measure(0).positions_rad)


def test_commands_that_make_no_sense_change_nothing(simulated: BulletRobot) -> None:
    nan = np.full(7, np.nan)
    simulated.step(_command(nan, nan), 0.1)
    simulated.step(JointCommand(0, ("no_such_joint",), np.ones(1), np.ones(1)), 0.1)
    simulated.step(None, 0.1)
    # A tenth of a degree, as when holding.
    np.testing.assert_allclose(simulated.measure(0).positions_rad[:7], YUMI.home_rad, atol=np.deg2rad(0.1))


def test_a_picture_shows_the_robot(simulated: BulletRobot) -> None:
    empty = simulated.render(CAMERA)
    assert empty.shape == (120, 160, 3)
    assert empty.dtype == np.uint8
    assert empty.min() < 100 < 200 < empty.max()
    simulated.step(_command(YUMI.home_rad + np.array([0.5, 0.5, 0, 0, 0, 0, 0]), np.zeros(7)), 1.0)
    moved = simulated.render(CAMERA)
    # An arm that moves changes more than a hundredth of the picture.
    assert np.mean(np.any(moved != empty, axis=2)) > 0.01


def test_bad_descriptions_are_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="no such file"):
        BulletRobot(replace(YUMI, urdf_path=tmp_path / "none.urdf"))
    renamed = tmp_path / "renamed.urdf"
    renamed.write_text(YUMI.urdf_path.read_text().replace("yumi_joint_6_r", "another"))
    with pytest.raises(SetupError, match="no joint yumi_joint_6_r"):
        BulletRobot(replace(YUMI, urdf_path=renamed))


def test_nothing_is_written_to_the_terminal() -> None:
    program = (
        "from mild_core.retargeting.robots import ROBOTS\n"
        "from mild_ros.simulation.bullet import BulletRobot\n"
        "with BulletRobot(ROBOTS['yumi']) as robot:\n"
        "    robot.step(None, 0.1)\n"
        "print('done')\n"
    )
    root = Path(__file__).parents[2]
    ended = subprocess.run([sys.executable, "-c", program], cwd=root, capture_output=True, text=True, timeout=60)
    assert (ended.stdout, ended.stderr, ended.returncode) == ("done\n", "", 0)


def test_a_soft_arm_obeys_less_hard_but_bears_its_own_weight(simulated: BulletRobot) -> None:
    behind = []
    for stiffness in (1.0, 0.0, np.nan):
        simulated.stiffen(stiffness)
        for _ in range(2 * PHYSICS_RATE_HZ):
            simulated.step(_command(YUMI.home_rad, np.zeros(7)), 1 / PHYSICS_RATE_HZ)
        # 1 degree: it stands, whatever the stiffness.
        np.testing.assert_allclose(simulated.measure(0).positions_rad[:7], YUMI.home_rad, atol=np.deg2rad(1.0))
        for _ in range(12):  # a jump, which takes all the force there is
            simulated.step(_command(YUMI.home_rad + 0.3, np.zeros(7)), 1 / PHYSICS_RATE_HZ)
        behind.append(float(np.abs(YUMI.home_rad + 0.3 - simulated.measure(0).positions_rad[:7]).mean()))
    assert behind[1] > behind[0] + 0.01
    assert behind[2] == pytest.approx(behind[0], abs=0.01)  # a hint that is no number is none

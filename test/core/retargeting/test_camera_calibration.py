# SPDX-License-Identifier: Apache-2.0
"""The camera's pose from hands held at the tool: the real stage moves the arm, a simulated person follows it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.retargeting.camera_calibration import (
    CameraCalibration,
    CameraSettings,
    CameraState,
    fit_camera,
    showing_postures,
)
from mild_core.retargeting.contact import shoulder_and_reach_m
from mild_core.retargeting.modes import Mode
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import rotation_from_rpy
from mild_core.retargeting.robot_proposal import hands_ahead
from mild_core.retargeting.robots import ROBOTS
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.stage import Request, Retargeting
from mild_core.shapes import FloatArray
from mild_core.signals import JointCommand, JointMeasurement, SkeletonFrame
from test.core.retargeting.limits import check_limits

TICK_NS = 10_000_000
FRAME_EVERY = 3
JOINTS = ("neck", "pelvis", "right_shoulder", "right_hand", "left_shoulder", "left_hand")
POSE = np.eye(4)
POSE[:3, :3] = rotation_from_rpy(-1.9, 0.1, 1.4)
POSE[:3, 3] = (1.8, -0.6, 0.9)
"""A tracker's frame in the robot's: optical axes, across the room."""

Place = Callable[["Person", FloatArray], FloatArray]


def at_the_tool(_person: Person, tool_m: FloatArray) -> FloatArray:
    return tool_m


@dataclass
class Person:
    """Follows the tool with a hand, half a second after it has come to rest, and holds it there."""

    noise_m: float = 0.01
    hand: str = "right"
    place: Place = at_the_tool
    seed: int = 3
    asked: int = 0
    _at_m: FloatArray | None = None
    _tool_m: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    _still_s: float = 0.0

    def frame(self, tool_m: FloatArray, now_ns: int, elapsed_s: float) -> SkeletonFrame:
        """What a tracker shows of the person, in its own frame."""
        random = np.random.default_rng(self.seed + now_ns)
        body_m = np.array([0.9, 0.1, 0.0])
        hanging_m = np.add(body_m, (0.0, -0.2 if self.hand == "left" else 0.2, -0.6))
        if math.dist(tool_m, self._tool_m) > 0.005:
            self._tool_m, self._still_s = tool_m, 0.0
        self._still_s += elapsed_s
        if self._at_m is None:
            self._at_m = hanging_m
        if self._still_s > 0.5:
            way = self.place(self, tool_m) - self._at_m
            far = float(np.linalg.norm(way))
            self._at_m = self._at_m + way * min(1.0, 0.6 * elapsed_s / max(far, 1e-9))
        places = {
            "neck": np.add(body_m, (0, 0, 0.05)),
            "pelvis": np.add(body_m, (0, 0, -0.5)),
            "right_shoulder": np.add(body_m, (0, 0.2, 0)),
            "left_shoulder": np.add(body_m, (0, -0.2, 0)),
            "right_hand": np.add(body_m, (0, 0.2, -0.6)),
            "left_hand": np.add(body_m, (0, -0.2, -0.6)),
            f"{self.hand}_hand": self._at_m,
        }
        world_m = np.array([places[name] for name in JOINTS])
        seen_m = (world_m - POSE[:3, 3]) @ POSE[:3, :3] + random.normal(0.0, self.noise_m, (len(JOINTS), 3))
        return SkeletonFrame(now_ns, "camera", 1, JOINTS, seen_m, np.ones(len(JOINTS)))


@dataclass
class Run:
    """What came of it."""

    state: CameraState
    said: list[str]
    commands: list[JointCommand]
    mode: Mode
    seconds: float


def run(robot: RobotModel, person: Person, settings: CameraSettings | None = None, at_most_s: float = 400.0) -> Run:
    """The routine against the real stage of retargeting and a robot that obeys."""
    calibration = CameraCalibration(robot, settings or CameraSettings())
    stage = Retargeting(robot, RetargetingSettings(ik="off", home_velocity_rad_s=0.25))
    moving, state, said, commands = stage.init(), calibration.init(), [], []
    joints, chain, start_ns, now_ns = robot.home_rad, chain_of(robot), 10**9, 10**9
    while now_ns - start_ns < at_most_s * 1e9:
        now_ns += TICK_NS
        measured = JointMeasurement(now_ns, robot.joint_names, joints)
        moving, _ = stage.step(moving, measured, now_ns)
        state, _ = calibration.step(state, measured, now_ns)
        if (now_ns // TICK_NS) % FRAME_EVERY == 0:
            people = (person.frame(chain.tool(joints), now_ns, FRAME_EVERY * TICK_NS * 1e-9),)
            state, new = calibration.step(state, people, now_ns)
            said += [one for one in new if isinstance(one, str)]
        state, new = calibration.step(state, None, now_ns)
        for one in new:
            if isinstance(one, Request):
                moving, given = stage.step(moving, one, now_ns)
            else:
                said.append(one)
        moving, given = stage.step(moving, None, now_ns)
        commands += given
        joints = given[-1].positions_rad if given else joints
        if state.phase in ("done", "failed") and moving.mode in (Mode.IDLE, Mode.HOLDING):
            break
    return Run(state, said, commands, moving.mode, (now_ns - start_ns) * 1e-9)


def worst_m(robot: RobotModel, state: CameraState) -> float:
    """The greatest distance between where a hand over the reach is placed and where it is."""
    assert state.fit is not None, state.problem
    hands_m = hands_ahead(robot)
    seen_m = (hands_m - POSE[:3, 3]) @ POSE[:3, :3]
    placed_m = seen_m @ state.fit.pose[:3, :3].T + state.fit.pose[:3, 3]
    return float(np.linalg.norm(placed_m - hands_m, axis=1).max())


@pytest.mark.parametrize("name", sorted(ROBOTS))
@pytest.mark.parametrize("side", ["right", "left"])
def test_a_hand_at_the_tool_shows_where_the_camera_is(name: str, side: str) -> None:
    robot = ROBOTS[name]
    result = run(robot, Person(hand=side), CameraSettings(side=side))
    assert result.state.phase == "done", result.said
    assert worst_m(robot, result.state) < 0.015
    check_limits(robot, result.commands)
    fast = max(float(np.abs(command.velocities_rad_s).max()) for command in result.commands)
    assert fast <= 0.25 + 1e-6, "slowly"
    assert {command.mode for command in result.commands} <= {"idle", "showing", "holding"}
    assert result.seconds < 150


def test_one_place_where_the_hand_was_elsewhere_is_asked_for_again() -> None:
    def careless(person: Person, tool_m: FloatArray) -> FloatArray:
        person.asked += math.dist(person._at_m, tool_m) > 0.3
        return tool_m + (0.12 if 0.0 < person.asked < 60 else 0.0) * np.array([0.0, 0.0, 1.0])

    result = run(YUMI, Person(place=careless))
    assert result.state.phase == "done", result.said
    assert any("the hand was elsewhere" in said for said in result.said), result.said
    assert worst_m(YUMI, result.state) < 0.02


@pytest.mark.parametrize(
    ("person", "said"),
    [
        (Person(hand="left"), "the left hand is up: hold the right one at the tool, or set side to left"),
        (
            Person(place=lambda _, tool: np.array([0.5, 0.1, 0.2]) + 0.15 * (tool - [0.5, 0.1, 0.2])),
            "no right hand was held|as far as the tool",
        ),
        (Person(place=lambda _, tool: tool * [1.0, -1.0, 1.0]), "fit in a mirror only"),
        (Person(place=lambda _, tool: tool * [1.0, 0.3, 1.6]), "hands are .* cm from the tool by the best pose"),
    ],
    ids=["the other hand", "a hand that stays", "swapped sides", "a hand that goes elsewhere"],
)
def test_a_wrong_hand_is_noticed(person: Person, said: str) -> None:
    result = run(YUMI, person, replace(CameraSettings(), wait_s=4.0))
    assert result.state.phase == "failed"
    assert any(re.search(said, line) for line in result.said), result.said


def test_an_arm_that_is_moved_by_hand_is_sent_nowhere() -> None:
    settings = CameraSettings(by_hand=True, places=5)
    calibration = CameraCalibration(YUMI, settings)
    state, chain, now_ns, said = calibration.init(), chain_of(YUMI), 10**9, []
    person = Person()
    postures = [np.array(each) for each in showing_postures(YUMI, 5)]
    for tick in range(5 * 500):
        now_ns += TICK_NS
        joints = postures[tick // 500]
        state, new = calibration.step(state, JointMeasurement(now_ns, YUMI.joint_names, joints), now_ns)
        if tick % FRAME_EVERY == 0:
            people = (person.frame(chain.tool(joints), now_ns, FRAME_EVERY * TICK_NS * 1e-9),)
            state, new = calibration.step(state, people, now_ns)
        state, new = calibration.step(state, None, now_ns)
        said += new
    assert state.phase == "done", said
    assert not [one for one in said if isinstance(one, Request) and one.kind == "show"]
    assert worst_m(YUMI, state) < 0.015


def test_places_are_ahead_apart_and_not_in_one_plane() -> None:
    for robot in ROBOTS.values():
        tools = np.array([chain_of(robot).tool(np.array(each)) for each in showing_postures(robot, 6)])
        shoulder_m, reach_m = shoulder_and_reach_m(robot)
        assert (np.linalg.norm(tools - shoulder_m, axis=1) < reach_m).all()
        assert (tools[:, 0] > 0.1).all()
        spread = np.sqrt(np.linalg.eigvalsh(np.cov(tools.T)))
        assert spread[0] > 0.015, "far from one plane"


def test_the_fit_leaves_out_what_does_not_agree() -> None:
    random = np.random.default_rng(5)
    tools = np.add(random.uniform(-0.3, 0.3, (6, 3)), (0.5, 0.0, 0.3))
    hands = (tools - POSE[:3, 3]) @ POSE[:3, :3] + random.normal(0.0, 0.002, (6, 3))
    hands[[1, 4]] += [[0.2, 0.0, 0.1], [0.0, -0.15, 0.1]]
    fit = fit_camera(tools, hands, 0.035, tools)
    assert fit is not None
    assert fit.used == (True, False, True, True, False, True)
    np.testing.assert_allclose(fit.pose, POSE, atol=0.02)
    x, y, z, roll, pitch, yaw = map(float, fit.text().split())
    np.testing.assert_allclose(rotation_from_rpy(roll, pitch, yaw), fit.pose[:3, :3], atol=1e-3)
    np.testing.assert_allclose([x, y, z], fit.pose[:3, 3], atol=1e-3)
    hands[0] += [0.3, 0.1, 0.0]
    assert fit_camera(tools, hands, 0.035, tools) is None


def test_settings_out_of_range_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="places: 3 is outside its range; give 4 to 12"):
        CameraSettings(places=3)
    with pytest.raises(SetupError, match="side: is 'up'; give right or left"):
        CameraSettings(side="up")

# SPDX-License-Identifier: Apache-2.0
"""The camera's pose over DDS: the node moves the arm, a person holds the hand at its tool, the file gets a pose."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import PoseArray
from std_srvs.srv import Trigger

from mild_core.errors import SetupError
from mild_core.perception.skeletons import SOURCES
from mild_core.retargeting.camera_calibration import showing_postures
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.urdf import rotation_from_rpy
from mild_core.retargeting.robot_proposal import hands_ahead
from mild_ros.assembly.camera import with_pose
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.messages.pose_array import person_to_pose_array
from mild_ros.node_kit.parameter_files import configuration, read_parameters
from test.core.retargeting.test_camera_calibration import JOINTS, POSE, Person
from test.ros.processes import NodeProcess, Probe
from test.ros.surroundings import YUMI, Surroundings

FRAME_S, LONGEST_S = 0.033, 90.0
FILE = "# mine\n/**/pipeline:\n  ros__parameters:\n    robot: yumi # ours\n    source: zed\n"


TRACKER = {"robot": "yumi", "source": "pose_array", "joint_names": JOINTS, "source_axes": "optical"}


def placed_within_m(file: Path) -> float:
    """How far from where it is a hand over the reach is placed by the pose in a parameter file, at most."""
    pose = read_parameters(PipelineParameters, "pipeline", str(file)).robot_from_camera
    x, y, z, *rpy = map(float, pose.split())
    hands_m = hands_ahead(YUMI)
    placed_m = ((hands_m - POSE[:3, 3]) @ POSE[:3, :3]) @ rotation_from_rpy(*rpy).T + (x, y, z)
    return float(np.linalg.norm(placed_m - hands_m, axis=1).max())


class Scene(Surroundings):
    """A robot that obeys, and a person who follows its tool with the hand."""

    def __init__(self, probe: Probe, node: NodeProcess) -> None:
        super().__init__(probe, "camera")
        self._node = node
        self._source = SOURCES["pose_array"].with_joints(JOINTS)
        self._skeleton = probe.node.create_publisher(PoseArray, "skeleton", 10)
        self.person, self._chain, self._due_s = Person(noise_m=0.01), chain_of(YUMI), 0.0
        self.by_hand = False
        self._postures = showing_postures(YUMI, 5)

    def act(self) -> None:
        """Once in a frame of the tracker."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        elapsed_s = min(now_s - self._due_s + FRAME_S, 3 * FRAME_S) if self._due_s else FRAME_S
        self._due_s = now_s + FRAME_S
        joints = np.array(self.commands[-1].position) if self.commands else YUMI.home_rad
        if self.by_hand:
            asked = self._node.output().count("move the arm to place")
            joints = np.array(self._postures[(asked - 1) % len(self._postures)])
        self.measure(joints)
        person = self.person.frame(self._chain.tool(joints), self.probe.now_ns(), elapsed_s)
        self._skeleton.publish(person_to_pose_array(person, self._source))

    def runs_until(self, happened: Callable[[], object], what: str, *, ends: bool = False) -> None:
        """Play on until something has happened; the node may end then, or else not."""

        def look() -> object:
            self.act()
            assert self._node.process.poll() is None or (ends and happened()), self._node.output()
            return happened()

        self.probe.until(look, what, LONGEST_S)


@pytest.mark.heavy
@pytest.mark.slow
def test_an_arm_that_is_moved_by_hand_shows_where_the_camera_is(
    start: Callable[..., NodeProcess], probe: Probe, tmp_path: Path
) -> None:
    file = tmp_path / "new.yaml"
    node = start("camera", by_hand=True, begin=True, places=5, hold_s=0.4, write_to=str(file), **TRACKER)
    scene = Scene(probe, node)
    scene.by_hand, scene.person.noise_m = True, 0.004  # so that one round is enough
    scene.runs_until(file.exists, "a pose", ends=True)
    assert node.wait() == 0, node.output()
    assert not scene.commands, "nothing is commanded"
    assert placed_within_m(file) < 0.02


@pytest.mark.heavy
def test_the_routine_writes_where_the_camera_is(
    start: Callable[..., NodeProcess], probe: Probe, tmp_path: Path
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(FILE)
    node = start("camera", places=4, hold_s=0.6, write_to=str(file), **TRACKER)
    scene = Scene(probe, node)
    scene.runs_until(lambda: scene.commands, "a command")
    answer = probe.call(Trigger, "/camera/calibrate", Trigger.Request())
    assert answer.success, answer.message
    again = probe.call(Trigger, "/camera/calibrate", Trigger.Request())
    assert not again.success
    scene.runs_until(lambda: "written into" in node.output() or "not calibrated" in node.output(), "a pose")
    assert "not calibrated" not in node.output(), node.output()
    assert placed_within_m(file) < 0.015
    assert file.read_text().startswith("# mine\n")
    assert "robot: yumi # ours" in file.read_text()
    assert max(np.abs(command.velocity).max() for command in scene.commands) <= 0.25 + 1e-6, "slowly"


@pytest.mark.parametrize("name", ["yumi", "yumi_abb", "pepper", "pepper_naoqi"])
def test_the_pose_comes_into_any_of_our_files_and_replaces_the_one_before(name: str, tmp_path: Path) -> None:
    text, first = configuration(name).read_text(), "1.0000 2.0000 3.0000 0.1000 0.2000 0.3000"
    once = with_pose(text, first, name)
    twice = with_pose(once, "0 0 0 0 0 1", name)
    assert twice == once.replace(first, "0 0 0 0 0 1")
    path = tmp_path / "it.yaml"
    path.write_text(once)
    assert read_parameters(PipelineParameters, "pipeline", str(path)).robot_from_camera == first
    before = read_parameters(PipelineParameters, "pipeline", name)
    assert read_parameters(PipelineParameters, "pipeline", str(path)).robot == before.robot
    without = [line for line in once.splitlines() if "robot_from_camera" not in line]
    assert without == [line for line in text.splitlines() if "robot_from_camera" not in line]


def test_a_file_of_something_else_is_refused() -> None:
    with pytest.raises(SetupError, match="has no parameters of pipeline or perception; begin it with"):
        with_pose("a: 1\n", "0 0 0 0 0 0", "other.yaml")

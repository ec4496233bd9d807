# SPDX-License-Identifier: Apache-2.0
"""A robot that is neither ours nor trained for: one file, its description, and a model of two people move it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.inference.manifest import ControlledAgent
from mild_core.learning.data.people import PeopleRecording
from mild_core.learning.evaluation.strangers import watch
from mild_core.learning.training.place_fit import touching
from mild_core.perception.skeletons import SOURCES
from mild_core.retargeting.robot_file import find_robot
from mild_core.signals import ARM_JOINTS, JointCommand, MotionWindow
from mild_ros.assembly.inference import load
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.robot import make_robot
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.replay.in_process import Inputs, Step, replay_in_process
from mild_ros.replay.recorded import read_run
from mild_ros.simulation.person import BODY_JOINTS, bodies
from test.core.retargeting.limits import check_limits
from test.core.retargeting.panda import panda_file
from test.replay.made_model import save_random_model
from tools.scenes import RATE_HZ, SCENES, arm_track, write_scene

PARTNER = ControlledAgent("human_arm", "human", ARM_JOINTS, "m")
BENT_M = ((0.0, 0.0, 0.0), (0.15, -0.05, -0.2), (0.4, -0.05, -0.1))
"""An arm that is half offered: what the model's motions are about."""


@pytest.fixture(scope="module")
def panda(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The robot file; the description is the one that comes with PyBullet."""
    return panda_file(tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_random_model(tmp_path_factory.mktemp("models") / "partner", PARTNER, np.ravel(BENT_M), 0.05)


def test_it_runs_from_one_file(panda: Path, model: Path, tmp_path: Path) -> None:
    robot = find_robot(str(panda))
    assert len(robot.joint_names) == 7
    write_scene(next(scene for scene in SCENES if scene.name == "handshake"), tmp_path / "scene")
    parameters = PipelineParameters(model=str(model), robot=str(panda), interaction="hand_shake")
    pipeline = make_pipeline(parameters, load(parameters.model))
    inputs = Inputs(SOURCES["azure_kinect"], robot, joint_states="home")
    commands: list[JointCommand] = []
    motions: list[MotionWindow] = []

    def keep(step: Step) -> None:
        commands.extend(step.output.commands)
        motions.extend(step.output.motions)

    first = replay_in_process(tmp_path / "scene", pipeline, inputs, tmp_path / "run", on_step=keep)
    assert first.counts["retargeting"].get("accepted", 0) > 100, first.counts
    assert "wrong_joints" not in first.counts["retargeting"]
    check_limits(robot, commands)
    followed = np.array([command.positions_rad for command in commands if command.mode == "following"])
    # A handshake lifts the arm: three degrees of each of its first joints at the least.
    assert np.ptp(followed, axis=0)[:4].min() > 0.05, "it moves about"
    again = replay_in_process(tmp_path / "scene", pipeline, inputs)
    assert again == first, "the same bag gives the same bytes"
    read = read_run(tmp_path / "run", inputs.source)
    assert len(read.motions) == len(motions)
    np.testing.assert_array_equal(read.motions[-1].positions, motions[-1].positions)
    assert read.motions[-1].joint_names == ARM_JOINTS


def test_a_robot_without_an_arm_is_refused_before_it_moves(panda: Path, model: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare.toml"
    bare.write_text(
        "".join(line for line in panda.read_text().splitlines(True) if not line.startswith(("shou", "elb")))
    )
    parameters = PipelineParameters(model=str(model), robot=str(bare))
    with pytest.raises(SetupError, match="panda does not say where its shoulder and elbow are"):
        make_pipeline(parameters, load(parameters.model))


def test_a_partner_without_an_elbow_is_refused(model: Path, tmp_path: Path) -> None:
    manifest = json.loads((model / "manifest.json").read_text())
    assert manifest["controlled"]["joint_names"] == list(ARM_JOINTS)
    other = ControlledAgent("human_arm", "human", ("wrist", "elbow", "shoulder"), "m")
    folder = save_random_model(tmp_path / "other", other, np.ravel(BENT_M), 0.05)
    with pytest.raises(SetupError, match="of a partner, not shoulder, elbow, hand"):
        make_pipeline(PipelineParameters(model=str(folder), robot="pepper"), load(str(folder)))


def test_a_vendors_description_takes_the_place_of_ours(tmp_path: Path) -> None:
    ours = find_robot("pepper")
    theirs = tmp_path / "theirs.urdf"
    theirs.write_text(ours.urdf_path.read_text())
    assert make_robot("pepper", str(theirs)).urdf_path == theirs
    theirs.write_text(ours.urdf_path.read_text().replace('name="RElbowYaw"', 'name="REllbowYaw"'))
    with pytest.raises(SetupError, match="it has no joint RElbowYaw"):
        make_robot("pepper", str(theirs.rename(tmp_path / "other.urdf")))
    with pytest.raises(SetupError, match="parameter robot_description: no file"):
        make_robot("pepper", str(tmp_path / "none.urdf"))


@pytest.mark.parametrize(("interaction", "ik"), [("rocket", "blend"), ("rocket", "only"), ("auto", "blend")])
def test_a_hand_is_met_by_a_robot_for_which_nothing_was_learned(panda: Path, interaction: str, ik: str) -> None:
    """The partner's arm gives the posture; the hand's own place is measured."""
    arm = arm_track(next(scene for scene in SCENES if scene.name == "rocket"))
    placed = bodies(arm) @ np.diag([-1.0, -1.0, 1.0]) + np.array([1.05, 0.1, 0.6])
    recording = PeopleRecording(
        "one", "rocket", (np.nan, np.nan), BODY_JOINTS, placed[:, None], np.arange(len(placed)) / RATE_HZ
    )
    parameters = PipelineParameters(
        model="nuisi_partner_next",
        robot=str(panda),
        interaction=interaction,
        ik=ik,
        source="pose_array",
        joint_names=BODY_JOINTS,
        source_axes="rep103",
        robot_from_camera="0 0 0 0 0 0",
    )
    seen = watch(make_pipeline(parameters, load(parameters.model)), recording, 0)
    hand_m = placed[:, BODY_JOINTS.index("right_hand")]
    held_out = np.flatnonzero(touching(hand_m))
    apart_m = np.linalg.norm(seen.hands_m - hand_m, axis=1)[held_out[len(held_out) // 2 :]]
    assert np.median(apart_m) < 0.02

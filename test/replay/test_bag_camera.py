# SPDX-License-Identifier: Apache-2.0
"""Bags state where their camera stood, so that hands meet in a replay without a given camera pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import BagError, SetupError
from mild_core.perception.skeletons import SOURCES
from mild_core.perception.stage import Perception
from mild_ros.assembly.perception import make_perception, manifest_of, robot_from_camera
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.bag.camera import FILE, camera_for, camera_text, read_camera, with_camera, write_camera
from mild_ros.bag.people import people_in_bag
from mild_ros.bag.reader import open_bag
from mild_ros.simulation.person import looking_at
from test.conftest import ROOT
from tools.scenes import MODELS, ROCKET_KNEELING, SCENES, Scene, cameras

SWAY_M = 5e-4
"""Of generated people about their feet; see `tools.scenes`."""

EVERY = (*SCENES, ROCKET_KNEELING)


@pytest.mark.parametrize("scene", EVERY, ids=lambda scene: scene.name)
@pytest.mark.parametrize("robot", MODELS)
def test_the_person_of_a_bag_stands_where_the_models_recordings_put_people(scene: Scene, robot: str) -> None:
    bag = ROOT / "bags" / scene.name
    assert read_camera(bag, robot) == cameras(scene)[robot], "python -m tools.scenes makes it again"
    parameters = with_camera(PipelineParameters(model=MODELS[robot], robot=robot), bag)
    perception: Perception = make_perception(parameters, manifest_of(parameters.model))
    state = perception.init()
    with open_bag(bag) as opened:
        for time_ns, people in people_in_bag(opened, SOURCES["azure_kinect"]):
            state, _ = perception.step(state, people or (), time_ns)
            if state.calibration is not None:
                break
    assert state.calibration is not None
    pose = robot_from_camera(parameters.robot_from_camera)
    assert pose is not None
    placement = manifest_of(parameters.model).robot_from_human
    expected = placement.by_interaction.get(scene.interaction, placement.translation_m)
    np.testing.assert_allclose(pose[:3, :3] @ state.calibration.shoulder_m + pose[:3, 3], expected, atol=SWAY_M)
    forward = pose[:3, :3] @ state.calibration.arm_from_source[0]
    np.testing.assert_allclose(forward, [np.cos(placement.yaw_rad), np.sin(placement.yaw_rad), 0.0], atol=2e-3)


def test_a_given_camera_pose_wins_over_the_bags() -> None:
    bag = ROOT / "bags" / "handshake"
    given = PipelineParameters(robot_from_camera="1 2 3 0 0 0")
    assert with_camera(given, bag).robot_from_camera == "1 2 3 0 0 0"
    given = ["robot_from_camera:=''"]
    assert with_camera(PipelineParameters(), bag, given).robot_from_camera == "", "left unmeasured on purpose"
    assert with_camera(PipelineParameters(robot="another"), bag).robot_from_camera == ""


def test_a_pose_as_text_is_the_same_pose() -> None:
    for pose in (looking_at((2.2, 0.7, 0.15), (0.0, 0.2, -0.4)), looking_at((-1.0, 0.3, 2.0), (0.5, 0.1, 0.2))):
        read = robot_from_camera(camera_text(pose))
        assert read is not None
        np.testing.assert_allclose(read, pose, atol=2e-6)


def test_a_bag_without_a_camera_states_none(tmp_path: Path) -> None:
    assert read_camera(tmp_path, "yumi") == ""
    write_camera(tmp_path, {'a "robot"': "0 0 0 0 0 0"})
    assert read_camera(tmp_path, 'a "robot"') == "0 0 0 0 0 0"
    assert read_camera(tmp_path / "file.mcap", "yumi") == ""


@pytest.mark.parametrize(
    "text",
    ["[", "robot_from_camera = 3", "other = 1", "[robot_from_camera]\nyumi = 3", "\x00", "# " + "x" * 20_000, "\xff"],
)
def test_a_broken_camera_ends_in_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / FILE).write_bytes(text.encode("latin-1"))
    with pytest.raises(BagError, match="holds no robot_from_camera"):
        read_camera(tmp_path, "yumi")


@pytest.mark.parametrize("text", ["1 2 3", "a b c d e f", "nan 0 0 0 0 0", "inf 0 0 0 0 0"])
def test_a_pose_that_is_none_ends_in_one_line(text: str, tmp_path: Path) -> None:
    write_camera(tmp_path, {"yumi": text})
    with pytest.raises(BagError, match="states no pose"):
        with_camera(PipelineParameters(), tmp_path)


def test_a_replay_takes_the_camera_that_the_bag_states_for_the_robot_of_a_configuration(tmp_path: Path) -> None:
    handshake = SCENES[0]
    bag = ROOT / "bags" / handshake.name
    for configuration, robot in (("yumi", "yumi"), ("pepper.yaml", "pepper")):
        assert camera_for(configuration, bag) == read_camera(bag, robot) != ""
    assert camera_for("yumi", tmp_path) == ""
    own = tmp_path / "own.yaml"
    own.write_text("/**/pipeline:\n  ros__parameters:\n    robot_from_camera: '1 0 0 0 0 0'\n")
    assert camera_for(str(own), bag) == "1 0 0 0 0 0", "what is set counts"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1.2 0 0.8 -90 0 90", "look like degrees"),
        ("1200 0 800 0 0 0", "looks like millimetres"),
        ("1 0 0 nan 0 0", "is '1 0 0 nan 0 0'"),
    ],
)
def test_a_camera_pose_in_other_units_is_refused(text: str, said: str) -> None:
    with pytest.raises(SetupError, match="robot_from_camera") as refused:
        robot_from_camera(text)
    assert said in str(refused.value)
    assert "give x y z roll pitch yaw [m, rad]" in str(refused.value)


def test_a_camera_pose_of_almost_a_turn_is_taken() -> None:
    assert robot_from_camera("1 0 0 -6.28 0 3.2") is not None

# SPDX-License-Identifier: Apache-2.0
"""Where the camera of a bag stood: `camera.toml` beside its files, a pose in the base frame of each robot.

A bag of a tracker does not say where its camera stood before a robot. Ours do, and so does what was recorded with a
measured camera, so that hands meet again in a replay.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mild_core.errors import BagError, SetupError
from mild_core.inference.manifest import HumanPlacement
from mild_core.shapes import FloatArray

if TYPE_CHECKING:
    from mild_ros.assembly.settings import PipelineParameters

FILE = "camera.toml"
KEY = "robot_from_camera"
LARGEST_BYTES = 10_000

_HEADING = f"""\
# Where the camera stood: the pose of its frame in the frame of the robot's base link, by the name of the robot.
# `x y z roll pitch yaw` [m, rad], as the parameter `{KEY}` takes it.
[{KEY}]
"""


def camera_text(pose: FloatArray) -> str:
    """A (4, 4) pose as `x y z roll pitch yaw` [m, rad], to a micrometre and a microradian.

    Source: URDF, fixed axes: rotation about x, then y, then z.
    """
    turn = pose[:3, :3]
    pitch = math.atan2(-turn[2, 0], math.hypot(turn[0, 0], turn[1, 0]))
    roll, yaw = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
    return " ".join(f"{value:.6f}" for value in (*pose[:3, 3].tolist(), roll, pitch, yaw))


def facing_camera(placement: HumanPlacement, interaction: str, arm_from_camera: FloatArray) -> FloatArray:
    """(4, 4) pose of a camera in the robot's base frame whose person stands as in a model's recordings.

    Args:
        placement: Where the calibrated shoulder stood.
        interaction: What the person does; one without a place of its own takes the place for all.
        arm_from_camera: (4, 4) the camera in the person's arm frame.
    """
    cosine, sine = math.cos(placement.yaw_rad), math.sin(placement.yaw_rad)
    robot_from_arm = np.eye(4)
    robot_from_arm[:2, :2] = [[cosine, -sine], [sine, cosine]]
    robot_from_arm[:3, 3] = placement.by_interaction.get(interaction, placement.translation_m)
    pose: FloatArray = robot_from_arm @ arm_from_camera
    return pose


def write_camera(folder: Path, cameras: Mapping[str, str]) -> None:
    """Write the poses, by name of the robot, beside the files of a bag."""
    lines = [f"{json.dumps(robot)} = {json.dumps(text)}\n" for robot, text in cameras.items()]
    (folder / FILE).write_text(_HEADING + "".join(lines))


def read_camera(bag: Path, robot: str) -> str:
    """The pose that a bag states for a robot, as the parameter `robot_from_camera` takes it; "" for none.

    Args:
        bag: Its folder, or a file in it.
        robot: As the parameter `robot` names it.

    Raises:
        BagError: The file is there, but holds no poses.
    """
    path = (bag if bag.is_dir() else bag.parent) / FILE
    if not path.is_file():
        return ""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
        if len(data) > LARGEST_BYTES:
            raise ValueError(f"it is longer than {LARGEST_BYTES} bytes")
        poses = tomllib.loads(data.decode())[KEY]
        if not isinstance(poses, dict) or not all(isinstance(text, str) for text in poses.values()):
            raise ValueError("a pose is no text")
    except (OSError, ValueError, KeyError) as error:
        remedy = "write it as in bags/handshake, or remove it"
        raise BagError(str(path), f"holds no {KEY} by robot ({type(error).__name__})", remedy) from None
    return str(poses.get(robot, ""))


def with_camera(parameters: PipelineParameters, bag: Path, given: Sequence[str] = ()) -> PipelineParameters:
    """The parameters with the camera that a bag states, unless they already name one.

    Args:
        parameters: As they were read.
        bag: The bag that is replayed.
        given: Each `NAME:=VALUE` of the command line: an empty `robot_from_camera` there leaves it unmeasured.

    Raises:
        BagError: As `read_camera`.
        SetupError: The bag states no pose.
    """
    from mild_ros.assembly.perception import robot_from_camera

    if parameters.robot_from_camera or any(word.startswith(f"{KEY}:=") for word in given):
        return parameters
    stated = read_camera(bag, parameters.robot)
    try:
        robot_from_camera(stated)
    except SetupError:
        raise BagError(str(bag), f"{FILE} states no pose for {parameters.robot}", "give six numbers") from None
    return replace(parameters, robot_from_camera=stated)


def camera_for(config: str, bag: Path) -> str:
    """The camera for a replay with the parameters of a configuration, as the parameter takes it; "" for none.

    Args:
        config: A name in `share/mild_ros/config`, or a path, with or without `.yaml`.
        bag: The bag that is replayed.

    Raises:
        BagError: As `with_camera`.
        SetupError: There is no such configuration, or it sets what there is not.
    """
    from mild_ros.assembly.settings import PipelineParameters
    from mild_ros.node_kit.parameter_files import read_parameters

    return with_camera(
        read_parameters(PipelineParameters, "pipeline", config.removesuffix(".yaml")), bag
    ).robot_from_camera


def keep_camera(recorded: Path, parameters: PipelineParameters) -> None:
    """Let a recorded bag state the camera that it was recorded with, if it was measured."""
    if parameters.robot_from_camera:
        write_camera(recorded, {parameters.robot: parameters.robot_from_camera})

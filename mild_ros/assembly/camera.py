# SPDX-License-Identifier: Apache-2.0
"""Finding the camera's pose, made from parameters, and written into a parameter file."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from mild_core.budgets import SETTINGS_BYTES, read_file
from mild_core.errors import SetupError
from mild_core.parameters import chosen, parameter
from mild_core.retargeting.camera_calibration import DEFAULT_PLACES, FEWEST, MOST, CameraCalibration, CameraSettings
from mild_core.retargeting.robot_checks import check_reach
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.stage import Retargeting
from mild_ros.assembly.perception import robot_from_camera
from mild_ros.assembly.robot import make_robot
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.commands.controller_messages import delay_of

SLOWLY_RAD_S = 0.25
"""Largest speed of a joint on the way to a place: people stand beside the arm, and it is not known yet where."""

KEY = "robot_from_camera"
SECTION = re.compile(r"^(?P<indent>\s*)(?P<name>[^\s#:]*(?:pipeline|perception)|/?\*\*)\s*:\s*(?:#.*)?$")


@dataclass(frozen=True, kw_only=True)
class CameraParameters(PipelineParameters):
    """Of the camera node: those of the pipeline, so that its parameter file fits, and how hands are taken."""

    places: int = parameter(
        DEFAULT_PLACES, "At so many places the hand is held.", minimum=float(FEWEST), maximum=float(MOST)
    )
    by_hand: bool = parameter(False, "People move the arm; nothing is commanded.")
    hold_s: float = parameter(
        CameraSettings.hold_s, "The hand is held at a place for this time.", unit="s", minimum=0.3, maximum=10.0
    )
    begin: bool = parameter(False, "Begin at once and end with the result, without a call of `~/calibrate`.")
    write_to: str = parameter("", "Parameter file that gets the pose as `robot_from_camera`; empty writes none.")


def make_camera(parameters: CameraParameters) -> tuple[Retargeting, CameraCalibration]:
    """What moves the arm, and what says where to.

    Raises:
        SetupError: There is no such robot, or its arm can show its hand nowhere.
    """
    robot = make_robot(parameters.robot, parameters.robot_description)
    check_reach(robot)
    settings = chosen(
        RetargetingSettings,
        parameters,
        execution_delay_s=delay_of(parameters, parameters.control_rate_hz),
        ik="off",
        home_velocity_rad_s=min(parameters.home_velocity_rad_s, SLOWLY_RAD_S),
    )
    wanted = CameraSettings(parameters.side, parameters.places, parameters.by_hand, parameters.hold_s)
    return Retargeting(robot, settings), CameraCalibration(robot, wanted)


def check_target(write_to: str) -> None:
    """Make sure, before an arm moves, that the pose can be written.

    Raises:
        SetupError: It cannot.
    """
    if not write_to:
        return
    path = Path(write_to).expanduser()
    if path.exists():
        with_pose(_read(path), "0 0 0 0 0 0", str(path))
    folder = path.parent
    if not folder.is_dir() or not os.access(path if path.exists() else folder, os.W_OK):
        raise SetupError("parameter write_to", f"{path} cannot be written", "give a file in a folder of yours")


def write_pose(write_to: str, pose: str, parameters: CameraParameters) -> None:
    """Write a pose into a parameter file: into what is there, or a new one; whole or not at all.

    Raises:
        SetupError: The file cannot be understood.
    """
    path = Path(write_to).expanduser()
    new = f"/**/pipeline:\n  ros__parameters:\n    robot: {_yaml(parameters.robot)}\n    source: {parameters.source}\n"
    text = with_pose(_read(path) if path.exists() else new, pose, str(path))
    scratch = path.with_name(f".{path.name}.{os.getpid()}")
    scratch.write_text(text, encoding="utf-8")
    scratch.replace(path)


def _read(path: Path) -> str:
    return read_file(path, SETTINGS_BYTES).decode(errors="replace")


def _yaml(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def with_pose(text: str, pose: str, name: str) -> str:
    """A parameter file with the camera's pose in place of the one that it has; all else, comments too, as it was.

    Args:
        text: The file.
        pose: As the parameter takes it.
        name: What to call it when something is wrong.

    Raises:
        SetupError: It has no parameters of a pipeline or perception.
    """
    robot_from_camera(pose)
    line = f"{KEY}: '{pose}'"
    old = re.compile(rf"^(\s*){KEY}\s*:.*$", re.MULTILINE)
    if old.search(text):
        return old.sub(lambda found: f"{found.group(1)}{line}", text)
    lines = text.splitlines()
    for place, each in enumerate(lines):
        if not SECTION.match(each):
            continue
        below = next((n for n in range(place + 1, len(lines)) if "ros__parameters:" in lines[n]), None)
        if below is None:
            continue
        said = [entry for entry in lines[below + 1 :] if entry.strip() and not entry.strip().startswith("#")]
        own, first = _indent(lines[below]), _indent(said[0]) if said else 0
        indent = first if first > own else own + 2
        return "\n".join([*lines[: below + 1], " " * indent + line, *lines[below + 1 :]]) + "\n"
    remedy = "begin it with /**/pipeline: as config/yumi.yaml"
    raise SetupError(name, "has no parameters of pipeline or perception", remedy)


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())

# SPDX-License-Identifier: Apache-2.0
"""A small arm in a robot file of its own, for descriptions of all kinds."""

from __future__ import annotations

from pathlib import Path

from mild_core.retargeting.robot_file import read_robot
from mild_core.retargeting.robot_model.kinematics import read_tree
from mild_core.retargeting.robot_model.robot import RobotModel

MASS = (
    '<inertial><origin xyz="0.15 0 0"/><mass value="2"/>'
    '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>'
)
LIMIT = '<limit lower="-1.5" upper="1.5" velocity="2" effort="60"/>'


def link(name: str) -> str:
    return f'<link name="{name}">{MASS}</link>'


def joint(name: str, parent: str, child: str, axis: str = "0 1 0", more: str = LIMIT, kind: str = "revolute") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0.3 0 0"/>'
    return f'<joint name="{name}" type="{kind}">{ends}<axis xyz="{axis}"/>{more}</joint>'


ARM = (
    '<robot name="arm"><link name="base"/>'
    + "".join(map(link, ("upper", "fore", "hand")))
    + joint("j1", "base", "upper")
    + joint("j2", "upper", "fore", "0 0 1")
    + joint("j3", "fore", "hand")
    + "</robot>"
)

_COPIES = '<mimic joint="j1" multiplier="-2" offset="0.4"/>' + LIMIT
COPYING = ARM.replace(joint("j2", "upper", "fore", "0 0 1"), joint("j2", "upper", "fore", "0 0 1", _COPIES))
"""Its second joint copies the first one."""

FILE = """name = "arm"
description = "arm.urdf"
base_link = "base"
tool_link = "hand"
joint_names = {names}
home_rad = {home}
acceleration_rad_s2 = 10
jerk_rad_s3 = 300
"""


def with_more(text: str, arm: str = ARM) -> str:
    """The description with something more in it."""
    return arm.replace("</robot>", f"{text}</robot>")


def written(
    folder: Path, description: str | bytes = ARM, joints: tuple[str, ...] = ("j1", "j2", "j3"), more: str = ""
) -> Path:
    """The robot file, its description beside it."""
    (folder / "arm.urdf").write_bytes(description if isinstance(description, bytes) else description.encode())
    read_tree.cache_clear()
    path = folder / "arm.toml"
    path.write_text(FILE.format(names=list(joints), home=[0.2] * len(joints)) + more)
    return path


def small_arm(
    folder: Path, description: str | bytes = ARM, joints: tuple[str, ...] = ("j1", "j2", "j3"), more: str = ""
) -> RobotModel:
    return read_robot(written(folder, description, joints, more))

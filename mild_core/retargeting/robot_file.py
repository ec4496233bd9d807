# SPDX-License-Identifier: Apache-2.0
"""A robot of the user's, from a small TOML file beside its description: nothing of this package has to change.

    name = "panda"
    description = "panda.urdf"                 # beside this file, or a whole path
    base_link = "panda_link0"                  # x forward, y left, z up
    tool_link = "panda_hand"                   # what meets the person's hand
    shoulder_link = "panda_link2"              # with elbow_link: for models that move a partner's arm
    elbow_link = "panda_link4"
    joint_names = ["panda_joint1", "panda_joint2"]      # base to tool; all of them
    home_rad = [0.0, -0.5]
    acceleration_rad_s2 = 10.0                 # one for all joints, or one for each
    jerk_rad_s3 = 200.0
    floor_m = -0.8                             # height of the floor, where it is known
    on_table = true                            # draws a table under the robot
    [rest]                                     # joints that nothing commands
    panda_finger_joint1 = 0.02

Position and velocity limits are the description's; `lower_rad`, `upper_rad` and `velocity_rad_s` replace them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from mild_core.budgets import parse_toml, read_file
from mild_core.errors import SetupError, unknown_name
from mild_core.fields import Fields
from mild_core.retargeting.arm_following import LinkFollower
from mild_core.retargeting.kinematics import read_tree
from mild_core.retargeting.robot import RobotModel
from mild_core.retargeting.robots import ROBOTS
from mild_core.retargeting.urdf import Joint
from mild_core.shapes import FloatArray, read_only

SIZE_LIMIT = 100_000
"""Bytes; a robot file has some hundred."""

REQUIRED = ("name", "description", "base_link", "tool_link", "joint_names", "home_rad")
LINKS = ("shoulder_link", "elbow_link")
URDF_LIMITS = ("lower_rad", "upper_rad", "velocity_rad_s")
OWN_LIMITS = ("acceleration_rad_s2", "jerk_rad_s3")
KEYS = (*REQUIRED, *LINKS, *URDF_LIMITS, *OWN_LIMITS, "floor_m", "on_table", "rest")

MOST_JOINTS, LARGEST = 32, 1e6


def find_robot(given: str) -> RobotModel:
    """The robot of a name in `ROBOTS`, or of the robot file with a path.

    Raises:
        SetupError: There is neither, or the file cannot be used.
    """
    path = Path(given).expanduser()
    if path.suffix == ".toml" or len(path.parts) > 1:
        return read_robot(path)
    if given not in ROBOTS:
        raise unknown_name("robot", given, (*ROBOTS, "the path of a robot file (.toml)"))
    return ROBOTS[given]


def read_robot(path: Path) -> RobotModel:
    """The robot in a robot file, checked against its description.

    Raises:
        SetupError: Names the file, the key and what is wrong.
    """
    content = read_file(path, SIZE_LIMIT, "give the path of a robot file")
    try:
        values = parse_toml(content)
    except ValueError as error:
        raise SetupError(str(path), f"is no TOML: {error}", "see 'Add a robot' in the README") from None
    robot = _robot(path, Fields(str(path), "", values, "see 'Add a robot' in the README", SetupError))
    if robot.arm_links is not None:
        LinkFollower(robot)  # says in one line what does not fit
    return robot


def _robot(path: Path, fields: Fields) -> RobotModel:
    fields.only(KEYS)
    names = fields.names("joint_names", MOST_JOINTS)
    urdf_path = path.parent / Path(fields.text("description")).expanduser()
    joints = {joint.name: joint for joint in read_tree(urdf_path).by_child.values()}
    for name in names:
        if name not in joints:
            raise fields.wrong("joint_names", f"holds '{name}', which {urdf_path.name} has not")
    limits = _limits(fields, names, joints, urdf_path.name)
    rest = fields.object("rest") if "rest" in fields.values else fields.below("rest", {})
    rest.only(set(joints) - set(names))
    links = tuple(fields.text(key) for key in LINKS) if set(LINKS) & set(fields.values) else None
    try:
        return RobotModel(
            name=fields.text("name"),
            joint_names=names,
            lower_rad=limits["lower_rad"],
            upper_rad=limits["upper_rad"],
            velocity_rad_s=limits["velocity_rad_s"],
            acceleration_rad_s2=_per_joint(fields, "acceleration_rad_s2", len(names)),
            jerk_rad_s3=_per_joint(fields, "jerk_rad_s3", len(names)),
            home_rad=read_only(fields.numbers("home_rad", len(names), -LARGEST, LARGEST)),
            urdf_path=urdf_path,
            base_link=fields.text("base_link"),
            tool_link=fields.text("tool_link"),
            rest=tuple((name, rest.number(name, -LARGEST, LARGEST)) for name in rest.values),
            floor_m=fields.number("floor_m", -10.0, 10.0) if "floor_m" in fields.values else None,
            on_table=fields.flag("on_table") if "on_table" in fields.values else False,
            arm_links=None if links is None else (links[0], links[1]),
        )
    except ValueError as error:
        raise SetupError(str(path), str(error), fields.remedy) from None


def _limits(fields: Fields, names: tuple[str, ...], joints: Mapping[str, Joint], source: str) -> dict[str, FloatArray]:
    """Lower, upper and velocity limits: the file's, or else the description's."""
    limits: dict[str, FloatArray] = {}
    for place, key in enumerate(URDF_LIMITS):
        written = [joints[name].limits[place] for name in names]
        if key not in fields.values and any(map(math.isnan, written)):
            unlimited = names[[math.isnan(value) for value in written].index(True)]
            raise fields.wrong(key, f"is missing, and {source} has none for '{unlimited}'")
        limits[key] = _per_joint(fields, key, len(names)) if key in fields.values else read_only(written)
    return limits


def _per_joint(fields: Fields, key: str, joints: int) -> FloatArray:
    """(J,) one number for all joints, or a list."""
    if isinstance(fields.take(key), list):
        return read_only(fields.numbers(key, joints, -LARGEST, LARGEST))
    return read_only([fields.number(key, -LARGEST, LARGEST)] * joints)

# SPDX-License-Identifier: Apache-2.0
"""A robot of the user's, from a small TOML file beside its description: nothing of this package has to change.

    name = "panda"
    description = "panda.urdf"                 # beside this file, a whole path, or package://<package>/<path>
    base_link = "panda_link0"                  # x forward, y left, z up
    tool_link = "panda_hand"                   # what meets the person's hand
    shoulder_link = "panda_link2"              # with elbow_link: for models that move a partner's arm
    elbow_link = "panda_link4"
    joint_names = ["panda_joint1", "panda_joint2"]      # base to tool; all of them
    home_rad = [0.0, -0.5]
    acceleration_rad_s2 = 10.0                 # one for all joints, or one for each
    jerk_rad_s3 = 200.0
    floor_m = -0.8                             # height of the floor, where it is known
    on_table = true                            # a table under the robot: drawn, and kept out of
    joint_limits = "joint_limits.yaml"         # of MoveIt or ros2_control, or a list of such files
    [rest]                                     # joints that nothing commands
    panda_finger_joint1 = 0.02

Position and velocity limits are the description's, soft ones where it has them; `lower_rad`, `upper_rad` and
`velocity_rad_s` replace them. Limits of `joint_limits` count where they are narrower than all of these, and stand for
`acceleration_rad_s2` and `jerk_rad_s3` where these are left out.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from mild_core.budgets import parse_toml, read_file
from mild_core.errors import SetupError, near, unknown_name
from mild_core.fields import Fields
from mild_core.packages import PACKAGE, package_file
from mild_core.retargeting.robot_model.arm_following import LinkFollower
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.joint_limits import JointLimits, read_joint_limits
from mild_core.retargeting.robot_model.kinematics import read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import FIXED, Joint
from mild_core.retargeting.robots import ROBOTS
from mild_core.shapes import FloatArray, read_only

SIZE_LIMIT = 100_000
"""Bytes; a robot file has some hundred."""

REQUIRED = ("name", "description", "base_link", "tool_link", "joint_names", "home_rad")
LINKS = ("shoulder_link", "elbow_link")
URDF_LIMITS = ("lower_rad", "upper_rad", "velocity_rad_s")
OWN_LIMITS = ("acceleration_rad_s2", "jerk_rad_s3")
KEYS = (*REQUIRED, *LINKS, *URDF_LIMITS, *OWN_LIMITS, "joint_limits", "floor_m", "on_table", "rest")

MOST_JOINTS, LARGEST = 32, 1e6


def find_robot(given: str) -> RobotModel:
    """The robot of a name in `ROBOTS`, or of the robot file with a path.

    Raises:
        SetupError: There is neither, or the file cannot be used.
    """
    path = Path(given).expanduser()
    if path.suffix == ".toml" or len(path.parts) > 1:
        return read_robot(path)
    if path.is_dir() and given not in ROBOTS:
        raise _folder(path)
    if given not in ROBOTS:
        raise unknown_name("robot", given, (*ROBOTS, "the path of a robot file (.toml)"))
    return ROBOTS[given]


def read_robot(path: Path) -> RobotModel:
    """The robot in a robot file, checked against its description.

    Raises:
        SetupError: Names the file, the key and what is wrong.
    """
    if path.is_dir():
        raise _folder(path)
    content = read_file(path, SIZE_LIMIT, "give the path of a robot file")
    try:
        values = parse_toml(content)
    except ValueError as error:
        raise SetupError(str(path), f"is no TOML: {error}", "see docs/robot.md") from None
    robot = _robot(path, Fields(str(path), "", values, "see docs/robot.md", SetupError))
    chain_of(robot)  # both say in one line what does not fit
    if robot.arm_links is not None:
        LinkFollower(robot)
    return robot


def _folder(path: Path) -> SetupError:
    """The error for a folder in the place of a robot file; names those that are in it."""
    inside = sorted(path.glob("*.toml"))
    shown = " or ".join(map(str, inside[:3])) or "the path of a robot file; there is none in it"
    return SetupError(f"robot {path}", "is a folder, not a robot file", f"give {shown}")


def _robot(path: Path, fields: Fields) -> RobotModel:
    fields.only(KEYS)
    names = fields.names("joint_names", MOST_JOINTS)
    named = fields.text("description")
    urdf_path = package_file(named) if named.startswith(PACKAGE) else path.parent / Path(named).expanduser()
    tree = read_tree(urdf_path)
    joints = {joint.name: joint for joint in tree.by_child.values()}
    for name in names:
        if name not in joints:
            raise fields.wrong("joint_names", f"holds '{name}', which {urdf_path.name} has not", near(name, joints))
        if joints[name].kind in FIXED:
            raise fields.wrong("joint_names", f"holds '{name}', which does not move: it is {joints[name].kind}")
        if (leader := tree.followed(joints[name])[0]) != name:
            raise fields.wrong("joint_names", f"holds '{name}', which copies '{leader}'", f"command '{leader}'")
    links = tuple(fields.text(key) for key in LINKS) if set(LINKS) & set(fields.values) else None
    for key in ("base_link", "tool_link", *(LINKS if links else ())):
        if (link := fields.text(key)) not in tree.links:
            raise fields.wrong(key, f"is '{link}', which {urdf_path.name} has not", near(link, tree.links))
    written, notes = _written(fields, names, joints, urdf_path.name)
    limits = _limits(fields, names, joints, urdf_path.name, written)
    rest = fields.object("rest") if "rest" in fields.values else fields.below("rest", {})
    rest.only(set(joints) - set(names))
    on_table = fields.flag("on_table") if "on_table" in fields.values else False
    notes += tree.notes(() if {"lower_rad", "upper_rad"} <= set(fields.values) else names)
    if endless := [name for name in names if _endless(fields, joints[name])]:
        what = "turn without end, and are kept within half a turn of zero; lower_rad and upper_rad say otherwise:"
        notes += (f"{urdf_path}: joints that {what} {', '.join(endless)}",)
    try:
        return RobotModel(
            name=fields.text("name"),
            joint_names=names,
            lower_rad=limits["lower_rad"],
            upper_rad=limits["upper_rad"],
            velocity_rad_s=limits["velocity_rad_s"],
            acceleration_rad_s2=limits["acceleration_rad_s2"],
            jerk_rad_s3=limits["jerk_rad_s3"],
            home_rad=read_only(fields.numbers("home_rad", len(names), -LARGEST, LARGEST)),
            urdf_path=urdf_path,
            base_link=fields.text("base_link"),
            tool_link=fields.text("tool_link"),
            rest=tuple((name, rest.number(name, -LARGEST, LARGEST)) for name in rest.values),
            floor_m=fields.number("floor_m", -10.0, 10.0) if "floor_m" in fields.values else None,
            on_table=on_table,
            keeps_off_table=on_table,
            arm_links=None if links is None else (links[0], links[1]),
            notes=notes,
        )
    except ValueError as error:
        raise SetupError(str(path), f"{error}{_whose(fields, names, joints, written)}", fields.remedy) from None


def _whose(fields: Fields, names: tuple[str, ...], joints: Mapping[str, Joint], written: list[JointLimits]) -> str:
    """Whose position limits hold for joints whose home lies outside them, where it is not this file's own."""
    stated = {"lower_rad", "upper_rad"} <= set(fields.values)
    for name, at, one in zip(names, _per_joint(fields, "home_rad", len(names)).tolist(), written, strict=True):
        lower, upper, _ = joints[name].limits
        if not one.lower <= at <= one.upper:
            return f"; those of {one.source} hold"
        if joints[name].soft == "kept" and not stated and not lower <= at <= upper:
            return f"; the soft limits of {fields.text('description')} hold"
    return ""


def _limits(
    fields: Fields, names: tuple[str, ...], joints: Mapping[str, Joint], source: str, written: list[JointLimits]
) -> dict[str, FloatArray]:
    """All limits: the file's, or else the description's, or what is narrower in files of limits."""
    limits: dict[str, FloatArray] = {}
    for place, key in enumerate((*URDF_LIMITS, *OWN_LIMITS)):
        also = np.array([each[place] for each in written])
        if key in fields.values:
            found = _per_joint(fields, key, len(names))
        elif key in URDF_LIMITS:
            found = np.array([_described(fields, joints[name], place) for name in names])
            unlimited = np.isnan(found) & ~np.isfinite(also)
            if unlimited.any():
                name = names[int(np.argmax(unlimited))]
                raise fields.wrong(key, f"is missing, and {source} has none that '{name}' could move in")
        else:
            if not np.isfinite(also).all():
                name = names[int(np.argmin(np.isfinite(also)))]
                known = f", and joint_limits has none for '{name}'" if "joint_limits" in fields.values else ""
                raise fields.wrong(key, f"is missing{known}")
            found = also
        limits[key] = read_only(np.fmax(found, also) if key == "lower_rad" else np.fmin(found, also))
    return limits


def _written(
    fields: Fields, names: tuple[str, ...], joints: Collection[str], source: str
) -> tuple[list[JointLimits], tuple[str, ...]]:
    """What files of limits say of each joint, the narrowest; and a line for each file with joints that there are not.

    Such a file is one for all of a robot: joints of the description that are not commanded belong there.
    """
    found = [JointLimits()] * len(names)
    notes: tuple[str, ...] = ()
    if "joint_limits" not in fields.values:
        return found, notes
    several = isinstance(fields.take("joint_limits"), list)
    folder = Path(fields.source).parent
    for each in fields.names("joint_limits", MOST_JOINTS) if several else (fields.text("joint_limits"),):
        path = folder / Path(each).expanduser()
        read = read_joint_limits(path)
        if not set(read) & set(names):
            problem = f"names {path.name}, which has none of the joints"
            raise fields.wrong("joint_limits", problem, f"it has {', '.join(list(read)[:10])}")
        if strange := [name for name in read if name not in joints]:
            unset = [name for name in joints if name not in read]
            named = ", ".join(f"'{name}' ({near(name, unset)})" for name in strange[:3])
            more = f" and {len(strange) - 3} more" if len(strange) > 3 else ""
            notes += (f"{path}: limits for joints that {source} has not, which bind nothing: {named}{more}",)
        for place, name in enumerate(names):
            found[place] = found[place].narrowed(read.get(name, JointLimits()), path.name)
    return found, notes


def _described(fields: Fields, joint: Joint, place: int) -> float:
    """A limit in the description; half a turn to either side for a joint that turns without end."""
    if place < 2 and _endless(fields, joint):
        return (-math.pi, math.pi)[place]
    return joint.limits[place]


def _endless(fields: Fields, joint: Joint) -> bool:
    """Whether a joint turns without end and the file leaves it at that."""
    said = {"lower_rad", "upper_rad"} & set(fields.values)
    return joint.kind == "continuous" and math.isnan(joint.limits[0]) and not said


def _per_joint(fields: Fields, key: str, joints: int) -> FloatArray:
    """(J,) one number for all joints, or a list."""
    if isinstance(fields.take(key), list):
        return read_only(fields.numbers(key, joints, -LARGEST, LARGEST))
    return read_only([fields.number(key, -LARGEST, LARGEST)] * joints)

# SPDX-License-Identifier: Apache-2.0
"""Limits of joints from the file in which MoveIt and ros2_control keep them (`joint_limits.yaml`).

Both write the same keys under `joint_limits`, at the top or below a node's name; MoveIt leaves positions to the URDF.
Sources: moveit_core, `robot_model_loader.cpp`; ros2_control, `joint_limits_rosparam.hpp`. The tags `!degrees` and
`!radians` are those of xacro, with which Universal Robots write theirs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from mild_core.budgets import SETTINGS_BYTES, read_file
from mild_core.errors import SetupError
from mild_core.fields import Fields
from mild_core.printable import printable
from mild_core.yaml_budget import check_yaml

KEY, DEEPEST = "joint_limits", 6
"""Where the limits are, and below how many names they may be."""

REMEDY = "give a joint_limits.yaml of MoveIt or ros2_control"

LARGEST = 1e6


class JointLimits(NamedTuple):
    """What files say of one joint; infinite where they say nothing [rad, rad/s, rad/s^2, rad/s^3]."""

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    acceleration: float = math.inf
    jerk: float = math.inf
    source: str = ""
    """The file of the position limits, for messages."""

    def narrowed(self, other: JointLimits, source: str) -> JointLimits:
        """The narrower of both, position limits of `other` as those of the file `source`."""
        mine = other.lower <= self.lower and other.upper >= self.upper
        upper, velocity, acceleration, jerk = map(min, self[1:5], other[1:5])
        lower = max(self.lower, other.lower)
        return JointLimits(lower, upper, velocity, acceleration, jerk, self.source if mine else source)


def _angle(unit: float) -> Callable[[Any, Any], float]:
    def value(loader: Any, node: Any) -> float:
        if node.id != "scalar":
            raise ValueError(f"line {node.start_mark.line + 1}: {node.tag} stands before no number")
        return unit * float(loader.construct_scalar(node))

    return value


def read_joint_limits(path: Path) -> dict[str, JointLimits]:
    """The limits in a file, by joint.

    Raises:
        SetupError: Names the file, the key and what is wrong.
    """
    import yaml  # only who has such a file needs it

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """Knows xacro's two tags."""

    Loader.add_constructor("!degrees", _angle(math.pi / 180.0))
    Loader.add_constructor("!radians", _angle(1.0))
    text = read_file(path, SETTINGS_BYTES, REMEDY).decode(errors="replace")
    try:
        check_yaml(text)
        values = Loader(text).get_single_data()
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        problem = f"is no YAML that can be used: {printable(' '.join(str(error).split()), 200)}"
        raise SetupError(str(path), problem, REMEDY) from None
    found = _below(values, DEEPEST)
    if not isinstance(found, dict) or not found:
        raise SetupError(str(path), f"has no key '{KEY}' with joints below it", REMEDY)
    fields = Fields(str(path), f"{KEY}.", found, REMEDY, SetupError)
    return {str(name): _limits(fields.object(name)) for name in found}


def _below(values: Any, deepest: int) -> Any:
    """What is under the key, wherever it is; None if it is nowhere."""
    if not isinstance(values, Mapping) or not deepest:
        return None
    if KEY in values:
        return values[KEY]
    return next((found for value in values.values() if (found := _below(value, deepest - 1)) is not None), None)


def _limits(joint: Fields) -> JointLimits:
    """Of one joint. What it says not to have does not count; the narrower of hard and soft ones does."""

    def number(key: str, has: str, least: float) -> float:
        if key not in joint.values or (has in joint.values and not joint.flag(has)):
            return math.nan
        return joint.number(key, least, LARGEST)

    def positive(key: str, has: str) -> float:
        value = number(key, has, 0.0)
        if value == 0.0:
            raise joint.wrong(key, "is 0: the joint could not move")
        return math.inf if math.isnan(value) else value

    lower = max(
        _or(number("min_position", "has_position_limits", -LARGEST), -math.inf),
        _or(number("soft_lower_limit", "has_soft_limits", -LARGEST), -math.inf),
    )
    upper = min(
        _or(number("max_position", "has_position_limits", -LARGEST), math.inf),
        _or(number("soft_upper_limit", "has_soft_limits", -LARGEST), math.inf),
    )
    if not lower < upper:
        raise joint.wrong("max_position", f"is {upper:g}, not above min_position {lower:g}")
    acceleration = positive("max_acceleration", "has_acceleration_limits")
    return JointLimits(
        lower,
        upper,
        positive("max_velocity", "has_velocity_limits"),
        min(acceleration, positive("max_deceleration", "has_deceleration_limits")),
        positive("max_jerk", "has_jerk_limits"),
    )


def _or(value: float, instead: float) -> float:
    return instead if math.isnan(value) else value

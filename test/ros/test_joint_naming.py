# SPDX-License-Identifier: Apache-2.0
"""A robot's own names of its joints: commands carry theirs, measurements are understood by ours, in any order."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.signals import JointCommand, JointMeasurement
from mild_ros.commands.joint_naming import joint_naming

OURS, THEIRS = ("a", "b", "c"), ("j2", "j3", "j1")


def test_a_command_has_their_names_and_the_same_values() -> None:
    command = JointCommand(5, OURS, np.arange(3.0), 10.0 * np.arange(3.0))
    renamed = joint_naming(OURS, THEIRS).renamed(command)
    assert renamed.joint_names == THEIRS
    np.testing.assert_array_equal(renamed.positions_rad, command.positions_rad)
    assert joint_naming(OURS, ()).renamed(command) is command


def test_a_measurement_is_understood_by_name_and_not_by_place() -> None:
    heard = JointMeasurement(5, ("j1", "gripper", "j2", "j3"), np.array([1.0, 9.0, 2.0, 3.0]))
    understood = joint_naming(OURS, THEIRS).understood(heard)
    assert understood.joint_names == ("c", "gripper", "a", "b")
    np.testing.assert_array_equal(understood.of(OURS), [2.0, 3.0, 1.0])


@pytest.mark.parametrize("given", [("x",), ("x", "y", "y"), ("w", "x", "y", "z")])
def test_there_is_one_name_for_each_joint(given: tuple[str, ...]) -> None:
    with pytest.raises(SetupError, match="robot_joint_names"):
        joint_naming(OURS, given)

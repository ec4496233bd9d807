# SPDX-License-Identifier: Apache-2.0
"""Whether commands of a test stay inside every limit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mild_core.retargeting.limit_check import ROUNDING_RAD, exceeded_limits
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.signals import JointCommand

__all__ = ["ROUNDING_RAD", "check_limits"]


def check_limits(robot: RobotModel, commands: Sequence[JointCommand]) -> None:
    """Assert that one unbroken run of commands keeps the position, velocity, acceleration and jerk limits."""
    stamps_ns = np.array([command.stamp_ns for command in commands])
    positions = np.array([command.positions_rad for command in commands])
    velocities = np.array([command.velocities_rad_s for command in commands])
    assert exceeded_limits(robot, stamps_ns, positions, velocities) == ()

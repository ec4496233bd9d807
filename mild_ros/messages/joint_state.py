# SPDX-License-Identifier: Apache-2.0
"""`JointCommand` and `JointMeasurement` as `sensor_msgs/JointState`: names with every message, radians."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from mild_core.errors import DataError
from mild_core.shapes import FloatArray
from mild_core.signals import JointCommand, JointMeasurement
from mild_ros.messages.stamps import ns_from_msg, time_to_msg


def joint_command_to_msg(command: JointCommand) -> JointState:
    """Positions [rad] and velocities [rad/s]; effort stays empty, as controllers without it reject it."""
    message = JointState(header=Header(stamp=time_to_msg(command.stamp_ns)), name=list(command.joint_names))
    message.position = array.array("d", command.positions_rad.tobytes())
    message.velocity = array.array("d", command.velocities_rad_s.tobytes())
    return message


def joint_command_from_msg(message: Any) -> JointCommand:
    """The command in a message; one without velocities means to stand still there.

    Raises:
        DataError: `wrong_layout` when names and values differ in number, `not_finite` when a value is.
    """
    names, positions = _positions(message)
    if not np.isfinite(positions).all():
        raise DataError("not_finite", f"the position of {names[int(np.argmin(np.isfinite(positions)))]}")
    velocities = np.asarray(message.velocity, dtype=np.float64)
    if velocities.size == 0:
        velocities = np.zeros(len(names))
    if velocities.size != len(names) or not np.isfinite(velocities).all():
        raise DataError("wrong_layout", f"{len(names)} joint names with {velocities.size} (finite) velocities")
    return JointCommand(ns_from_msg(message.header.stamp), names, positions, velocities)


def joint_measurement_to_msg(measurement: JointMeasurement) -> JointState:
    """Where the robot is [rad]."""
    message = JointState(header=Header(stamp=time_to_msg(measurement.stamp_ns)), name=list(measurement.joint_names))
    message.position = array.array("d", measurement.positions_rad.tobytes())
    return message


def joint_measurement_from_msg(message: Any) -> JointMeasurement:
    """The measurement in a message; other joints than ours may be among the names, and not finite.

    Raises:
        DataError: `wrong_layout` when names and positions differ in number.
    """
    names, positions = _positions(message)
    return JointMeasurement(ns_from_msg(message.header.stamp), names, positions)


def _positions(message: Any) -> tuple[tuple[str, ...], FloatArray]:
    names = tuple(str(name) for name in message.name)
    positions = np.asarray(message.position, dtype=np.float64)
    if positions.size != len(names) or not names:
        raise DataError("wrong_layout", f"{len(names)} joint names with {positions.size} positions")
    return names, positions

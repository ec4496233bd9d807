# SPDX-License-Identifier: Apache-2.0
"""For Pepper's and NAO's naoqi_driver: angles, and how fast to get there as a share of the greatest speed."""

from __future__ import annotations

from typing import Any

import numpy as np

from mild_ros.controllers.output import ControllerOutput, Outgoing
from mild_ros.messages.stamps import time_to_msg

PERIOD_S = 0.04
"""NAOqi plans its own way to each new target and does not take them faster."""

LEAST_SHARE = 0.05
"""A target that moves slowly is still to be reached."""


def joint_angles(kind: Any, outgoing: Outgoing) -> Any:
    """Angles [rad], and the share of the greatest speed that the joint nearest to its own limit needs.

    That is its speed now, or its mean speed since the message before: a robot that brakes still has that way to go.
    """
    command, limits = outgoing.command, outgoing.robot.velocity_rad_s
    needed = float(np.max(np.abs(command.velocities_rad_s) / limits))
    before = outgoing.previous
    if before is not None and command.stamp_ns > before.stamp_ns:
        elapsed_s = (command.stamp_ns - before.stamp_ns) * 1e-9
        way = np.abs(command.positions_rad - before.positions_rad)
        needed = max(needed, float(np.max(way / limits)) / max(elapsed_s, PERIOD_S))
    message = kind(
        joint_names=list(command.joint_names),
        joint_angles=[float(angle) for angle in command.positions_rad],
        speed=min(max(needed, LEAST_SHARE), 1.0),
        relative=0,
    )
    message.header.stamp = time_to_msg(command.stamp_ns)
    return message


JOINT_ANGLES = ControllerOutput(
    *("joint_angles", "naoqi_bridge_msgs/msg/JointAnglesWithSpeed", "naoqi_driver"),
    *("Pepper's angles [rad]", joint_angles, PERIOD_S),
)

# SPDX-License-Identifier: Apache-2.0
"""For ros2_control's JointTrajectoryController: the next moments, ever anew, each ending in a smooth stop.

If messages cease, the robot comes to rest at the end of the last one, inside every limit and by itself.

Source of the rules: `validate_trajectory_msg` of ros2_controllers (Jazzy): all joints and no others, times that
strictly increase, an end that is not in the past, zero velocity at the end, no effort.
"""

from __future__ import annotations

import array
from typing import Any

from trajectory_msgs.msg import JointTrajectoryPoint

from mild_ros.controllers.output import ControllerOutput, Outgoing
from mild_ros.messages.stamps import duration_to_msg, time_to_msg

PERIOD_S = 0.05
"""Twenty a second: each covers many times that, and JointTrajectoryController takes a new one at any time."""


def joint_trajectory(kind: Any, outgoing: Outgoing) -> Any:
    """Positions [rad] and velocities [rad/s] from the moment after `outgoing.command` to rest."""
    command = outgoing.command
    message = kind(joint_names=list(command.joint_names))
    message.header.stamp = time_to_msg(command.stamp_ns)
    ahead = outgoing.foreseen() or (command,)
    for following in ahead:
        at_end = following is ahead[-1]
        message.points.append(
            JointTrajectoryPoint(
                positions=array.array("d", following.positions_rad.tobytes()),
                velocities=[0.0] * len(command.joint_names) if at_end else following.velocities_rad_s.tolist(),
                time_from_start=duration_to_msg(following.stamp_ns - command.stamp_ns),
            )
        )
    return message


JOINT_TRAJECTORY = ControllerOutput(
    "joint_trajectory", "trajectory_msgs/msg/JointTrajectory", joint_trajectory, PERIOD_S
)

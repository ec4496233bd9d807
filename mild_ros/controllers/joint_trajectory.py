# SPDX-License-Identifier: Apache-2.0
"""For ros2_control's JointTrajectoryController: a sliding window of promised points, then a smooth stop.

`mild_core.retargeting.trajectory_stream` makes the window. If messages cease, the robot comes to rest at the end of the
last one, inside every limit and by itself.

Source of the rules: `validate_trajectory_msg` of ros2_controllers (Jazzy): all joints and no others, times that
strictly increase, an end that is not in the past, zero velocity at the end, no effort.
"""

from __future__ import annotations

import array
from typing import Any

from mild_ros.controllers.output import ControllerOutput, Outgoing
from mild_ros.messages.stamps import NANOSECONDS_PER_SECOND, time_to_msg
from mild_ros.messages.standard import JointTrajectoryPoint


def joint_trajectory(kind: Any, outgoing: Outgoing) -> Any:
    """Positions [rad] and velocities [rad/s] from a moment before now, the stamp, to rest."""
    trajectory = outgoing.trajectory
    if trajectory is None:
        raise ValueError("no trajectory is due")
    message = kind(joint_names=list(outgoing.command.joint_names))
    message.header.stamp = time_to_msg(trajectory.stamp_ns)
    for offset_ns, positions, velocities in zip(
        trajectory.offsets_ns, trajectory.positions_rad, trajectory.velocities_rad_s, strict=True
    ):
        point = JointTrajectoryPoint(
            positions=array.array("d", positions.tobytes()), velocities=array.array("d", velocities.tobytes())
        )
        # Filled, not replaced: a hundred messages a second have some 25 points each.
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(offset_ns, NANOSECONDS_PER_SECOND)
        message.points.append(point)
    return message


JOINT_TRAJECTORY = ControllerOutput(
    "joint_trajectory",
    "trajectory_msgs/msg/JointTrajectory",
    "JointTrajectoryController",
    "promised points and then a smooth stop",
    joint_trajectory,
    plays_trajectories=True,
)

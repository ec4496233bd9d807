# SPDX-License-Identifier: Apache-2.0
"""What robots' controllers take beside `joint_command`: one file per kind, all of them off by default."""

from __future__ import annotations

from mild_ros.controllers.joint_angles import JOINT_ANGLES
from mild_ros.controllers.joint_trajectory import JOINT_TRAJECTORY
from mild_ros.controllers.output import ControllerOutput
from mild_ros.controllers.position_command import POSITION_COMMAND

OUTPUTS: dict[str, ControllerOutput] = {
    output.topic: output for output in (JOINT_TRAJECTORY, POSITION_COMMAND, JOINT_ANGLES)
}
"""By topic."""

# SPDX-License-Identifier: Apache-2.0
"""For ros2_control's forward_command_controller: bare positions in the order in which it was configured."""

from __future__ import annotations

from typing import Any

from mild_ros.controllers.output import ControllerOutput, Outgoing


def position_command(kind: Any, outgoing: Outgoing) -> Any:
    """Positions [rad] in the stated order."""
    by_name = dict(zip(outgoing.command.joint_names, outgoing.command.positions_rad.tolist(), strict=True))
    return kind(data=[by_name[name] for name in outgoing.position_order])


POSITION_COMMAND = ControllerOutput(
    *("position_command", "std_msgs/msg/Float64MultiArray", "forward_command_controller"),
    *("positions [rad] in `position_order`", position_command),
)

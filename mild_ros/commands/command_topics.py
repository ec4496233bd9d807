# SPDX-License-Identifier: Apache-2.0
"""Which topics command a robot: `joint_command` and every controller output, under whatever name a bag has them.

All that must know derives it from here, and this from the table `OUTPUTS`.
"""

from __future__ import annotations

from mild_ros.controllers import OUTPUTS

JOINT_COMMAND = "joint_command"
JOINT_COMMAND_TYPE = "sensor_msgs/msg/JointState"

GENERAL_PACKAGES = ("sensor_msgs", "std_msgs")
"""Their types carry measurements too, so that only a topic's name shows whether it commands a robot."""

FOREIGN_NAMES = ("cmd_vel", "command", "commands")
"""Last parts of names of other software's command topics; source: the controllers of ros2_controllers, REP-119."""

FOREIGN_TYPES = (
    "ackermann_msgs/msg/AckermannDriveStamped",
    "control_msgs/msg/JointJog",
    "trajectory_msgs/msg/MultiDOFJointTrajectory",
)
"""Types of other software that only commands have."""

MEASURED_NAMES = ("joint_states", "belief")
"""Last parts of names of topics that have the type of a command, and are none."""


def command_types() -> dict[str, str]:
    """Every topic on which our nodes may command a robot, and the type of its messages."""
    return {JOINT_COMMAND: JOINT_COMMAND_TYPE} | {topic: output.type_name for topic, output in OUTPUTS.items()}


def commands_a_robot(topic: str, type_name: str) -> bool:
    """Whether a topic of a bag commands a robot: by the last part of its name, in any namespace, or by its type."""
    types = command_types()
    if topic.rstrip("/").split("/")[-1] in (*types, *FOREIGN_NAMES):
        return True
    own = {name for name in types.values() if name.split("/")[0] not in GENERAL_PACKAGES}
    return type_name in own or type_name in FOREIGN_TYPES


def may_command_a_robot(topic: str, type_name: str) -> bool:
    """Whether a topic of a bag commands a robot, or may: it has the type of a command, and its name says nothing.

    Commands may be remapped to any name, and a recorder writes down that name.
    """
    if commands_a_robot(topic, type_name):
        return True
    return type_name in command_types().values() and topic.rstrip("/").split("/")[-1] not in MEASURED_NAMES

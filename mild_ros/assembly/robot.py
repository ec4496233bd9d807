# SPDX-License-Identifier: Apache-2.0
"""The robot that parameters name, with its own description or the vendor's, by path or by topic."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

from mild_core.errors import SetupError
from mild_core.inference.manifest import ControlledAgent
from mild_core.printable import printable_lines
from mild_core.retargeting.kinematics import read_tree
from mild_core.retargeting.robot import RobotModel
from mild_core.retargeting.robot_file import find_robot
from mild_core.signals import ARM_JOINTS
from mild_ros.assembly.description import prepared, temporary
from mild_ros.assembly.trial_load import try_load

TOPIC = "topic:"
"""Before the name of a topic in place of a path."""

PATIENCE_S = 10.0
"""How long to wait for a description: its publisher keeps it for late comers."""


def make_robot(given: str, description: str = "") -> RobotModel:
    """The robot of a name or a robot file, drawn as `description` says: a path, `topic:<name>`, or "" for its own.

    Raises:
        SetupError: There is no such robot, no such description, or the two do not belong together.
    """
    robot = find_robot(given)
    path = robot.urdf_path
    if description.startswith(TOPIC):
        path = temporary(_from_topic(description.removeprefix(TOPIC)))
    elif description:
        path = Path(description).expanduser()
        if not path.is_file():
            remedy = f"give the path of a URDF or {TOPIC}<name>"
            raise SetupError("parameter robot_description", f"no file {path}", remedy)
    missing = sorted(set(robot.joint_names) - {joint.name for joint in read_tree(path).by_child.values()})
    if missing:
        raise SetupError(str(path), f"it has no joint {', '.join(missing)}", f"give a description of {robot.name}")
    found = prepared(path, robot)
    read_tree(found.path).chain(robot.tool_link, robot.base_link)
    try_load(found.path, "pinocchio")
    if found.note:
        logging.getLogger(__name__).warning("%s", printable_lines(found.note))
    return robot if found.path == robot.urdf_path else replace(robot, urdf_path=found.path)


def check_fit(model: str, controlled: ControlledAgent, robot: RobotModel) -> None:
    """Make sure that what a model moves can be done by a robot.

    Raises:
        SetupError: It moves other joints than the robot has, or an arm and the robot has nothing that does as one.
    """
    if controlled.kind == "human_arm":
        if controlled.joint_names != ARM_JOINTS:
            problem = f"it moves {', '.join(controlled.joint_names)} of a partner, not {', '.join(ARM_JOINTS)}"
            raise SetupError(f"model {model}", problem, "choose another model")
        if not robot.follows_arms:
            problem = f"it moves a partner's arm, and {robot.name} does not say where its shoulder and elbow are"
            raise SetupError(f"model {model}", problem, "name shoulder_link and elbow_link in the robot file")
    elif sorted(controlled.joint_names) != sorted(robot.joint_names):
        problem = f"it moves {', '.join(controlled.joint_names)}, but {robot.name} has {', '.join(robot.joint_names)}"
        raise SetupError(f"model {model}", problem, "choose a model of this robot")


def _from_topic(topic: str) -> str:
    """The description that is published on `topic`, as robot_state_publisher does."""
    import rclpy
    from rclpy.wait_for_message import wait_for_message
    from std_msgs.msg import String

    from mild_ros.quality_of_service import LATCHED

    context = rclpy.Context()  # of its own: replay in process has none
    context.init()
    node = rclpy.create_node("robot_description_reader", context=context)
    try:
        came, message = wait_for_message(String, node, topic, qos_profile=LATCHED, time_to_wait=PATIENCE_S)
    finally:
        node.destroy_node()
        context.try_shutdown()
    if not came:
        problem = f"nothing came on topic '{topic}' within {PATIENCE_S:g} s"
        raise SetupError("parameter robot_description", problem, "start robot_state_publisher, or give a path")
    return str(message.data)

# SPDX-License-Identifier: Apache-2.0
"""The robot that parameters name, with its own description or the vendor's, by path or by topic."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from mild_core.errors import SetupError, near
from mild_core.inference.manifest import ControlledAgent
from mild_core.printable import printable_lines
from mild_core.retargeting.robot_file import find_robot
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.kinematics import KinematicTree, read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robots import ROBOTS
from mild_core.signals import ARM_JOINTS
from mild_ros.assembly.description import prepared, temporary
from mild_ros.node_kit.dds_variables import heard_remedy

TOPIC = "topic:"
"""Before the name of a topic in place of a path."""

ROUNDED_RAD = 0.01
"""Home may lie this far outside of limits that a description has rounded."""

PATIENCE_S = 10.0
"""How long to wait for a description, whose topic is latched [s]."""


def make_robot(given: str, description: str = "") -> RobotModel:
    """The robot of a name or a robot file, drawn as `description` says: a path, `topic:<name>`, or "" for its own.

    Raises:
        SetupError: There is no such robot, no such description, or the two do not belong together.
    """
    robot, notes = _made(given, description)
    for note in notes:
        logging.getLogger(__name__).warning("%s", printable_lines(note))
    return robot


def make_robot_to_draw(given: str, description: str = "") -> RobotModel:
    """The same robot for pictures of what it did: with its meshes found, without a word of what was said before.

    A description that came by topic is gone by then; the robot's own takes its place.

    Raises:
        SetupError: As `make_robot`.
    """
    return _made(given, "" if description.startswith(TOPIC) else description)[0]


def _made(given: str, description: str) -> tuple[RobotModel, tuple[str, ...]]:
    """The robot, and what is odd about its description, for people."""
    robot = find_robot(given)
    path, source = robot.urdf_path, robot.source
    if description.startswith(TOPIC):
        path = temporary(_from_topic(description.removeprefix(TOPIC)))
        source = description
    elif description:
        path = Path(description).expanduser()
        source = str(path)
        if not path.is_file():
            remedy = f"give the path of a URDF or {TOPIC}<name>"
            raise SetupError("parameter robot_description", f"no file {path}", remedy)
    try:
        tree = read_tree(path)
    except SetupError as error:  # a copy of what came by topic is not what the user knows
        raise SetupError(source, error.problem, error.remedy) from None
    missing = sorted(set(robot.joint_names) - {joint.name for joint in tree.by_child.values()})
    if missing:
        raise SetupError(source, f"it has no joint {', '.join(missing)}", f"give a description of {robot.name}")
    found = prepared(path, robot, source)
    whole = read_tree(found.path)
    for link, role in ((robot.base_link, "the base"), (robot.tool_link, "the hand")):
        if link not in whole.links:
            problem = f"it has no link '{link}', which is {role} of {robot.name}"
            known = f"its first link is '{whole.root}'" if link == robot.base_link else near(link, whole.links)
            remedy = f"{known}: name it so there, or write a robot file that names what is there"
            raise SetupError(source, problem, remedy)
    notes = robot.notes
    if path != robot.urdf_path:
        robot, notes = (
            _narrowed(replace(robot, described_by=source), tree),
            replace(tree, source=source).notes(robot.joint_names),
        )
    robot = robot if found.path == robot.urdf_path else replace(robot, urdf_path=found.path, described_by=source)
    chain_of(robot)  # says in one line what does not fit
    return robot, tuple(note for note in (*notes, found.note) if note)


def _narrowed(robot: RobotModel, tree: KinematicTree) -> RobotModel:
    """The robot with the limits of a description that was put in the place of its own, where they are narrower."""
    joints = {joint.name: joint for joint in tree.by_child.values()}
    theirs = np.array([joints[name].limits for name in robot.joint_names])
    lower, upper = np.fmax(robot.lower_rad, theirs[:, 0]), np.fmin(robot.upper_rad, theirs[:, 1])
    home = np.clip(robot.home_rad, lower, upper)
    home = np.where(np.abs(home - robot.home_rad) < ROUNDED_RAD, home, robot.home_rad)
    try:
        return replace(
            robot,
            lower_rad=lower,
            upper_rad=upper,
            velocity_rad_s=np.fmin(robot.velocity_rad_s, theirs[:, 2]),
            home_rad=home,
        )
    except ValueError as error:
        raise SetupError(robot.source, str(error), f"give a description of {robot.name}") from None


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
        remedy = f"choose a model of {robot.name}"
        if controlled.robot in ROBOTS:
            remedy = f"set robot to {controlled.robot}, or {remedy}"
        raise SetupError(f"model {model}", problem, remedy)


def _from_topic(topic: str) -> str:
    """The description that is published on `topic`, as robot_state_publisher does."""
    import rclpy
    from rclpy.wait_for_message import wait_for_message
    from std_msgs.msg import String

    from mild_ros.node_kit.quality_of_service import LATCHED

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
        remedy = heard_remedy("start robot_state_publisher, or give a path")
        raise SetupError("parameter robot_description", problem, remedy)
    return str(message.data)

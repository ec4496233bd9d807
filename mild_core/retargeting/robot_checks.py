# SPDX-License-Identifier: Apache-2.0
"""What speaks against an arm that is to meet people's hands: a line for each, or a refusal where it never can."""

from __future__ import annotations

import math
import re

import numpy as np

from mild_core.errors import SetupError
from mild_core.retargeting.contact import shoulder_and_reach_m
from mild_core.retargeting.robot_model.chain import arm_side, chain_of, from_base
from mild_core.retargeting.robot_model.kinematics import KinematicTree, read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import FIXED, LOOSE

LEAST_REACH_M = 0.15
"""An arm that comes no further from its first joint does not come out of the robot: a hand is kept 5 cm from."""

HANDS_M = (0.4, 2.0)
"""Heights above the floor at which people, children among them, hold a hand out."""

FREE_JOINTS = 4
"""An arm of fewer has no choice how to hold the elbow, when its hand is in place."""

BEYOND_M = 0.08
"""What moves and ends so far beyond the tool link pokes the hand that is met."""

CARRIED_M = 0.01
"""A tool link that a joint of a gripper moves by more than this is a finger."""

TRIED_POSES, SEED = 500, 7
DRIVES = re.compile(r"wheel|caster|track_joint|mecanum", re.IGNORECASE)


def check_reach(robot: RobotModel) -> None:
    """Make sure that the arm can come to the hand of some person.

    Raises:
        SetupError: It cannot: it is too short, or its hand is never ahead of the robot, or not as high as hands are.
    """
    thing, remedy = f"robot {robot.name}", f"check joint_names, tool_link '{robot.tool_link}' and base_link"
    _, reach_m = shoulder_and_reach_m(robot)
    if reach_m < LEAST_REACH_M:
        problem = f"its arm cannot reach any person: its hand comes no further than {reach_m:.2f} m from its shoulder"
        raise SetupError(thing, problem, remedy)
    chain, shape = chain_of(robot), (TRIED_POSES, len(robot.joint_names))
    tried = np.random.default_rng(SEED).uniform(robot.lower_rad, robot.upper_rad, shape)
    hands_m = np.array([chain.tool(pose) for pose in tried])
    if hands_m[:, 0].max() < LEAST_REACH_M:
        problem = "its arm cannot reach any person ahead: its hand is never ahead along base_link's x axis"
        raise SetupError(thing, problem, f"turn base_link '{robot.base_link}', or check joint_names")
    if robot.floor_m is not None:
        low, high = (float(edge) - robot.floor_m for edge in (hands_m[:, 2].min(), hands_m[:, 2].max()))
        if high < HANDS_M[0] or low > HANDS_M[1]:
            problem = f"its arm cannot reach any person: its hand comes {low:.2f} to {high:.2f} m above the floor"
            raise SetupError(thing, problem, f"people hold theirs at {HANDS_M[0]:g} to {HANDS_M[1]:g} m: check floor_m")


def arm_notes(robot: RobotModel, side: str) -> tuple[str, ...]:
    """What people should know of an arm before it meets them.

    Args:
        robot: With its description.
        side: "right" or "left", of the partner's arm that a model moves; "" for a model of the robot's own joints.
    """
    tree = read_tree(robot.urdf_path)
    found = [_few_joints(robot), _drives(robot, tree), _tool(robot, tree), _other_side(robot, side) if side else ""]
    return tuple(f"robot {robot.name}: {note}" for note in found if note)


def _few_joints(robot: RobotModel) -> str:
    count = len(robot.joint_names)
    if count >= FREE_JOINTS:
        return ""
    what = "hands meet in few places" if count < 3 else "hands meet, but nothing is left for the elbow"
    return f"its arm has {count} joints: {what}; name all joints from base to tool, if there are more"


def _drives(robot: RobotModel, tree: KinematicTree) -> str:
    carried = {joint.name for joint in from_base(robot, tree)[0]}
    wheels = [
        joint.name
        for joint in tree.by_child.values()
        if joint.name not in carried
        and joint.name not in robot.joint_names
        and joint.kind not in FIXED
        and (DRIVES.search(joint.name) or DRIVES.search(joint.child))
    ]
    loose = [joint.name for joint in tree.by_child.values() if joint.kind in LOOSE and joint.parent == tree.root]
    if not wheels and not loose:
        return ""
    what = f"it drives ('{(wheels or loose)[0]}'): robot_from_camera holds while base_link '{robot.base_link}' stands"
    return f"{what} still; measure it again when it has moved"


def _tool(robot: RobotModel, tree: KinematicTree) -> str:
    """A hand that is a finger, or behind a gripper."""
    chain = from_base(robot, tree)[0]
    places = [place for place, joint in enumerate(chain) if tree.followed(joint)[0] in robot.joint_names]
    beyond = chain[places[-1] + 1 :] if places else ()
    at_home = robot.at_home
    tool = tree.pose(robot.tool_link, at_home, robot.base_link)[:3, 3]
    for joint in beyond:
        if joint.kind in FIXED or joint.kind in LOOSE or math.isnan(joint.limits[0]):
            continue
        ends = [tree.pose(robot.tool_link, {**at_home, joint.name: end}, robot.base_link) for end in joint.limits[:2]]
        if max(math.dist(end[:3, 3], tool) for end in ends) > CARRIED_M:
            what = f"its tool_link '{robot.tool_link}' moves with '{joint.name}', which nothing commands"
            return f"{what}: name '{joint.parent}'"
    farthest, gripper = 0.0, ""
    for child, joint in tree.by_child.items():
        if joint.kind in FIXED or joint.kind in LOOSE or not _hangs_on(tree, child, robot.tool_link):
            continue
        away = math.dist(tree.pose(child, at_home, robot.base_link)[:3, 3], tool)
        if away > farthest:
            farthest, gripper = away, child
    if farthest < BEYOND_M:
        return ""
    what = f"its tool_link '{robot.tool_link}' lies behind a gripper, whose '{gripper}' is {farthest:.2f} m further out"
    return f"{what} and comes into the hand first: name a link there"


def _hangs_on(tree: KinematicTree, link: str, other: str) -> bool:
    while link in tree.by_child:
        link = tree.by_child[link].parent
        if link == other:
            return True
    return False


def _other_side(robot: RobotModel, side: str) -> str:
    other = "left" if side == "right" else "right"
    if arm_side(robot) != other:
        return ""
    if robot.arm is None and other == "left":
        return "its arm is a left one, and the model moves a right arm: it does as that does, mirrored"
    what = f"its arm is a {other} one, and the model moves a {side} arm"
    return f"{what}: hands meet, but the elbow goes to the wrong side; name the {side} arm's joints"

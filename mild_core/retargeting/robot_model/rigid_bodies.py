# SPDX-License-Identifier: Apache-2.0
"""A robot as other programs get it: one rigid body between every two joints that move, all that they cannot do without.

Descriptions hold what physics and solvers stumble over: frames without mass, inertias that no body has, hundreds of
links, joints without limits, joints that copy others. What we simulate, solve and draw is the commanded arm, so this is
made from the same tree that our kinematics uses: every other joint stands at rest in it.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Collection
from xml.etree import ElementTree

import numpy as np

from mild_core.retargeting.robot_model.chain import moves
from mild_core.retargeting.robot_model.kinematics import KinematicTree, read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import FIXED, SLIDING, Joint, pose_of, read_description
from mild_core.shapes import FloatArray

LEAST_KG, LEAST_KG_M2 = 1e-2, 1e-5
"""Of a body: a ball of 5 cm that weighs next to nothing. Less makes physics with motors unsteady."""

WITHOUT_LIMIT = 1e3
"""Radians or metres; for joints with unknown limits."""


class _Body:
    """What hangs together: elements to draw and to collide with, and its mass."""

    def __init__(self, link: str) -> None:
        self.element = ElementTree.Element("link", name=link)
        self._mass, self._moment, self._tensor = 0.0, np.zeros(3), np.zeros((3, 3))

    def add_mass(self, inertial: ElementTree.Element, pose: FloatArray) -> None:
        """Add what a link weighs, with its place in the body."""
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        kilograms = 0.0 if mass is None else float(mass.get("value", 0.0))
        placed = pose @ pose_of(inertial.find("origin"))
        ixx, ixy, ixz, iyy, iyz, izz = (
            0.0 if inertia is None else float(inertia.get(name, 0.0))
            for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        own = placed[:3, :3] @ np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]) @ placed[:3, :3].T
        self._mass += kilograms
        self._moment += kilograms * placed[:3, 3]
        self._tensor += own + kilograms * _about(placed[:3, 3])

    def finished(self) -> ElementTree.Element:
        """The link, with an inertia that a body can have: principal moments no larger than the other two together."""
        mass = max(self._mass, LEAST_KG)
        centre = self._moment / mass
        principal, axes = np.linalg.eigh(self._tensor - self._mass * _about(centre))
        principal = np.maximum(principal, LEAST_KG_M2)
        principal[:2] += max(0.0, principal[2] - principal[0] - principal[1]) / 2.0
        tensor = axes @ np.diag(principal) @ axes.T
        inertial = ElementTree.SubElement(self.element, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=_words(centre), rpy="0 0 0")
        ElementTree.SubElement(inertial, "mass", value=repr(mass))
        pairs = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))
        ElementTree.SubElement(inertial, "inertia", {name: repr(float(tensor[i, j])) for name, i, j in pairs})
        return self.element


def rigid_bodies(robot: RobotModel, others: Collection[str] = (), *, shapes: bool = True) -> str:
    """A description (URDF) of the robot in which only what is commanded moves; its root is the robot's base frame.

    The root has the name of the description's own; every other link is one that a moving joint carries. Joints that
    copy commanded ones move too, but do not say that they copy.

    Args:
        robot: Which; meshes have to be found already, others are left out.
        others: Names of joints that shall move too.
        shapes: Whether there is something to look at and to collide with.

    Raises:
        SetupError: The description is broken.
    """
    tree, read = read_tree(robot.urdf_path), read_description(robot.urdf_path)
    moving = [j for j in tree.by_child.values() if moves(robot, tree, j) or (j.name in others and j.kind not in FIXED)]
    carried = {joint.child for joint in moving}
    bodies = {link: _Body(link) for link in (tree.root, *(joint.child for joint in moving))}
    from_base = np.asarray(np.linalg.inv(tree.pose(robot.base_link, robot.at_home)), dtype=np.float64)
    places = {tree.root: (tree.root, from_base)}
    for link in read.findall("link"):
        name = link.get("name", "")
        body, pose = _place(tree, robot, carried, places, name)
        for inertial in link.findall("inertial")[:1]:
            bodies[body].add_mass(inertial, pose)
        for part in (part for tag in ("visual", "collision") for part in link.findall(tag)) if shapes else ():
            if _can_be_loaded(part, robot):
                moved_part = copy.deepcopy(part)
                _put(moved_part, pose @ pose_of(part.find("origin")))
                bodies[body].element.append(moved_part)
    made = ElementTree.Element("robot", name=read.get("name", "robot"))
    made.extend(copy.deepcopy(one) for one in read.findall("material") if shapes)
    made.extend(body.finished() for body in bodies.values())
    written = {joint.get("name", ""): joint for joint in read.findall("joint")}
    for joint in moving:
        body, pose = _place(tree, robot, carried, places, joint.parent)
        made.append(_joint(joint, body, pose @ joint.origin, written[joint.name].find("dynamics")))
    ElementTree.indent(made)  # PyBullet reads no line of more than 8192 characters
    return ElementTree.tostring(made, encoding="unicode")


def _place(
    tree: KinematicTree,
    robot: RobotModel,
    carried: Collection[str],
    places: dict[str, tuple[str, FloatArray]],
    link: str,
) -> tuple[str, FloatArray]:
    """Of which body a link is a part, and its pose (4, 4) in it; `places` holds those that are known."""
    if link not in places:
        if link in carried:
            places[link] = link, np.eye(4)
        else:
            joint = tree.by_child[link]
            body, pose = _place(tree, robot, carried, places, joint.parent)
            places[link] = body, pose @ tree.pose(link, robot.at_home, joint.parent)
    return places[link]


def _joint(joint: Joint, body: str, origin: FloatArray, dynamics: ElementTree.Element | None) -> ElementTree.Element:
    made = ElementTree.Element("joint", name=joint.name, type="prismatic" if joint.kind in SLIDING else "revolute")
    ElementTree.SubElement(made, "parent", link=body)
    ElementTree.SubElement(made, "child", link=joint.child)
    _put(made, origin)
    ElementTree.SubElement(made, "axis", xyz=_words(joint.axis))
    lower, upper, velocity = joint.limits
    if not lower < upper:
        lower, upper = -WITHOUT_LIMIT, WITHOUT_LIMIT
    velocity = WITHOUT_LIMIT if math.isnan(velocity) else velocity
    limit = {"lower": lower, "upper": upper, "velocity": velocity, "effort": joint.effort}
    ElementTree.SubElement(made, "limit", {name: repr(float(value)) for name, value in limit.items()})
    if dynamics is not None:
        made.append(copy.deepcopy(dynamics))
    return made


def _can_be_loaded(part: ElementTree.Element, robot: RobotModel) -> bool:
    """Whether a shape is primitive, or a mesh that is there, whose name is made whole."""
    mesh = part.find("geometry/mesh")
    if mesh is None:
        return part.find("geometry/*") is not None
    file = robot.urdf_path.parent.absolute() / mesh.get("filename", "").removeprefix("file://")
    mesh.set("filename", str(file))
    return file.is_file()


def _put(element: ElementTree.Element, pose: FloatArray) -> None:
    """Give an element a pose in place of the one that it has."""
    for origin in element.findall("origin"):
        element.remove(origin)
    r = pose[:3, :3]
    level = math.hypot(r[0, 0], r[1, 0])
    if level > 1e-9:
        rpy = math.atan2(r[2, 1], r[2, 2]), math.atan2(-r[2, 0], level), math.atan2(r[1, 0], r[0, 0])
    else:  # straight up or down: roll and yaw turn about the same axis
        rpy = math.atan2(-r[1, 2], r[1, 1]), math.atan2(-r[2, 0], level), 0.0
    ElementTree.SubElement(element, "origin", xyz=_words(pose[:3, 3]), rpy=_words(np.array(rpy)))


def _about(point_m: FloatArray) -> FloatArray:
    """(3, 3) inertia about the origin of a kilogram in a point. Source: parallel axis theorem."""
    tensor: FloatArray = point_m @ point_m * np.eye(3) - np.outer(point_m, point_m)
    return tensor


def _words(numbers: FloatArray) -> str:
    return " ".join(repr(float(number)) for number in numbers)

# SPDX-License-Identifier: Apache-2.0
"""Where the links of a robot are when its joints are somewhere: forward kinematics in plain numpy."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from mild_core.errors import SetupError, unknown_name
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import FIXED, LOOSE, SLIDING, Joint, read_joints
from mild_core.shapes import FloatArray

SOFT = {
    "kept": "the soft limits of its safety controller hold for",
    "no room": "the soft limits of its safety controller leave no room, and do not count, for",
}
"""By `Joint.soft` what people should know."""


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """The links of a robot, each hanging on one joint of another.

    Attributes:
        source: Where it was read, for messages.
        root: The link that hangs on nothing.
        by_child: The joint that carries each other link.
    """

    source: str
    root: str
    by_child: Mapping[str, Joint]

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links."""
        return (self.root, *self.by_child)

    def notes(self, limited: Collection[str] = ()) -> tuple[str, ...]:
        """What is not as the description says, or not as one may think, a line for each.

        Args:
            limited: Joints whose limits are taken from here.
        """
        joints = {joint.name: joint for joint in self.by_child.values()}
        soft = {what: [name for name in limited if name in joints and joints[name].soft == what] for what in SOFT}
        loose = [f"'{name}' ({joint.kind})" for name, joint in joints.items() if joint.kind in LOOSE]
        lost = [f"'{name}'" for name, joint in joints.items() if joint.mimics and self.followed(joint)[0] == name]
        return tuple(
            f"{self.source}: {what} {', '.join(names[:10])}{' ...' * (len(names) > 10)}"
            for what, names in (
                ("what hangs on joints without a single position stays where they are at zero:", loose),
                ("joints that copy one that is not there, or each other, stand at rest:", lost),
                *((text, soft[what]) for what, text in SOFT.items()),
            )
            if names
        )

    def chain(self, link: str, base: str = "") -> tuple[Joint, ...]:
        """The joints from `base` (the root if "") to `link`, in that order.

        Raises:
            SetupError: There is no such link, or `base` does not carry it.
        """
        if link not in self.links:
            raise unknown_name(f"link of {self.source}", link, self.links)
        joints: list[Joint] = []
        at, base = link, base or self.root
        while at != base:
            if at == self.root:
                raise SetupError(self.source, f"link '{base}' does not carry '{link}'", f"use '{self.root}' as base")
            joints.append(self.by_child[at])
            at = joints[-1].parent
        return tuple(reversed(joints))

    def followed(self, joint: Joint) -> tuple[str, float, float]:
        """Whose position a joint has, how often, and how much more: those of a joint that copies none are its own.

        A joint that copies one that is not there, or itself in a circle, is taken to stand alone.
        """
        named = {each.name: each for each in self.by_child.values()} if joint.mimics else {}
        at, multiplier, offset, passed = joint, 1.0, 0.0, {joint.name}
        while at.mimics:
            multiplier, offset = multiplier * at.multiplier, multiplier * at.offset + offset
            if at.mimics not in named or at.mimics in passed:
                return joint.name, 1.0, 0.0
            at = named[at.mimics]
            passed.add(at.name)
        return at.name, multiplier, offset

    def pose(self, link: str, positions: Mapping[str, ArrayLike], base: str = "") -> FloatArray:
        """(..., 4, 4) pose of `link` in the frame of `base` (the root if "") [m].

        Args:
            link: Name of a link.
            positions: (...) position of each joint by name [rad, or m of a sliding joint]; a missing one is 0.
            base: Name of the link whose frame is used, whether or not it carries `link`.

        Raises:
            SetupError: There is no such link.
        """
        above = {link, *(joint.parent for joint in self.chain(link))}
        if base and base not in above:  # the other arm, or what the arm is mounted on
            from_base = np.asarray(np.linalg.inv(self.pose(base, positions)), dtype=np.float64)
            return from_base @ self.pose(link, positions)
        pose: FloatArray = np.eye(4)
        for joint in self.chain(link, base):
            pose = pose @ joint.origin
            if joint.kind not in FIXED:
                name, multiplier, offset = self.followed(joint)
                copied = positions.get(name, 0.0)
                position = np.asarray(copied, dtype=np.float64) * multiplier + offset
                pose = pose @ moved(joint, position)
        return pose


def moved(joint: Joint, position: FloatArray) -> FloatArray:
    """(..., 4, 4) motion of a joint at (...) positions. Source: Rodrigues' rotation formula."""
    motion = np.zeros((*position.shape, 4, 4))
    motion[..., range(4), range(4)] = 1.0
    if joint.kind in SLIDING:
        motion[..., :3, 3] = position[..., None] * joint.axis
        return motion
    x, y, z = joint.axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = np.sin(position)[..., None, None] * cross + (1.0 - np.cos(position))[..., None, None] * (cross @ cross)
    motion[..., :3, :3] += turned
    return motion


@lru_cache(maxsize=16)
def read_tree(path: Path) -> KinematicTree:
    """The kinematic tree of the robot description at `path`.

    Raises:
        SetupError: The file cannot be read as a URDF, or its joints do not form one tree.
    """
    joints = read_joints(path)
    if not joints:
        raise SetupError(str(path), "it has no joint", "give the description of a robot")
    by_child = {joint.child: joint for joint in joints}
    roots = {joint.parent for joint in joints} - set(by_child)
    return KinematicTree(str(path), min(roots), by_child)


def forward_kinematics(robot: RobotModel, positions_rad: ArrayLike, link: str) -> FloatArray:
    """(..., 4, 4) pose of `link` in the robot's base frame [m].

    Args:
        robot: The robot; its other joints are at rest.
        positions_rad: (..., J) positions of the controlled joints.
        link: Name of a link of the description.

    Raises:
        SetupError: There is no such link, or the description is broken.
        ValueError: The last dimension is not J.
    """
    positions = np.asarray(positions_rad, dtype=np.float64)
    if positions.shape[-1:] != (len(robot.joint_names),):
        raise ValueError(f"positions_rad has shape {positions.shape}, expected (..., {len(robot.joint_names)})")
    columns = {name: positions[..., column] for column, name in enumerate(robot.joint_names)}
    return read_tree(robot.urdf_path).pose(link, {**dict(robot.rest), **columns}, robot.base_link)

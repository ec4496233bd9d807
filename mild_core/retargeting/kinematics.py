# SPDX-License-Identifier: Apache-2.0
"""Where the links of a robot are when its joints are somewhere: forward kinematics in plain numpy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from mild_core.errors import SetupError, unknown_name
from mild_core.retargeting.robot import RobotModel
from mild_core.retargeting.urdf import FIXED, SLIDING, Joint, read_joints
from mild_core.shapes import FloatArray


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

    def chain(self, link: str, base: str = "") -> tuple[Joint, ...]:
        """The joints from `base` (the root if "") to `link`, in that order.

        Raises:
            SetupError: There is no such link, or `base` does not carry it.
        """
        if link != self.root and link not in self.by_child:
            raise unknown_name(f"link of {self.source}", link, (self.root, *self.by_child))
        joints: list[Joint] = []
        at, base = link, base or self.root
        while at != base:
            if at == self.root:
                raise SetupError(self.source, f"link '{base}' does not carry '{link}'", f"use '{self.root}' as base")
            joints.append(self.by_child[at])
            at = joints[-1].parent
        return tuple(reversed(joints))

    def pose(self, link: str, positions: Mapping[str, ArrayLike], base: str = "") -> FloatArray:
        """(..., 4, 4) pose of `link` in the frame of `base` (the root if "") [m].

        Args:
            link: Name of a link.
            positions: (...) position of each joint by name [rad, or m of a sliding joint]; a missing one is 0.
            base: Name of the link whose frame is used.

        Raises:
            SetupError: There is no such link, or `base` does not carry it.
        """
        pose: FloatArray = np.eye(4)
        for joint in self.chain(link, base):
            pose = pose @ joint.origin
            if joint.kind not in FIXED:
                copied = positions.get(joint.mimics or joint.name, 0.0)
                position = np.asarray(copied, dtype=np.float64) * joint.multiplier + joint.offset
                pose = pose @ _moved(joint, position)
        return pose


def _moved(joint: Joint, position: FloatArray) -> FloatArray:
    """(..., 4, 4) motion of a joint at (...) positions. Source: Rodrigues' rotation formula."""
    moved = np.zeros((*position.shape, 4, 4))
    moved[..., range(4), range(4)] = 1.0
    if joint.kind in SLIDING:
        moved[..., :3, 3] = position[..., None] * joint.axis
        return moved
    x, y, z = joint.axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = np.sin(position)[..., None, None] * cross + (1.0 - np.cos(position))[..., None, None] * (cross @ cross)
    moved[..., :3, :3] += turned
    return moved


@lru_cache(maxsize=16)
def read_tree(path: Path) -> KinematicTree:
    """The kinematic tree of the robot description at `path`.

    Raises:
        SetupError: The file cannot be read as a URDF, or its joints do not form one tree.
    """
    joints = read_joints(path)
    by_child = {joint.child: joint for joint in joints}
    roots = sorted({joint.parent for joint in joints} - set(by_child))
    if len(by_child) != len(joints) or len({joint.name for joint in joints}) != len(joints) or len(roots) != 1:
        raise SetupError(
            str(path), f"its {len(joints)} joints form no tree (roots: {', '.join(roots)})", "mend the file"
        )
    children: dict[str, list[str]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint.child)
    reached, waiting = 1, [roots[0]]
    while waiting:
        below = children.get(waiting.pop(), [])
        reached += len(below)
        waiting += below
    if reached != len(joints) + 1:
        raise SetupError(str(path), "some of its joints form a loop", "mend the file")
    return KinematicTree(str(path), roots[0], by_child)


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

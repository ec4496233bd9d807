# SPDX-License-Identifier: Apache-2.0
"""The commanded arm as a serial chain, compiled: where it is, how its hand moves, how far its parts are from others."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mild_core.compiled import compiled
from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.kinematics import KinematicTree, moved, read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import FIXED, LOOSE, TURNING, Joint
from mild_core.shapes import FloatArray, read_only

NOTHING_NEAR_M = 0.3
"""Distances beyond this are not computed exactly: they are far."""


@dataclass(frozen=True, eq=False)
class Chain:
    """C joints from the base to the tool, those that nothing commands at rest.

    A joint that copies a commanded one is in the chain too, and moves with it.

    Attributes:
        names: Of the C joints.
        columns: (C,) place of each, or of the one that it copies, in the robot's joint order.
        offsets: (C, 4, 4) pose of each joint in the frame that the joint before moves; the first in the base frame.
        axes: (C, 3) in the joint's own frame, as long as the joint turns [rad] when the commanded one does by 1 rad.
        tool_m: (3,) the tool link's origin in the frame that the last joint moves.
    """

    names: tuple[str, ...]
    columns: FloatArray
    offsets: FloatArray
    axes: FloatArray
    tool_m: FloatArray

    def tool(self, positions_rad: FloatArray) -> FloatArray:
        """(3,) the tool in the base frame [m] with the robot's joints at (J,)."""
        frames = frames_of(positions_rad, self.columns, self.offsets, self.axes)
        place: FloatArray = frames[-1, :3, :3] @ self.tool_m + frames[-1, :3, 3]
        return place

    def jacobian(self, positions_rad: FloatArray) -> FloatArray:
        """(3, J) how the tool moves [m] when the joints do [rad]."""
        frames = frames_of(positions_rad, self.columns, self.offsets, self.axes)
        found = np.zeros((3, len(positions_rad)))
        tool_jacobian(frames, self.columns, self.axes, self.tool_m, found)
        return found


@dataclass(frozen=True, eq=False)
class Mount:
    """What a link hangs on.

    Attributes:
        frame: 0 for the base, k for the k-th joint of the chain.
        pose: (4, 4) the link in that frame.
    """

    frame: int
    pose: FloatArray


@lru_cache(maxsize=8)
def chain_of(robot: RobotModel) -> Chain:
    """The chain that carries the robot's tool.

    Raises:
        SetupError: The description is broken, or a joint in the chain does not turn or has no single position.
    """
    tree = read_tree(robot.urdf_path)
    names, columns, offsets, axes = [], [], [], []
    joints, pose = from_base(robot, tree)
    for joint in joints:
        if joint.kind in LOOSE:
            problem = f"joint '{joint.name}' is {joint.kind} and lies between '{robot.base_link}' and the tool"
            raise SetupError(robot.source, problem, f"take '{joint.child}' as base_link")
        leader, ratio, offset = tree.followed(joint)
        if moves(robot, tree, joint):
            if joint.kind not in TURNING:
                raise SetupError(robot.source, f"'{joint.name}' does not turn", "command turning joints only")
            names.append(joint.name)
            columns.append(robot.joint_names.index(leader))
            offsets.append(pose @ joint.origin @ moved(joint, np.asarray(offset)))
            axes.append(ratio * joint.axis)
            pose = np.eye(4)
        else:
            pose = pose @ tree.pose(joint.child, dict(robot.rest), joint.parent)
    if not columns:
        raise SetupError(robot.source, f"no commanded joint carries '{robot.tool_link}'", "name its joints")
    return Chain(
        tuple(names),
        read_only(np.array(columns, dtype=np.float64)),
        read_only(np.array(offsets)),
        read_only(np.array(axes)),
        read_only(pose[:3, 3]),
    )


ASIDE_M = 0.05
"""A shoulder that is further to one side than this is on it."""

SIDES = {
    "left": re.compile(r"(^|[_/])(left|l)([_/]|$)|^left", re.IGNORECASE),
    "right": re.compile(r"(^|[_/])(right|r)([_/]|$)|^right", re.IGNORECASE),
}
"""In the names of joints."""


def arm_side(robot: RobotModel) -> str:
    """Which arm of a robot it is, "right" or "left", by its shoulder's place or its joints' names; "" in the middle."""
    y = float(chain_of(robot).offsets[0][1, 3])
    if abs(y) > ASIDE_M:
        return "left" if y > 0.0 else "right"
    return named_side(robot.joint_names)


def named_side(names: Sequence[str]) -> str:
    """The side that most of some joints are named by; "" for none."""
    named = {side: sum(bool(pattern.search(name)) for name in names) for side, pattern in SIDES.items()}
    most = max(named, key=lambda side: named[side])
    return most if named[most] * 2 > len(names) else ""


def from_base(robot: RobotModel, tree: KinematicTree) -> tuple[tuple[Joint, ...], FloatArray]:
    """The joints that lead to the tool, and (4, 4) where the first one's parent is in the base frame.

    The base frame may be a link beside the arm, such as a sole or a mark, as long as no commanded joint moves it.

    Raises:
        SetupError: There is no such link, or one does.
    """
    if robot.base_link in {tree.root, *(joint.parent for joint in tree.chain(robot.tool_link))}:
        return tree.chain(robot.tool_link, robot.base_link), np.eye(4)
    above = tree.chain(robot.base_link)
    for joint in above:
        if moves(robot, tree, joint) or joint.kind in LOOSE:
            problem = f"link '{robot.base_link}' does not carry '{robot.tool_link}', and '{joint.name}' moves it"
            raise SetupError(robot.source, problem, f"use '{tree.root}' as base")
    shared = [one for one, other in zip(above, tree.chain(robot.tool_link), strict=False) if one is other]
    start = shared[-1].child if shared else tree.root
    pose = np.asarray(np.linalg.inv(tree.pose(robot.base_link, robot.at_home, start)), dtype=np.float64)
    return tree.chain(robot.tool_link, start), pose


def moves(robot: RobotModel, tree: KinematicTree, joint: Joint) -> bool:
    """Whether a joint moves when the robot is commanded: it is, or it copies one that is."""
    leader, ratio, _ = tree.followed(joint)
    return leader in robot.joint_names and joint.kind not in FIXED and ratio != 0.0


def mount_of(robot: RobotModel, tree: KinematicTree, link: str) -> Mount:
    """What `link` hangs on: the last joint of the chain that carries it, or the base."""
    rest = robot.at_home
    carried = [joint for joint in from_base(robot, tree)[0] if moves(robot, tree, joint)]
    above = {joint.name for joint in tree.chain(link)}
    frames = [number for number, joint in enumerate(carried, start=1) if joint.name in above]
    if frames:
        return Mount(frames[-1], tree.pose(link, rest, carried[frames[-1] - 1].child))
    return Mount(0, np.linalg.inv(tree.pose(robot.base_link, rest)) @ tree.pose(link, rest))


@compiled
def frames_of(positions_rad: FloatArray, columns: FloatArray, offsets: FloatArray, axes: FloatArray) -> FloatArray:
    """(C + 1, 4, 4) frames: the base, then what each joint moves [m]. Source: Rodrigues' rotation formula."""
    count = len(columns)
    frames = np.zeros((count + 1, 4, 4))
    for i in range(4):
        frames[0, i, i] = 1.0
    turn, before = np.empty((3, 3)), np.empty((3, 3))
    for joint in range(count):
        x, y, z = axes[joint]
        ratio = np.sqrt(x * x + y * y + z * z)
        angle, x, y, z = ratio * positions_rad[int(columns[joint])], x / ratio, y / ratio, z / ratio
        s, c = np.sin(angle), np.cos(angle)
        d = 1.0 - c
        turn[0, 0], turn[0, 1], turn[0, 2] = c + x * x * d, x * y * d - z * s, x * z * d + y * s
        turn[1, 0], turn[1, 1], turn[1, 2] = y * x * d + z * s, c + y * y * d, y * z * d - x * s
        turn[2, 0], turn[2, 1], turn[2, 2] = z * x * d - y * s, z * y * d + x * s, c + z * z * d
        last, offset, moved = frames[joint], offsets[joint], frames[joint + 1]
        for i in range(3):
            for j in range(3):
                before[i, j] = last[i, 0] * offset[0, j] + last[i, 1] * offset[1, j] + last[i, 2] * offset[2, j]
            moved[i, 3] = last[i, 3] + (
                last[i, 0] * offset[0, 3] + last[i, 1] * offset[1, 3] + last[i, 2] * offset[2, 3]
            )
        for i in range(3):
            for j in range(3):
                moved[i, j] = before[i, 0] * turn[0, j] + before[i, 1] * turn[1, j] + before[i, 2] * turn[2, j]
        moved[3, 3] = 1.0
    return frames


@compiled
def tool_jacobian(
    frames: FloatArray, columns: FloatArray, axes: FloatArray, tool_m: FloatArray, jacobian: FloatArray
) -> None:
    """Add to (3, J) of zeros: each joint moves the tool at right angles to its axis and to the way to the tool."""
    last = frames[-1]
    tx, ty, tz = (
        last[0, 3] + last[0, 0] * tool_m[0] + last[0, 1] * tool_m[1] + last[0, 2] * tool_m[2],
        last[1, 3] + last[1, 0] * tool_m[0] + last[1, 1] * tool_m[1] + last[1, 2] * tool_m[2],
        last[2, 3] + last[2, 0] * tool_m[0] + last[2, 1] * tool_m[1] + last[2, 2] * tool_m[2],
    )
    for joint in range(len(columns)):
        frame, (x, y, z) = frames[joint + 1], axes[joint]
        # The axis is the same before and after the joint has turned about it.
        ax = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z
        ay = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z
        az = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z
        dx, dy, dz = tx - frame[0, 3], ty - frame[1, 3], tz - frame[2, 3]
        column = int(columns[joint])
        jacobian[0, column] += ay * dz - az * dy
        jacobian[1, column] += az * dx - ax * dz
        jacobian[2, column] += ax * dy - ay * dx


@compiled
def nearest_points(a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray) -> tuple[float, float, float]:
    """Distance [m] between two straight segments, either of which may be a point, and where on each it is least.

    The places are shares of the way from the first to the second end.
    Source: C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.9.
    """
    ux, uy, uz = a1[0] - a0[0], a1[1] - a0[1], a1[2] - a0[2]
    vx, vy, vz = b1[0] - b0[0], b1[1] - b0[1], b1[2] - b0[2]
    wx, wy, wz = a0[0] - b0[0], a0[1] - b0[1], a0[2] - b0[2]
    a, e, f = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, vx * wx + vy * wy + vz * wz
    tiny = 1e-12
    s, t = 0.0, 0.0
    if a <= tiny:
        t = min(max(f / e, 0.0), 1.0) if e > tiny else 0.0
    else:
        c = ux * wx + uy * wy + uz * wz
        if e <= tiny:
            s = min(max(-c / a, 0.0), 1.0)
        else:
            b = ux * vx + uy * vy + uz * vz
            below = a * e - b * b
            s = min(max((b * f - c * e) / below, 0.0), 1.0) if below > tiny else 0.0
            t = (b * s + f) / e
            if t < 0.0:
                t, s = 0.0, min(max(-c / a, 0.0), 1.0)
            elif t > 1.0:
                t, s = 1.0, min(max((b - c) / a, 0.0), 1.0)
    x, y, z = wx + ux * s - vx * t, wy + uy * s - vy * t, wz + uz * s - vz * t
    return np.sqrt(x * x + y * y + z * z), s, t


@compiled
def place_capsules(frames: FloatArray, mounted: FloatArray, ends: FloatArray, placed: FloatArray) -> None:
    """Fill in (N, 3, 3): both ends and the middle of each capsule in the base frame.

    `ends` (N, 2, 3) are given in the frames that `mounted` (N,) numbers.
    """
    for number in range(len(mounted)):
        frame = int(mounted[number])
        for end in range(2):
            x, y, z = ends[number, end, 0], ends[number, end, 1], ends[number, end, 2]
            for i in range(3):
                turned = frames[frame, i, 0] * x + frames[frame, i, 1] * y + frames[frame, i, 2] * z
                placed[number, end, i] = turned + frames[frame, i, 3]
        for i in range(3):
            placed[number, 2, i] = 0.5 * (placed[number, 0, i] + placed[number, 1, i])


@compiled
def least_clearance(
    a: FloatArray, a_sizes: FloatArray, b: FloatArray, b_sizes: FloatArray, pairs: FloatArray, far_m: float
) -> float:
    """Smallest distance [m] between the surfaces of pairs of capsules, negative inside; `far_m` if none is less.

    Args:
        a: (N, 3, 3) placed capsules.
        a_sizes: (N, 2) radius and half the length of each.
        b: (M, 3, 3) others, or the same.
        b_sizes: (M, 2) theirs.
        pairs: (P, 2) places in `a` and in `b`.
        far_m: Where looking closer ends: capsules whose bounding balls are further apart are not nearer.
    """
    least = far_m
    for number in range(len(pairs)):
        # Some thousand times a tick: numbers that are read one by one cost a fifth of rows that are taken out.
        i, j = int(pairs[number, 0]), int(pairs[number, 1])
        x, y, z = a[i, 2, 0] - b[j, 2, 0], a[i, 2, 1] - b[j, 2, 1], a[i, 2, 2] - b[j, 2, 2]
        radii = a_sizes[i, 0] + b_sizes[j, 0]
        reach = radii + a_sizes[i, 1] + b_sizes[j, 1] + least
        if reach > 0.0 and x * x + y * y + z * z < reach * reach:
            least = min(least, nearest_points(a[i, 0], a[i, 1], b[j, 0], b[j, 1])[0] - radii)
    return least

# SPDX-License-Identifier: Apache-2.0
"""A robot's body as capsules, from the primitive shapes of its description, and which pairs of them may collide.

People meet what they see: near them the shapes that a link shows count like those that it collides with, and its tool.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np

from mild_core.compiled import compiled
from mild_core.retargeting.robot_model.chain import (
    NOTHING_NEAR_M,
    Chain,
    chain_of,
    frames_of,
    least_clearance,
    mount_of,
    place_capsules,
)
from mild_core.retargeting.robot_model.kinematics import KinematicTree, read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import FIXED, Solid, read_solids
from mild_core.shapes import FloatArray, read_only

BARE_RADIUS_M = 0.06
"""Thickness of a link whose description has only meshes: half of what a person's arm has room for."""

ROW_DENSITY = 1.5
"""Capsules per thickness across a flat box: dents between them are a tenth of the thickness."""

NEIGHBOURS = 2
"""Links of so many joints apart cannot meet inside the joints' limits, as the middle one is between them."""

FIRST_MET = 2
"""The first frame whose links meet people: a shoulder, which the first joint turns on the spot, cannot hit a person."""

SEEN_M = 0.015
"""What is seen of a link and sticks out by less makes capsules thicker; what sticks out by more gets its own."""

TRIED_POSES, SEED = 500, 7
NEVER_NEAR_M = 0.05
"""Pairs that in none of so many random poses come nearer than this are not looked at again."""


TABLE_M, TABLE_AT_M = (0.60, 0.68), (-0.12, 0.0)
"""Of the table that a robot stands on: its length and width, and where its middle is in the base frame."""

TABLE_DEEP_M = 0.1
"""Nothing of the arm is wanted in so much below a table's top either."""


@dataclass(frozen=True)
class Table:
    """What a robot stands on.

    Attributes:
        top_m: Height of its top in the robot's base frame.
    """

    top_m: float

    def capsules(self) -> list[tuple[FloatArray, FloatArray, float]]:
        """What the arm keeps out of, in the base frame: start, end and radius of each."""
        middle = np.array([*TABLE_AT_M, self.top_m - TABLE_DEEP_M / 2.0])
        slab = Solid("", "box", (*TABLE_M, TABLE_DEEP_M), np.eye(4))
        return [(start + middle, end + middle, radius) for start, end, radius in _filled(slab)]


@lru_cache(maxsize=8)
def table_of(robot: RobotModel) -> Table:
    """The table under a robot that stands on one: it ends where the base begins, as far as its shapes show."""
    tree, ends = read_tree(robot.urdf_path), []
    loose = {joint.child for joint in tree.by_child.values() if joint.kind not in FIXED}
    for solid in read_solids(robot.urdf_path, "visual"):
        above = {solid.link, *(joint.child for joint in tree.chain(solid.link))}
        if solid.link == robot.base_link or not above & loose:  # another arm may hang lower
            pose = mount_of(robot, tree, solid.link).pose @ solid.origin
            ends.append(float((_surface(solid) @ pose[:3, :3].T + pose[:3, 3])[:, 2].min()))
    return Table(min(ends, default=0.0))


@dataclass(frozen=True, eq=False)
class Capsules:
    """N capsules.

    Attributes:
        mounted: (N,) the frame of the chain that each moves with; 0 for the base.
        ends_m: (N, 2, 3) the ends of each axis in that frame.
        sizes_m: (N, 2) radius and half the length of each axis.
        outer_m: (N,) radii with which they hold the corners of the shapes too: for distances to people.
        pairs: (P, 2) those that may come into collision with each other. What is only seen of a link, and its tool,
            is in no pair: it counts near people.
    """

    mounted: FloatArray
    ends_m: FloatArray
    sizes_m: FloatArray
    outer_m: FloatArray
    pairs: FloatArray

    @cached_property
    def moving(self) -> FloatArray:
        """Places of those that the chain moves, without its first joint's: a shoulder cannot hit a person."""
        return np.flatnonzero(self.mounted >= FIRST_MET).astype(np.float64)


@lru_cache(maxsize=8)
def capsules_of(robot: RobotModel) -> Capsules:
    """The capsules of a robot; links that are described by meshes alone get one from joint to joint.

    Pairs are left out that belong together: on the same or on neighbouring links, touching at home, or never near
    each other.

    Raises:
        SetupError: The description is broken.
    """
    tree, chain = read_tree(robot.urdf_path), chain_of(robot)
    found = [made for solid in read_solids(robot.urdf_path) for made in _mounted(robot, tree, solid)]
    tips = [*chain.offsets[1:, :3, 3], chain.tool_m]
    for frame, tip in enumerate(tips, start=1):
        if all(each.frame != frame for each in found):
            found.append(_Mounted(frame, np.zeros(3), tip, BARE_RADIUS_M, BARE_RADIUS_M))
    if robot.keeps_off_table:
        found += [_Mounted(0, start, end, radius, radius) for start, end, radius in table_of(robot).capsules()]
    colliding = len(found)
    _hold_what_is_seen(found, robot, tree, chain)
    mounted = read_only(np.array([each.frame for each in found], dtype=np.float64))
    ends = read_only(np.array([[each.start_m, each.end_m] for each in found]))
    halves = [float(np.linalg.norm(each.end_m - each.start_m)) / 2.0 for each in found]
    sizes = read_only(np.array([[each.radius_m, half] for each, half in zip(found, halves, strict=True)]))
    pairs = _pairs(robot, chain, mounted[:colliding], ends[:colliding], sizes[:colliding])
    return Capsules(mounted, ends, sizes, read_only(np.array([each.outer_m for each in found])), read_only(pairs))


class _Mounted(NamedTuple):
    """One capsule in the frame of the chain that it moves with."""

    frame: int
    start_m: FloatArray
    end_m: FloatArray
    radius_m: float
    outer_m: float

    def beyond_m(self, points_m: FloatArray) -> FloatArray:
        """(P,) how far points (P, 3) of the same frame stick out of it [m]; negative inside."""
        along = self.end_m - self.start_m
        shares = np.clip((points_m - self.start_m) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        apart: FloatArray = np.linalg.norm(points_m - self.start_m - shares[:, None] * along, axis=1)
        return apart - self.outer_m


def _hold_what_is_seen(found: list[_Mounted], robot: RobotModel, tree: KinematicTree, chain: Chain) -> None:
    """Make capsules thicker, or add some, until they hold what links show, and the tool.

    A shape that sticks out by less than `SEEN_M` makes those thicker that it sticks out of: few are quick to look at.
    """
    tool = _Mounted(len(chain.columns), chain.tool_m, chain.tool_m, 0.0, 0.0)
    seen = [([tool], chain.tool_m[None])]
    for solid in read_solids(robot.urdf_path, "visual"):
        made = list(_mounted(robot, tree, solid))
        pose = mount_of(robot, tree, solid.link).pose @ solid.origin
        seen.append((made, _surface(solid) @ pose[:3, :3].T + pose[:3, 3]))
    for made, points in sorted(seen, key=lambda each: -each[0][0].outer_m):
        holding = [place for place, other in enumerate(found) if other.frame == made[0].frame]
        if made[0].frame < FIRST_MET:
            continue
        beyond = np.array([found[place].beyond_m(points) for place in holding])
        if beyond.min(axis=0).max() > SEEN_M:
            found.extend(made)
            continue
        for point, nearest in enumerate(beyond.argmin(axis=0).tolist()):
            one = found[holding[nearest]]
            thicker_m = max(0.0, float(one.beyond_m(points[point : point + 1])[0]))
            found[holding[nearest]] = one._replace(outer_m=one.outer_m + thicker_m)


def _mounted(robot: RobotModel, tree: KinematicTree, solid: Solid) -> Iterator[_Mounted]:
    """The capsules of a solid, where it hangs on the chain."""
    mount = mount_of(robot, tree, solid.link)
    pose = mount.pose @ solid.origin
    filled = _filled(solid)
    beyond_m = _beyond(solid, filled)
    for start, end, radius in filled:
        first, second = (pose[:3, :3] @ point + pose[:3, 3] for point in (start, end))
        yield _Mounted(mount.frame, first, second, radius, radius + beyond_m)


def _filled(solid: Solid) -> list[tuple[FloatArray, FloatArray, float]]:
    """Capsules that together have the shape of a solid: start, end and radius of each in its own frame."""
    if solid.kind == "sphere":
        return [(np.zeros(3), np.zeros(3), solid.size_m[0])]
    if solid.kind == "cylinder":
        radius, length = solid.size_m
        half = np.array([0.0, 0.0, max(length / 2.0 - radius / 2.0, 0.0)])
        return [(-half, half, radius)]
    short, middle, long = np.argsort(solid.size_m)
    radius = solid.size_m[short] / 2.0
    along, across = np.zeros(3), np.zeros(3)
    along[long] = solid.size_m[long] / 2.0 - radius
    across[middle] = solid.size_m[middle] / 2.0 - radius
    rows = max(1, math.ceil(ROW_DENSITY * solid.size_m[middle] / solid.size_m[short]))
    places = [0.0] if rows == 1 else np.linspace(-1.0, 1.0, rows).tolist()
    return [(place * across - along, place * across + along, radius) for place in places]


def _beyond(solid: Solid, filled: list[tuple[FloatArray, FloatArray, float]]) -> float:
    """How far a solid's corners stick out of its capsules [m]."""
    if solid.kind == "sphere":
        return 0.0
    if solid.kind == "cylinder":
        corners = np.array([[solid.size_m[0], 0.0, solid.size_m[1] / 2.0]])
    else:
        corners = np.array(list(product((-0.5, 0.5), repeat=3))) * solid.size_m
    outside = []
    for start, end, radius in filled:
        along = end - start
        shares = np.clip((corners - start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        outside.append(np.linalg.norm(corners - start - shares[:, None] * along, axis=1) - radius)
    return max(0.0, float(np.min(outside, axis=0).max()))


def _surface(solid: Solid) -> FloatArray:
    """(P, 3) points on the surface of a solid, in its own frame: those farthest out, and some between."""
    if solid.kind == "box":
        return np.array(list(product((-0.5, 0.0, 0.5), repeat=3))) * solid.size_m
    around = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    ring = solid.size_m[0] * np.stack([np.cos(around), np.sin(around), np.zeros(16)], axis=1)
    if solid.kind == "sphere":
        return np.concatenate([ring, ring[:, [1, 2, 0]], ring[:, [2, 0, 1]]])
    along = np.array([0.0, 0.0, solid.size_m[1]])
    return np.concatenate([ring + share * along for share in (-0.5, 0.0, 0.5)])


def _pairs(robot: RobotModel, chain: Chain, mounted: FloatArray, ends_m: FloatArray, sizes_m: FloatArray) -> FloatArray:
    """(P, 2) of all pairs on links that are no neighbours, those that may meet but do not at home."""
    apart = np.abs(mounted[:, None] - mounted[None, :]) > NEIGHBOURS
    every = np.argwhere(np.triu(apart, 1)).astype(np.float64)
    tried = np.random.default_rng(SEED).uniform(robot.lower_rad, robot.upper_rad, (TRIED_POSES, len(robot.joint_names)))
    body = (chain.columns, chain.offsets, chain.axes, mounted, ends_m, sizes_m, every)
    at_home = pair_clearances(robot.home_rad[None], *body)
    kept: FloatArray = every[(pair_clearances(tried, *body) < NEVER_NEAR_M) & (at_home > 0.0)]
    return kept


@compiled
def pair_clearances(
    poses_rad: FloatArray,
    columns: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    mounted: FloatArray,
    ends_m: FloatArray,
    sizes_m: FloatArray,
    pairs: FloatArray,
) -> FloatArray:
    """(P,) the smallest clearance [m] of each pair over poses (T, J), as far as it is below `NOTHING_NEAR_M`."""
    placed = np.empty((len(mounted), 3, 3))
    least = np.full(len(pairs), NOTHING_NEAR_M)
    for pose in range(len(poses_rad)):
        place_capsules(frames_of(poses_rad[pose], columns, offsets, axes), mounted, ends_m, placed)
        for pair in range(len(pairs)):
            least[pair] = least_clearance(placed, sizes_m, placed, sizes_m, pairs[pair : pair + 1], least[pair])
    return least

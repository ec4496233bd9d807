# SPDX-License-Identifier: Apache-2.0
"""A robot's body as capsules, from the primitive shapes of its description, and which pairs of them may collide."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np

from mild_core.compiled import compiled
from mild_core.retargeting.chain import (
    NOTHING_NEAR_M,
    Chain,
    chain_of,
    frames_of,
    least_clearance,
    mount_of,
    place_capsules,
)
from mild_core.retargeting.kinematics import read_tree
from mild_core.retargeting.robot import RobotModel
from mild_core.retargeting.urdf import Solid, read_solids
from mild_core.shapes import FloatArray, read_only

BARE_RADIUS_M = 0.06
"""Thickness of a link whose description has only meshes: half of what a person's arm has room for."""

ROW_DENSITY = 1.5
"""Capsules per thickness across a flat box: dents between them are a tenth of the thickness."""

NEIGHBOURS = 2
"""Links of so many joints apart cannot meet inside the joints' limits, as the middle one is between them."""

TRIED_POSES, SEED = 500, 7
NEVER_NEAR_M = 0.05
"""Pairs that in none of so many random poses come nearer than this are not looked at again."""


@dataclass(frozen=True, eq=False)
class Capsules:
    """N capsules.

    Attributes:
        mounted: (N,) the frame of the chain that each moves with; 0 for the base.
        ends_m: (N, 2, 3) the ends of each axis in that frame.
        sizes_m: (N, 2) radius and half the length of each axis.
        outer_m: (N,) radii with which they hold the corners of the shapes too: for distances to people.
        pairs: (P, 2) those that may come into collision with each other.
    """

    mounted: FloatArray
    ends_m: FloatArray
    sizes_m: FloatArray
    outer_m: FloatArray
    pairs: FloatArray

    @property
    def moving(self) -> FloatArray:
        """Places of those that the chain moves, without its first joint's: a shoulder meets nobody."""
        found: FloatArray = np.flatnonzero(self.mounted > 1).astype(np.float64)
        return found


@lru_cache(maxsize=8)
def capsules_of(robot: RobotModel) -> Capsules:
    """The capsules of a robot; links that are described by meshes alone get one from joint to joint.

    Pairs are left out that belong together: on the same or on neighbouring links, touching at home, or never near
    each other.

    Raises:
        SetupError: The description is broken.
    """
    tree, chain = read_tree(robot.urdf_path), chain_of(robot)
    mounted, ends, sizes, outer = [], [], [], []
    for solid in read_solids(robot.urdf_path):
        mount = mount_of(robot, tree, solid.link)
        pose = mount.pose @ solid.origin
        filled = _filled(solid)
        beyond_m = _beyond(solid, filled)
        for start, end, radius in filled:
            mounted.append(mount.frame)
            ends.append([pose[:3, :3] @ start + pose[:3, 3], pose[:3, :3] @ end + pose[:3, 3]])
            sizes.append((radius, float(np.linalg.norm(end - start)) / 2.0))
            outer.append(radius + beyond_m)
    tips = [*chain.offsets[1:, :3, 3], chain.tool_m]
    for frame, tip in enumerate(tips, start=1):
        if frame not in mounted:
            mounted.append(frame)
            ends.append([np.zeros(3), tip])
            sizes.append((BARE_RADIUS_M, float(np.linalg.norm(tip)) / 2.0))
            outer.append(BARE_RADIUS_M)
    made = (read_only(np.array(mounted, dtype=np.float64)), read_only(np.array(ends)), read_only(np.array(sizes)))
    return Capsules(*made, read_only(np.array(outer)), read_only(_pairs(robot, chain, *made)))


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

# SPDX-License-Identifier: Apache-2.0
"""A person as a few round bodies between the joints of a skeleton."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

SKIN, SHIRT, TROUSERS, SHOES = (
    (0.87, 0.68, 0.56, 1.0),
    (0.24, 0.42, 0.62, 1.0),
    (0.25, 0.27, 0.32, 1.0),
    (0.12, 0.12, 0.13, 1.0),
)


@dataclass(frozen=True)
class Bone:
    """A round body from one joint to another; a ball where both are one.

    Attributes:
        start: Name of a joint.
        end: Name of a joint.
        radius_m: Of the body.
        rgba: Its colour.
    """

    start: str
    end: str
    radius_m: float
    rgba: tuple[float, float, float, float]


def _limbs(side: str) -> tuple[Bone, ...]:
    return (
        Bone("neck", f"{side}_shoulder", 0.065, SHIRT),
        Bone(f"{side}_shoulder", f"{side}_elbow", 0.048, SHIRT),
        Bone(f"{side}_elbow", f"{side}_wrist", 0.038, SKIN),
        Bone(f"{side}_wrist", f"{side}_hand", 0.040, SKIN),
        Bone(f"{side}_shoulder", f"{side}_hip", 0.085, SHIRT),
        Bone(f"{side}_hip", f"{side}_knee", 0.075, TROUSERS),
        Bone(f"{side}_knee", f"{side}_ankle", 0.055, TROUSERS),
        Bone(f"{side}_ankle", f"{side}_foot", 0.045, SHOES),
    )


BONES = (
    Bone("pelvis", "spine", 0.105, SHIRT),
    Bone("spine", "chest", 0.11, SHIRT),
    Bone("chest", "neck", 0.10, SHIRT),
    Bone("left_hip", "right_hip", 0.09, TROUSERS),
    Bone("neck", "head", 0.055, SKIN),
    Bone("head", "head", 0.105, SKIN),
    *_limbs("left"),
    *_limbs("right"),
)
"""A grown person; joints are named as in `mild_core.perception.skeletons.JOINTS`."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles.

    Attributes:
        vertices_m: (V, 3).
        normals: (V, 3) unit vectors outwards.
        triangles: (F, 3) numbers of vertices, anticlockwise seen from outside.
    """

    vertices_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    triangles: NDArray[np.int64]


def capsule(radius_m: float, length_m: float, around: int = 20, rings: int = 5) -> Mesh:
    """A cylinder along z with round ends, its middle at the origin; PyBullet's own is drawn with six corners.

    Args:
        radius_m: Of the cylinder and its ends.
        length_m: Of the cylinder without its ends; 0 gives a ball.
        around: Vertices of each ring.
        rings: Rings of each round end.
    """
    polar = np.linspace(0.0, np.pi / 2.0, rings + 1)
    polar = np.concatenate([polar, np.pi - polar[::-1]])
    round_ = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None]
    normals = np.stack([sine * np.cos(round_), sine * np.sin(round_), np.repeat(cosine, around, 1)], axis=-1)
    vertices = normals * radius_m
    vertices[: rings + 1, :, 2] += length_m / 2.0
    vertices[rings + 1 :, :, 2] -= length_m / 2.0
    ring, spoke = np.meshgrid(np.arange(len(polar) - 1), np.arange(around), indexing="ij")
    here, beside = ring * around + spoke, ring * around + (spoke + 1) % around
    faces = np.stack([here, here + around, beside, beside, here + around, beside + around], axis=-1)
    return Mesh(vertices.reshape(-1, 3), normals.reshape(-1, 3), faces.reshape(-1, 3))


def finite_joints(joints_m: Mapping[str, ArrayLike]) -> dict[str, NDArray[np.float64]]:
    """Those joints, each (3,), that are somewhere."""
    arrays = {name: np.asarray(place, dtype=np.float64) for name, place in joints_m.items()}
    return {name: place for name, place in arrays.items() if place.shape == (3,) and np.isfinite(place).all()}


def quaternion_from_z(direction: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """x, y, z, w of the shortest turn from the z axis to the unit vector `direction` (3,)."""
    x, y, z = (float(value) for value in direction)
    if z < -1.0 + 1e-9:
        return (1.0, 0.0, 0.0, 0.0)
    w = float(np.sqrt((1.0 + z) / 2.0))
    return (-y / (2.0 * w), x / (2.0 * w), 0.0, w)

# SPDX-License-Identifier: Apache-2.0
"""Smooth closed surfaces as triangles: what a drawn body is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.shapes import FloatArray

SEGMENTS = 28
"""Points around a ring: round enough at a finger's width from the screen, few enough for a small page."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles in a part's own frame.

    Attributes:
        vertices_m: (V, 3).
        normals: (V, 3) unit vectors outwards.
        faces: (F, 3) indices, counter-clockwise seen from outside.
    """

    vertices_m: FloatArray
    normals: FloatArray
    faces: np.ndarray


@dataclass(frozen=True)
class Ring:
    """One cross-section of a lofted surface: an ellipse across z, or a rounder box.

    Attributes:
        height_m: Its z.
        depth_m: Half axis along x.
        width_m: Half axis along y.
        shift_m: Its centre's x.
        squareness: 2 for an ellipse, more for a rounded box.
    """

    height_m: float
    depth_m: float
    width_m: float
    shift_m: float = 0.0
    squareness: float = 2.0


def lofted(rings: Sequence[Ring]) -> Surface:
    """A closed surface through rings in order of height; its ends are closed by a point."""
    angles = np.linspace(0.0, 2.0 * np.pi, SEGMENTS, endpoint=False)
    cosine, sine = np.cos(angles), np.sin(angles)
    points = []
    for ring in rings:
        power = 2.0 / ring.squareness
        x = ring.shift_m + ring.depth_m * np.sign(cosine) * np.abs(cosine) ** power
        y = ring.width_m * np.sign(sine) * np.abs(sine) ** power
        points.append(np.stack([x, y, np.full(SEGMENTS, ring.height_m)], axis=1))
    ends = [[rings[0].shift_m, 0.0, rings[0].height_m], [rings[-1].shift_m, 0.0, rings[-1].height_m]]
    vertices = np.concatenate([*points, np.array(ends)])
    faces = _faces(len(rings))
    return Surface(vertices, _normals(vertices, faces), faces)


def tapered_limb(length_m: float, start_m: float, end_m: float, bulge: float = 0.0) -> Surface:
    """A limb along z from 0 to `length_m` with round ends of radii `start_m` and `end_m`; `bulge` swells its calf."""
    rings = [Ring(start_m * np.sin(a), start_m * np.cos(a), start_m * np.cos(a)) for a in _cap(-1.0)]
    for share in np.linspace(0.12, 0.88, 7):
        radius = start_m + share * (end_m - start_m) + bulge * start_m * np.sin(np.pi * share) ** 2 * (1.0 - share)
        rings.append(Ring(share * length_m, radius, radius))
    rings += [Ring(length_m + end_m * np.sin(a), end_m * np.cos(a), end_m * np.cos(a)) for a in _cap(1.0)]
    return lofted(sorted(rings, key=lambda ring: ring.height_m))


def ellipsoid(depth_m: float, width_m: float, height_m: float, lowest: float = -1.0) -> Surface:
    """An ellipsoid about the origin with these half axes; cut flat below `lowest` of its height (-1: whole)."""
    sines = np.sin(np.linspace(np.arcsin(lowest), np.pi / 2, 14))
    sines = np.clip(sines, -0.9995, 0.9995)
    cosines = np.sqrt(1.0 - sines**2)
    return lofted([Ring(height_m * s, depth_m * c, width_m * c) for s, c in zip(sines, cosines, strict=True)])


def _cap(sign: float) -> FloatArray:
    """Angles of the rings of a round end."""
    return sign * np.linspace(0.0, np.pi / 2 * 0.98, 6)


def _faces(rings: int) -> np.ndarray:
    faces = []
    bottom, top = rings * SEGMENTS, rings * SEGMENTS + 1
    for j in range(SEGMENTS):
        k = (j + 1) % SEGMENTS
        faces.append((bottom, k, j))
        faces.append((top, (rings - 1) * SEGMENTS + j, (rings - 1) * SEGMENTS + k))
        for i in range(rings - 1):
            a, b = i * SEGMENTS + j, i * SEGMENTS + k
            faces += [(a, b, a + SEGMENTS), (b, b + SEGMENTS, a + SEGMENTS)]
    return np.array(faces, dtype=np.int32)


def _normals(vertices: FloatArray, faces: np.ndarray) -> FloatArray:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(normals, faces[:, i], across)
    unit: FloatArray = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return unit

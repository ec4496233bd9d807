# SPDX-License-Identifier: Apache-2.0
"""Many windows put together into few: means of clusters, none of which is a recorded window."""

from __future__ import annotations

import numpy as np

from mild_core.shapes import FloatArray

ITERATIONS = 30


def clusters(points: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """(M, F) centres of clusters of points (N, F): `count`, or fewer where fewer points differ.

    Source: Lloyd's algorithm, started as in Arthur, Vassilvitskii, "k-means++" (2007).
    """
    centres = points[rng.integers(len(points), size=1)]
    for _ in range(count - 1):
        squares = squared_distances(points, centres).min(axis=1)
        if not squares.any():  # every point is a centre already: a person who stands perfectly still
            break
        centres = np.concatenate([centres, points[rng.choice(len(points), size=1, p=squares / squares.sum())]])
    for _ in range(ITERATIONS):
        nearest = squared_distances(points, centres).argmin(axis=1)
        members = [points[nearest == m] for m in range(len(centres))]
        centres = np.stack([own.mean(axis=0) if len(own) else old for own, old in zip(members, centres, strict=True)])
    return centres


def squared_distances(points: FloatArray, centres: FloatArray) -> FloatArray:
    """(N, M)."""
    squares: FloatArray = (points**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2.0 * points @ centres.T
    return np.maximum(squares, 0.0)

# SPDX-License-Identifier: Apache-2.0
"""How far a person's motion may be from what was learned before it is unknown: radii, measured while learning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch.nn import functional

from mild_core.learning.coordinates import principal_coordinates
from mild_core.learning.corpus import Corpus, bend, cut_tracks
from mild_core.learning.settings import Augmentation
from mild_core.learning.trained import TrainedMember
from mild_core.shapes import FloatArray

FEATURES = 10
"""Principal components of the human's window in which distances are taken."""

CENTRES, LEAST_WINDOWS = 64, 20
"""Clusters at most, and windows for one of them at least, on average."""

QUANTILE, MARGIN = 0.995, 1.1
"""Of the windows learned from, this share lies within a radius, before the margin is added."""

DRAWS = Augmentation(copies=4, speed=0.1, unsteadiness=0.1, arm_scale=0.05, yaw_rad=0.1, offset_m=0.01)
"""Trials are bent before radii are measured: the next person is not one of those who were recorded."""

ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class Territory:
    """Where in the space of windows the learned ones lie, without storing any of them.

    Attributes:
        weight: (W D, F) from a window to whitened principal components.
        bias: (F,).
        centres: (M, F) means of clusters.
        radii: (M,) how far their windows reach.
    """

    weight: FloatArray
    bias: FloatArray
    centres: FloatArray
    radii: FloatArray


def territory_of(corpus: Corpus, seed: int) -> Territory:
    """Clusters of the windows of all trials, bent a little (see `DRAWS`).

    Source: Lloyd's algorithm, started as in Arthur, Vassilvitskii, "k-means++" (2007).
    """
    recorded = cut_tracks(corpus, corpus.tracks, 0, 2)
    coordinates = principal_coordinates(recorded.question[recorded.valid > 0], FEATURES, 1.0)
    assert coordinates.directions is not None
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        bent = cut_tracks(corpus, bend(corpus.tracks, DRAWS), 0, 4)
    windows = coordinates.project(bent.question[bent.valid > 0]).double().numpy()
    centres = _clusters(windows, max(1, min(CENTRES, len(windows) // LEAST_WINDOWS)), np.random.default_rng(seed))
    squares = _squares(windows, centres)
    nearest, distances = squares.argmin(axis=1), np.sqrt(squares.min(axis=1))
    own = [distances[nearest == m] for m in range(len(centres))]
    reach = np.array([np.quantile(d, QUANTILE) if len(d) else 0.0 for d in own])
    # A cluster of hardly any spread (people at rest) would call the next person unknown for standing otherwise.
    radii = MARGIN * np.maximum(reach, np.median(reach))
    weight = (coordinates.directions / coordinates.scale).double().numpy()
    return Territory(weight, -coordinates.mean.double().numpy() @ weight, centres, radii)


def latent_radius(member: TrainedMember, corpus: Corpus, stride: int, seed: int) -> FloatArray:
    """(P,) Mahalanobis distance of the human's latent from the nearest component that hardly any window exceeds."""
    labels = len(corpus.interactions)
    with torch.no_grad(), torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        batch = cut_tracks(corpus, bend(corpus.tracks, DRAWS), 0, stride)
        window = member.question.project(batch.question)
        label = functional.one_hot(batch.label, labels).float()[:, None].expand(-1, window.shape[1], -1)
        posterior = member.networks.observe(member.networks.sources(window, label))
    means, covariances = posterior.mean.double().numpy(), posterior.covariance.double().numpy()
    distances: list[list[float]] = [[] for _ in range(labels)]
    for b, n in np.argwhere(batch.valid.numpy() > 0):
        label_of = int(batch.label[b])
        explanation = member.prior.priors[label_of].explain(means[b, n], covariances[b, n])
        distances[label_of].append(float(explanation.distances.min()))
    return MARGIN * np.array([np.quantile(found, QUANTILE) for found in distances])


def _clusters(points: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    centres = points[rng.integers(len(points), size=1)]
    for _ in range(count - 1):
        squares = _squares(points, centres).min(axis=1)
        centres = np.concatenate([centres, points[rng.choice(len(points), size=1, p=squares / squares.sum())]])
    for _ in range(ITERATIONS):
        nearest = _squares(points, centres).argmin(axis=1)
        members = [points[nearest == m] for m in range(count)]
        centres = np.stack([own.mean(axis=0) if len(own) else old for own, old in zip(members, centres, strict=True)])
    return centres


def _squares(points: FloatArray, centres: FloatArray) -> FloatArray:
    """(N, M) squared distances."""
    squares: FloatArray = (points**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2.0 * points @ centres.T
    return np.maximum(squares, 0.0)


def bone_lengths_m(segments: Sequence[FloatArray]) -> tuple[float, float]:
    """Median lengths of upper arm and forearm over tracks (T, 3, 3) of shoulder, elbow and hand [m]."""
    lengths = np.concatenate([np.linalg.norm(np.diff(track, axis=1), axis=2) for track in segments])
    upper, fore = np.median(lengths, axis=0).tolist()
    return upper, fore

# SPDX-License-Identifier: Apache-2.0
"""How far a person's motion may be from what was learned before it is unknown, measured while learning."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from scipy.cluster.vq import kmeans2  # type: ignore[import-untyped]  # scipy brings no types
from torch.nn import functional

from mild_core.inference.novelty_detector import NoveltyDetector
from mild_core.learning.data.coordinates import principal_coordinates
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.folds import Fold, folds_of
from mild_core.learning.data.windows import Protocol, cut, onset_window
from mild_core.learning.training.corpus import Corpus, augment, cut_tracks
from mild_core.learning.training.settings import Augmentation
from mild_core.learning.training.trained import TrainedMember
from mild_core.shapes import FloatArray

FEATURES, WHITENING = 20, 0.5
"""Principal components of the human's window in which distances are taken, and how much their deviations differ."""

CENTRES, LEAST_WINDOWS, ITERATIONS = 64, 10, 30
"""Clusters of an interaction at most, windows for one of them at least, on average, and steps to find them."""

WINDOWS_PER_S = 10.0
"""That are clustered: neighbours are almost equal."""

KEPT_PER_S = 0.6
"""Share of the accumulated novelty that is left after a second."""

SETTLED_S = 1.0
"""Time after the onset from which on known and unknown motions can be distinguished [s]."""

QUANTILE, MARGIN = 0.995, 1.1
"""Of the known windows this share lies within a reach or radius, before the margin is added: at each that does not, a
robot stops in the middle of what it does."""

DRAWS = Augmentation(copies=4, speed=0.1, unsteadiness=0.1, arm_scale=0.05, yaw_rad=0.1, offset_m=0.01)
"""Trials are bent before latent radii are measured: the next person is not one of those who were recorded."""


def territory_of(
    demonstrations: Sequence[Demonstration], protocol: Protocol, interactions: Sequence[str], seed: int
) -> NoveltyDetector:
    """Where the windows of each interaction lie, and how far those of other people may be.

    The reach is `MARGIN` times what `QUANTILE` of the settled frames keep within, in trials held out in turn.

    Args:
        demonstrations: Of every interaction at least one.
        protocol: How to cut them.
        interactions: By label.
        seed: Of the clusters' beginnings.

    Source: ours.
    """
    whole = Fold(tuple(demonstrations), tuple(demonstrations))
    known = {trial.interaction for trial in demonstrations}
    folds = [
        fold
        for fold in folds_of(demonstrations)
        if fold.held_out and {trial.interaction for trial in fold.learned} == known
    ]
    scores = []
    for fold in folds or [whole]:
        territory = clustered(fold.learned, protocol, interactions, seed)
        scores += [settled_scores(territory, trial, protocol) for trial in fold.held_out]
    reach = MARGIN * float(np.quantile(np.concatenate(scores), QUANTILE))
    return replace(clustered(demonstrations, protocol, interactions, seed), reach=max(reach, 1e-6))


def settled_scores(territory: NoveltyDetector, trial: Demonstration, protocol: Protocol) -> FloatArray:
    """Scores of a trial's windows from `SETTLED_S` after its onset; of the last one, where that is later."""
    novelty, scores = territory.init(), []
    for window in cut(trial, protocol).observed:
        novelty = territory.follow(novelty, window)
        scores.append(territory.score(novelty))
    return np.array(scores)[min(onset_window(trial, protocol, SETTLED_S), len(scores) - 1) :]


def clustered(
    demonstrations: Sequence[Demonstration], protocol: Protocol, interactions: Sequence[str], seed: int
) -> NoveltyDetector:
    """A territory that reaches one unit far."""
    rate_hz = demonstrations[0].rate_hz / protocol.keep_every
    stride = max(1, round(rate_hz / WINDOWS_PER_S))
    windows = {name: [] for name in interactions}  # type: dict[str, list[FloatArray]]
    for trial in demonstrations:
        questions = cut(trial, protocol).observed[::stride]
        windows[trial.interaction].append(questions.reshape(len(questions), -1))
    every = np.concatenate([part for parts in windows.values() for part in parts])
    coordinates = principal_coordinates(torch.from_numpy(every), FEATURES, WHITENING)
    assert coordinates.directions is not None
    weight = (coordinates.directions / coordinates.scale).double().numpy()
    bias, rng = -coordinates.mean.double().numpy() @ weight, np.random.default_rng(seed)
    centres = []
    for parts in windows.values():
        points = np.concatenate(parts) @ weight + bias
        centres.append(centres_of(points, max(1, min(CENTRES, len(points) // LEAST_WINDOWS)), rng))
    owners = np.repeat(np.arange(len(centres)), [len(found) for found in centres]).astype(np.float64)
    return NoveltyDetector(weight, bias, np.concatenate(centres), owners, 1.0, KEPT_PER_S ** (1.0 / rate_hz))


def centres_of(points: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """(M, F) means of clusters of points (N, F), none of them recorded: `count`, or fewer where fewer points differ."""
    different = np.unique(points, axis=0)
    if len(different) <= count:  # a person who stands perfectly still
        return different
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # of a cluster that keeps no point
        centres: FloatArray = kmeans2(points, count, iter=ITERATIONS, minit="++", seed=rng)[0]
    return centres


def latent_radius(member: TrainedMember, corpus: Corpus, stride: int, seed: int) -> FloatArray:
    """(P,) Mahalanobis distance of the human's latent from the nearest component that hardly any window exceeds."""
    labels = len(corpus.interactions)
    with torch.no_grad(), torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        batch = cut_tracks(corpus, augment(corpus.tracks, DRAWS), 0, stride)
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


def bone_lengths_m(segments: Sequence[FloatArray]) -> tuple[float, float]:
    """Median lengths of upper arm and forearm over tracks (T, 3, 3) of shoulder, elbow and hand [m]."""
    lengths = np.concatenate([np.linalg.norm(np.diff(track, axis=1), axis=2) for track in segments])
    upper, fore = np.median(lengths, axis=0).tolist()
    return upper, fore

# SPDX-License-Identifier: Apache-2.0
"""How well unseen motions are detected as unknown: each interaction left out in turn."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata  # type: ignore[import-untyped]  # scipy brings no types

from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.folds import Fold, folds_of
from mild_core.learning.data.windows import Protocol, cut, onset_window
from mild_core.learning.training.novelty import SETTLED_S, WINDOWS_PER_S, clustered, settled_scores
from mild_core.shapes import FloatArray

FALSE_ALARMS = 0.05
"""At which scores are compared; a model's own bound allows far fewer, see `novelty.territory_of`."""

Score = Callable[[Demonstration], FloatArray]
"""A trial -> scores of its frames from `SETTLED_S` after its onset; the higher, the stranger."""


@dataclass(frozen=True)
class Separation:
    """How far apart a score sets known motions and unknown ones.

    Attributes:
        share: Of the frames of unknown motions, called unknown where `FALSE_ALARMS` of those of known ones are.
        area: Under the curve of that share over false alarms: 0.5 is chance, 1 is perfect.
    """

    share: float
    area: float


def leave_one_out(
    demonstrations: Sequence[Demonstration], protocol: Protocol, interactions: Sequence[str], seed: int = 0
) -> Mapping[str, Mapping[str, Separation]]:
    """By interaction left out, how well our score and a nearest neighbour's separate it from the others.

    What is learned from the other interactions in three quarters of their trials meets the trials of the one that was
    left out, and those of the others that were held out: by four folds. Our score is the territory's, which no network
    enters, so none is trained.

    Args:
        demonstrations: Training trials.
        protocol: How to cut them.
        interactions: All of their names.
        seed: Of the clusters' beginnings.
    """
    found: dict[str, Mapping[str, Separation]] = {}
    for left_out in interactions:
        others = tuple(name for name in interactions if name != left_out)
        unknown = [trial for trial in demonstrations if trial.interaction == left_out]
        folds = folds_of([trial for trial in demonstrations if trial.interaction != left_out])
        found[left_out] = {
            "ours": _separated([_by_territory(fold, protocol, others, seed) for fold in folds], folds, unknown),
            "nearest_neighbour": _separated([_by_neighbour(fold, protocol) for fold in folds], folds, unknown),
        }
    return found


def _separated(scores: Sequence[Score], folds: Sequence[Fold], unknown: Sequence[Demonstration]) -> Separation:
    """What each fold's score makes of its own held-out trials, and of all the unknown ones."""
    return separation(
        [score(trial) for score, fold in zip(scores, folds, strict=True) for trial in fold.held_out],
        [score(trial) for score in scores for trial in unknown],
    )


def separation(known: Sequence[FloatArray], unknown: Sequence[FloatArray]) -> Separation:
    """Compare scores of known and of unknown motions, arrays by trial.

    Source: area by ranks, Mann and Whitney (1947).
    """
    low, high = np.concatenate(known), np.concatenate(unknown)
    ranks = rankdata(np.concatenate([low, high]))[len(low) :]
    area = (ranks.sum() - len(high) * (len(high) + 1) / 2) / (len(low) * len(high))
    return Separation(float(np.mean(high > np.quantile(low, 1.0 - FALSE_ALARMS))), float(area))


def _by_territory(fold: Fold, protocol: Protocol, interactions: Sequence[str], seed: int) -> Score:
    territory = clustered(fold.learned, protocol, interactions, seed)
    return lambda trial: settled_scores(territory, trial, protocol)


def _by_neighbour(fold: Fold, protocol: Protocol) -> Score:
    """Distance from the nearest window learned from, in features as they are."""
    stride = max(1, round(fold.learned[0].rate_hz / protocol.keep_every / WINDOWS_PER_S))

    def points(trial: Demonstration, first: int) -> FloatArray:
        windows = cut(trial, protocol).observed
        windows = windows[min(first, len(windows) - 1) :: stride]
        return windows.reshape(len(windows), -1)

    learned = np.concatenate([points(trial, 0) for trial in fold.learned])
    norms = (learned**2).sum(axis=1)

    def score(trial: Demonstration) -> FloatArray:
        windows = points(trial, onset_window(trial, protocol, SETTLED_S))
        nearest: FloatArray = (norms - 2.0 * windows @ learned.T).min(axis=1) + (windows**2).sum(axis=1)
        return nearest

    return score

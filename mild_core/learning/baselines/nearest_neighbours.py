# SPDX-License-Identifier: Apache-2.0
"""The recorded windows nearest to what the human shows, and the mean of what the robot did then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.learning.baselines.kernels import INNER_FOLDS, STRIDE
from mild_core.learning.data.baseline import Baseline, by_interaction, window_matrices
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.folds import folds_of
from mild_core.learning.data.windows import Protocol, cut
from mild_core.shapes import FloatArray

NEIGHBOURS = (1, 3, 10, 30, 100)
"""What is tried, by folds over the trials that are learned from."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Recorded windows of one interaction (N, F), the answers to them (N, W J), and how many are asked."""

    observed: FloatArray
    controlled: FloatArray
    count: int

    def answers(self, questions: FloatArray, counts: Sequence[int]) -> list[FloatArray]:
        """(M, F) flattened windows -> for each count of neighbours (M, W J), their mean."""
        squares = (questions**2).sum(axis=1)[:, None] + (self.observed**2).sum(axis=1) - 2 * questions @ self.observed.T
        largest = min(max(counts), len(self.observed))
        nearest = np.argpartition(squares, largest - 1, axis=1)[:, :largest]
        order = np.argsort(np.take_along_axis(squares, nearest, axis=1), axis=1)
        nearest = np.take_along_axis(nearest, order, axis=1)
        return [self.controlled[nearest[:, :count]].mean(axis=1) for count in counts]


@dataclass(frozen=True, eq=False)
class NearestNeighbours:
    """Neighbours for each interaction."""

    protocol: Protocol
    neighbours: Mapping[str, Neighbours]

    def predict(self, demonstration: Demonstration) -> FloatArray:
        """Each window on its own (see `Predictor`)."""
        windows = cut(demonstration, self.protocol)
        mine = self.neighbours[demonstration.interaction]
        questions = windows.observed.reshape(len(windows.observed), -1)
        return mine.answers(questions, (mine.count,))[0].reshape(windows.controlled.shape)


def _chosen(demonstrations: Sequence[Demonstration], protocol: Protocol) -> Neighbours:
    """Learn one interaction with the count that serves left-out trials best."""
    errors = np.zeros(len(NEIGHBOURS))
    for fold in folds_of(demonstrations, min(INNER_FOLDS, len(demonstrations))):
        learned = Neighbours(*window_matrices(fold.learned, protocol, STRIDE), 1)
        questions, wanted = window_matrices(fold.held_out, protocol, STRIDE)
        errors += [((answer - wanted) ** 2).sum() for answer in learned.answers(questions, NEIGHBOURS)]
    return Neighbours(*window_matrices(demonstrations, protocol, STRIDE), NEIGHBOURS[int(errors.argmin())])


def fit(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> NearestNeighbours:
    """Learn each interaction alone (see `Fit`)."""
    groups = by_interaction(demonstrations).items()
    return NearestNeighbours(protocol, {name: _chosen(part, protocol) for name, part in groups})


NEAREST_NEIGHBOURS = Baseline("nearest_neighbours", "nearest neighbours", fit, seeded=False)

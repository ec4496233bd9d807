# SPDX-License-Identifier: Apache-2.0
"""Ridge regression in a feature space given by a kernel, its two knobs chosen by trials left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from mild_core.learning.data.baseline import window_matrices
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.folds import folds_of
from mild_core.learning.data.windows import Protocol, cut
from mild_core.shapes import FloatArray

INNER_FOLDS = 3
STRIDE = 3
"""One window in so many is learned from: they overlap, and the solution costs the cube of their number."""

Kernel = Callable[[FloatArray, FloatArray, float], FloatArray]
"""(N, F) and (M, F) standardised features, width -> (N, M)."""


@dataclass(frozen=True)
class SearchGrid:
    """What is tried: widths of the kernel and penalties relative to N = 1."""

    widths: tuple[float, ...]
    penalties: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class KernelMachine:
    """Regression of one interaction; holds the windows it learned from, so it is never shipped."""

    kernel: Kernel
    width: float
    mean: FloatArray
    scale: float
    anchors: FloatArray
    weights: FloatArray
    offset: FloatArray

    def answers(self, observed: FloatArray) -> FloatArray:
        """(N, F) flattened windows -> (N, W J) flattened answers [rad]."""
        features = (observed - self.mean) / self.scale
        answer: FloatArray = self.kernel(features, self.anchors, self.width) @ self.weights + self.offset
        return answer


def linear(left: FloatArray, right: FloatArray, width: float) -> FloatArray:
    """The plain inner product; makes ridge regression."""
    product_: FloatArray = left @ right.T
    return product_


def gaussian(left: FloatArray, right: FloatArray, width: float) -> FloatArray:
    """exp(-|x - y|^2 / (F width)) for F standardised features."""
    squares = (left**2).sum(axis=1)[:, None] + (right**2).sum(axis=1) - 2 * left @ right.T
    similarity: FloatArray = np.exp(-np.maximum(squares, 0.0) / (left.shape[1] * width))
    return similarity


def _machines(
    demonstrations: Sequence[Demonstration],
    protocol: Protocol,
    kernel: Kernel,
    width: float,
    penalties: Sequence[float],
) -> list[KernelMachine]:
    """One machine for each penalty; the eigenvectors of the kernel serve them all.

    Source: Saunders, Gammerman, Vovk, "Ridge regression learning algorithm in dual variables", ICML 1998.
    """
    observed, controlled = window_matrices(demonstrations, protocol, STRIDE)
    mean, offset = observed.mean(axis=0), controlled.mean(axis=0)
    # One scale for all columns: a hand that moves much shall count more than a shoulder that hardly moves.
    scale = float(observed.std())
    anchors = (observed - mean) / scale
    values, vectors = np.linalg.eigh(kernel(anchors, anchors, width))
    targets = vectors.T @ (controlled - offset)
    return [
        KernelMachine(kernel, width, mean, scale, anchors, vectors @ (targets / (values + penalty)[:, None]), offset)
        for penalty in penalties
    ]


def fit_chosen(
    demonstrations: Sequence[Demonstration], protocol: Protocol, kernel: Kernel, grid: SearchGrid
) -> KernelMachine:
    """Learn one interaction with the width and penalty that serve left-out trials best.

    Args:
        demonstrations: Trials of one interaction; at least two.
        protocol: How to cut them.
        kernel: Similarity of two windows.
        grid: What to try, by `INNER_FOLDS` folds over the given trials.
    """
    errors = np.zeros((len(grid.widths), len(grid.penalties)))
    for fold in folds_of(demonstrations, min(INNER_FOLDS, len(demonstrations))):
        windows = [cut(demonstration, protocol) for demonstration in fold.held_out]
        observed = np.concatenate([w.observed.reshape(len(w.observed), -1) for w in windows])
        controlled = np.concatenate([w.controlled.reshape(len(w.controlled), -1) for w in windows])
        for row, width in enumerate(grid.widths):
            for column, machine in enumerate(_machines(fold.learned, protocol, kernel, width, grid.penalties)):
                errors[row, column] += ((machine.answers(observed) - controlled) ** 2).sum()
    best = int(errors.argmin())
    width, penalty = list(product(grid.widths, grid.penalties))[best]
    return _machines(demonstrations, protocol, kernel, width, (penalty,))[0]

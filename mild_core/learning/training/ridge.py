# SPDX-License-Identifier: Apache-2.0
"""Ridge regression from sums over windows: those of a trial are taken once, whichever trials are learned from.

Source: Hoerl, Kennard, "Ridge regression", Technometrics 12 (1970).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.shapes import FloatArray

LEAST_SPREAD = 1e-6
"""A feature that differs by less does not differ."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Sums over windows: how many, of features (F,), of answers (A,), of products (F, F) and (F, A)."""

    count: int
    features: FloatArray
    answers: FloatArray
    squares: FloatArray
    products: FloatArray

    def __add__(self, other: Moments) -> Moments:
        return Moments(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))

    def covariance(self) -> FloatArray:
        """(F, F) of the features."""
        middle = self.features / self.count
        return self.squares / self.count - np.outer(middle, middle)

    def scale(self) -> FloatArray:
        """(F,) deviation of each feature, above zero."""
        return np.sqrt(np.maximum(self.covariance().diagonal(), 0.0)) + LEAST_SPREAD


@dataclass(frozen=True, eq=False)
class Linear:
    """Answers to features: weight (F, A), bias (A,)."""

    weight: FloatArray
    bias: FloatArray

    def answer(self, features: FloatArray) -> FloatArray:
        """(n, A) of features (n, F)."""
        found: FloatArray = features @ self.weight + self.bias
        return found


def moments_of(features: FloatArray, answers: FloatArray) -> Moments:
    """Of windows with features (n, F) and answers (n, A)."""
    sums = features.sum(axis=0), answers.sum(axis=0)
    return Moments(len(features), *sums, features.T @ features, features.T @ answers)


def total(parts: Sequence[Moments]) -> Moments:
    """Of all windows of at least one part."""
    return sum(parts[1:], parts[0])


def solve(moments: Moments, scale: FloatArray, penalty: float) -> Linear:
    """The regression on features divided by `scale` (F,)."""
    middle, answer = moments.features / moments.count, moments.answers / moments.count
    right = (moments.products / moments.count - np.outer(middle, answer)) / scale[:, None]
    square = moments.covariance() / np.outer(scale, scale) + penalty * np.eye(len(scale))
    weight = np.asarray(np.linalg.solve(square, right) / scale[:, None], dtype=np.float64)
    return Linear(weight, answer - middle @ weight)

# SPDX-License-Identifier: Apache-2.0
"""Whether the covariance that is published means what it says, and the scale that makes it so.

A region of a covariance that should hold 90 % of the true values must hold 90 % of them in trials that nothing was
learned from. What the priors spread and what cross-validation left over are both in it, and they overlap, so it comes
out too wide; errors of few long trials are no Gaussian, so its width cannot be derived from its parts. It is measured:
one scale per interaction, learned from the trials of all folds but one and tried on those of that one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2  # type: ignore[import-untyped]  # scipy brings no types

from mild_core.shapes import FloatArray

LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Shares of the true values that regions should hold, of a reliability curve."""

REGION = 0.9
AIM = 0.93
"""Share that the 90 % region holds of what its scale is learned from: a few trials fit themselves a little too well."""


@dataclass(frozen=True, eq=False)
class CalibrationSample:
    """How wrong predictions for a trial were, and how sure the model.

    Attributes:
        fold: In which the trial was held out.
        interaction: Its name.
        errors: (N, W, n) of the true values [rad or m].
        spread: (N, n, n) published covariance less the residual one.
    """

    fold: int
    interaction: str
    errors: FloatArray
    spread: FloatArray


@dataclass(frozen=True, eq=False)
class Reliability:
    """Shares of true values that lie within regions of `LEVELS`.

    Attributes:
        joint: (L,) all values of a frame at once, by Mahalanobis distance.
        marginal: (L,) each value by itself, mean over values.
    """

    joint: FloatArray
    marginal: FloatArray


@dataclass(frozen=True, eq=False)
class UncertaintyCalibration:
    """By interaction.

    Attributes:
        scale: What the published covariance is to be multiplied with, learned from all trials.
        before: Without a scale.
        after: With the scale that was learned from the other folds.
    """

    scale: Mapping[str, float]
    before: Mapping[str, Reliability]
    after: Mapping[str, Reliability]


@dataclass(frozen=True, eq=False)
class _Distances:
    """Squared errors of F frames in units of their variances: (F,) of all values at once, (F, n) of each."""

    joint: FloatArray
    marginal: FloatArray

    def scale(self) -> float:
        """That makes the 90 % region hold the share `AIM`."""
        return float(np.quantile(self.joint, AIM) / chi2.ppf(REGION, self.marginal.shape[1]))

    def divided(self, scale: float) -> _Distances:
        """With covariances multiplied by `scale`."""
        return _Distances(self.joint / scale, self.marginal / scale)

    def reliability(self) -> Reliability:
        """Shares within regions."""
        joint, single = chi2.ppf(LEVELS, self.marginal.shape[1]), chi2.ppf(LEVELS, 1)
        return Reliability(
            np.array([np.mean(self.joint <= bound) for bound in joint]),
            np.array([np.mean(self.marginal <= bound) for bound in single]),
        )


def calibrate(doubts: Sequence[CalibrationSample]) -> UncertaintyCalibration:
    """Learn the scales and see what they are worth.

    Args:
        doubts: Of the trials of all folds, each held out once; of every interaction in at least two folds.
    """
    scale, before, after = {}, {}, {}
    for name in dict.fromkeys(doubt.interaction for doubt in doubts):
        own = [doubt for doubt in doubts if doubt.interaction == name]
        scale[name] = _together(_distances(doubt, _residual(doubts)) for doubt in own).scale()
        raw, scaled = [], []
        for fold in sorted({doubt.fold for doubt in own}):
            residual = _residual([doubt for doubt in doubts if doubt.fold != fold])
            found = [(doubt.fold, _distances(doubt, residual)) for doubt in own]
            learned = _together(distances for other, distances in found if other != fold).scale()
            raw += [distances for other, distances in found if other == fold]
            scaled += [distances.divided(learned) for other, distances in found if other == fold]
        before[name], after[name] = _together(raw).reliability(), _together(scaled).reliability()
    return UncertaintyCalibration(scale, before, after)


def _residual(doubts: Sequence[CalibrationSample]) -> FloatArray:
    """(n, n) mean of error times error over frames and windows."""
    rows = np.concatenate([doubt.errors.reshape(-1, doubt.errors.shape[-1]) for doubt in doubts])
    residual: FloatArray = rows.T @ rows / len(rows)
    return residual


def _distances(doubt: CalibrationSample, residual: FloatArray) -> _Distances:
    covariances, errors = doubt.spread + residual, doubt.errors
    whitened = np.linalg.solve(np.linalg.cholesky(covariances), errors.transpose(0, 2, 1))
    marginal = errors**2 / np.diagonal(covariances, axis1=1, axis2=2)[:, None]
    return _Distances((whitened**2).sum(axis=1).ravel(), marginal.reshape(-1, marginal.shape[-1]))


def _together(parts: Iterable[_Distances]) -> _Distances:
    found = list(parts)
    return _Distances(np.concatenate([p.joint for p in found]), np.concatenate([p.marginal for p in found]))

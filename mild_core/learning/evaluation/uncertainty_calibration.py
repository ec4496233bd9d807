# SPDX-License-Identifier: Apache-2.0
"""Whether the covariance that is published means what it says, and the two numbers that make it so.

A region of a covariance that should hold 90 % of the true values must hold 90 % of them in trials that nothing was
learned from, and the one for 50 % half of them. What the priors spread and what cross-validation left over are both in
it, and they overlap, so it comes out too wide; and errors of few long trials are no Gaussian: most are small and some
are large. So they are taken to follow a Student t distribution, whose scale and degrees of freedom are measured for
each interaction: learned from the trials of all folds but one and tried on those of that one. Every trial counts alike.

Source: K. L. Lange et al., "Robust Statistical Modeling Using the t Distribution", JASA 1989; its Mahalanobis distances
follow an F distribution.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq  # type: ignore[import-untyped]  # scipy brings no types
from scipy.stats import chi2, f  # type: ignore[import-untyped]  # scipy brings no types

from mild_core.shapes import FloatArray

LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Shares of the true values that regions should hold, of a reliability curve."""

HALF, REGION = 0.5, 0.9
"""Shares that the two published regions hold."""

AIMS = (0.5, 0.9)
"""Shares of what it is learned from that the two regions are made to hold."""

FREEDOM = (1.0, 1000.0)
"""Least and most degrees of freedom: with so many, errors are Gaussian."""


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
        scale: What the published covariance is to be multiplied with, learned from all trials: its 90 % region, taken
            as that of a Gaussian, then holds 90 %.
        freedom: Degrees of freedom of the errors: few, where most are small and some are large.
        radii: Mahalanobis distances in that covariance within which half and 90 % of the true values lie.
        before: Without either, as of a Gaussian.
        after: With what was learned from the other folds.
    """

    scale: Mapping[str, float]
    freedom: Mapping[str, float]
    radii: Mapping[str, tuple[float, float]]
    before: Mapping[str, Reliability]
    after: Mapping[str, Reliability]


@dataclass(frozen=True, eq=False)
class _Spread:
    """How errors are distributed about a prediction, beside the covariance.

    Attributes:
        scale: See `UncertaintyCalibration.scale`.
        freedom: See `UncertaintyCalibration.freedom`.
    """

    scale: float
    freedom: float

    def radii(self, values: int) -> tuple[float, float]:
        """See `UncertaintyCalibration.radii`, for frames of so many values."""
        most = float(chi2.ppf(REGION, values))
        half = most * float(f.ppf(HALF, values, self.freedom) / f.ppf(REGION, values, self.freedom))
        return float(np.sqrt(half)), float(np.sqrt(most))


_GAUSSIAN = _Spread(1.0, FREEDOM[1])


@dataclass(frozen=True, eq=False)
class _Distances:
    """Squared errors of F frames in units of their variances: (F,) of all values at once, (F, n) of each.

    Attributes:
        joint: (F,).
        marginal: (F, n).
        weights: (F,) how much each counts; those of one trial together as much as those of any other.
    """

    joint: FloatArray
    marginal: FloatArray
    weights: FloatArray

    def spread(self) -> _Spread:
        """With which the two regions hold the shares `AIMS`."""
        values = self.marginal.shape[1]
        half, most = _quantiles(self.joint, self.weights, AIMS)
        wanted = half / most

        def beyond(freedom: float) -> float:
            return float(f.ppf(HALF, values, freedom) / f.ppf(REGION, values, freedom) - wanted)

        least, largest = FREEDOM
        freedom = least if beyond(least) > 0.0 else largest if beyond(largest) < 0.0 else brentq(beyond, least, largest)
        return _Spread(float(most / chi2.ppf(REGION, values)), float(freedom))

    def reliability(self, spread: _Spread) -> Reliability:
        """Shares within regions."""
        values, levels = self.marginal.shape[1], np.array(LEVELS)
        # The scale is that of the 90 % region of a Gaussian; the others lie from there as the distribution has them.
        unit = spread.scale * chi2.ppf(REGION, values) / f.ppf(REGION, values, spread.freedom)
        joint = unit * f.ppf(levels, values, spread.freedom)
        single = unit / values * f.ppf(levels, 1, spread.freedom)
        return Reliability(
            np.array([self.weights @ (self.joint <= bound) for bound in joint]),
            np.array([self.weights @ (self.marginal <= bound).mean(axis=1) for bound in single]),
        )


def _quantiles(values: FloatArray, weights: FloatArray, shares: Sequence[float]) -> FloatArray:
    """Of weighted values."""
    order = np.argsort(values)
    held = np.cumsum(weights[order])
    found: FloatArray = np.interp(np.array(shares) * held[-1], held, values[order])
    return found


def calibrate(doubts: Sequence[CalibrationSample]) -> UncertaintyCalibration:
    """Learn the scales and see what they are worth.

    Args:
        doubts: Of the trials of all folds, each held out once; of every interaction in at least two folds.
    """
    scale, freedom, radii, before, after = {}, {}, {}, {}, {}
    for name in dict.fromkeys(doubt.interaction for doubt in doubts):
        own = [doubt for doubt in doubts if doubt.interaction == name]
        whole = _together(_distances(doubt, _residual(doubts)) for doubt in own).spread()
        scale[name], freedom[name] = whole.scale, whole.freedom
        radii[name] = whole.radii(own[0].errors.shape[-1])
        raw, scaled = [], []
        for fold in sorted({doubt.fold for doubt in own}):
            residual = _residual([doubt for doubt in doubts if doubt.fold != fold])
            found = [(doubt.fold, _distances(doubt, residual)) for doubt in own]
            learned = _together(distances for other, distances in found if other != fold).spread()
            held_out = [distances for other, distances in found if other == fold]
            raw += [distances.reliability(_GAUSSIAN) for distances in held_out]
            scaled += [distances.reliability(learned) for distances in held_out]
        before[name], after[name] = _mean(raw), _mean(scaled)
    return UncertaintyCalibration(scale, freedom, radii, before, after)


def _mean(found: Sequence[Reliability]) -> Reliability:
    """Over trials, which count alike."""
    return Reliability(np.mean([one.joint for one in found], axis=0), np.mean([one.marginal for one in found], axis=0))


def _residual(doubts: Sequence[CalibrationSample]) -> FloatArray:
    """(n, n) mean of error times error over frames and windows."""
    rows = np.concatenate([doubt.errors.reshape(-1, doubt.errors.shape[-1]) for doubt in doubts])
    residual: FloatArray = rows.T @ rows / len(rows)
    return residual


def _distances(doubt: CalibrationSample, residual: FloatArray) -> _Distances:
    covariances, errors = doubt.spread + residual, doubt.errors
    whitened = np.linalg.solve(np.linalg.cholesky(covariances), errors.transpose(0, 2, 1))
    marginal = errors**2 / np.diagonal(covariances, axis1=1, axis2=2)[:, None]
    joint = (whitened**2).sum(axis=1).ravel()
    return _Distances(joint, marginal.reshape(-1, marginal.shape[-1]), np.full(len(joint), 1.0 / len(joint)))


def _together(parts: Iterable[_Distances]) -> _Distances:
    found = list(parts)
    return _Distances(
        np.concatenate([p.joint for p in found]),
        np.concatenate([p.marginal for p in found]),
        np.concatenate([p.weights for p in found]) / len(found),
    )

# SPDX-License-Identifier: Apache-2.0
"""The joint latents of demonstrations, prepared once for all iterations of a fit, and what Gaussians do with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.compiled import compiled, compiled_in_any_order
from mild_core.inference.gaussian import LOG_TWO_PI, Gaussian
from mild_core.shapes import FloatArray

MARGINAL = 1e-15
"""A component's share of a frame that is no more than the rounding of shares."""


FLATTEST, LEAST_VARIANCE = 1e-8, 1e-12
"""Least variance of a latent that an agent who stands still never leaves: as a share of the largest, and at all."""


@dataclass(frozen=True, eq=False)
class LatentFrames:
    """N frames of several demonstrations, one after the other.

    Attributes:
        lengths: Frames of each demonstration.
        times: (N,) from 0, the start of the demonstration, to 1, its end.
        centre: (Z,) mean of all frames.
        variance: (Z,) of all frames; never so small that a covariance could not be inverted.
        features: (N, Z (Z + 1) / 2 + Z + 1): the products z_a z_b with a <= b, then z, then 1, of the frames less
            their centre, so that squares do not cancel. Every density and every estimate is a product with them.
    """

    lengths: tuple[int, ...]
    times: FloatArray
    centre: FloatArray
    variance: FloatArray
    features: FloatArray


@compiled
def fill_features(centred: FloatArray, features: FloatArray) -> None:
    """Fill `features` as `LatentFrames` has them, from the latents less their centre (N, Z)."""
    frames, size = centred.shape
    for n in range(frames):
        column = 0
        for a in range(size):  # in the order of np.triu_indices
            for b in range(a, size):
                features[n, column] = centred[n, a] * centred[n, b]
                column += 1
        for a in range(size):
            features[n, column + a] = centred[n, a]
        features[n, column + size] = 1.0


def latent_frames(latents: Sequence[FloatArray]) -> LatentFrames:
    """Prepare demonstrations, each (T, Z).

    Raises:
        ValueError: When there is none, or a latent is not finite.
    """
    if not latents:
        raise ValueError("there are no demonstrations")
    everything = np.concatenate(list(latents)).astype(np.float64)
    if not np.isfinite(everything).all():
        raise ValueError("a latent of the demonstrations is not finite")
    centre = everything.mean(axis=0)
    centred = everything - centre
    size = everything.shape[1]
    features = np.empty((len(everything), size * (size + 1) // 2 + size + 1))
    fill_features(centred, features)
    times = np.concatenate([(np.arange(len(z)) + 0.5) / len(z) for z in latents])
    variance = centred.var(axis=0)
    variance = np.maximum(variance, max(FLATTEST * variance.max(), LEAST_VARIANCE))
    return LatentFrames(tuple(len(z) for z in latents), times, centre, variance, features)


def log_emissions(components: Gaussian, frames: LatentFrames) -> FloatArray:
    """(N, K) log-densities of all frames under all components.

    Raises:
        numpy.linalg.LinAlgError: When a covariance is not positive definite.
    """
    size = components.mean.shape[1]
    rows, columns = np.triu_indices(size)
    means = components.mean - frames.centre
    precision = np.linalg.inv(components.covariance)
    half_log_determinant = np.log(np.diagonal(np.linalg.cholesky(components.covariance), axis1=1, axis2=2)).sum(1)
    linear = (precision @ means[:, :, None])[:, :, 0]
    constant = -0.5 * (size * LOG_TWO_PI + (linear * means).sum(1)) - half_log_determinant
    quadratic = np.where(rows == columns, -0.5, -1.0) * precision[:, rows, columns]
    result: FloatArray = frames.features @ np.concatenate([quadratic, linear, constant[:, None]], axis=1).T
    return result


@compiled_in_any_order
def add_shares(responsibilities: FloatArray, features: FloatArray, sums: FloatArray) -> None:
    """Add the transposed `responsibilities` (N, K) times `features` (N, F) to `sums` (K, F).

    Most frames belong to one component: to pass over the others is twice as fast as the matrix product.
    """
    for n in range(features.shape[0]):
        for j in range(sums.shape[0]):
            if responsibilities[n, j] > MARGINAL:
                for column in range(features.shape[1]):
                    sums[j, column] += responsibilities[n, j] * features[n, column]


def estimate_components(
    previous: Gaussian | None, responsibilities: FloatArray, frames: LatentFrames, fraction: float
) -> Gaussian:
    """The M-step of K Gaussians.

    Args:
        previous: (K,) components, kept where nothing is left to estimate one from.
        responsibilities: (N, K).
        frames: The latents.
        fraction: Share of the latents' variance added to the diagonals of the covariances.

    Source: ours: regularised by a fraction of the latent variance, not by a constant.
    """
    size = len(frames.centre)
    rows, columns = np.triu_indices(size)
    sums = np.zeros((responsibilities.shape[1], frames.features.shape[1]))
    add_shares(responsibilities, frames.features, sums)
    occupied = sums[:, -1] > 1e-6
    moments = sums / np.where(occupied, sums[:, -1], 1.0)[:, None]
    means = moments[:, len(rows) : len(rows) + size]
    covariances = np.empty((len(means), size, size))
    covariances[:, rows, columns] = moments[:, : len(rows)] - means[:, rows] * means[:, columns]
    covariances[:, columns, rows] = covariances[:, rows, columns]
    covariances += np.diag(fraction * frames.variance)
    means = means + frames.centre
    if previous is not None:
        means = np.where(occupied[:, None], means, previous.mean)
        covariances = np.where(occupied[:, None, None], covariances, previous.covariance)
    return Gaussian(means, covariances)

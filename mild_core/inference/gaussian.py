# SPDX-License-Identifier: Apache-2.0
"""Gaussians as values, and the few things one does with them. Every function takes batches in the leading axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mild_core.shapes import FloatArray, read_only

LOG_TWO_PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, eq=False)
class Gaussian:
    """One normal distribution, or a batch of them.

    Attributes:
        mean: (..., Z).
        covariance: (..., Z, Z), symmetric and positive definite (or zero, for a point).

    Raises:
        ValueError: When the two shapes do not belong together.
    """

    mean: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "mean", read_only(self.mean))
        object.__setattr__(self, "covariance", read_only(self.covariance))
        if self.mean.ndim < 1 or self.covariance.shape != (*self.mean.shape, self.mean.shape[-1]):
            raise ValueError(f"mean {self.mean.shape} and covariance {self.covariance.shape} do not belong together")


def log_density(gaussian: Gaussian, values: FloatArray) -> FloatArray:
    """Logarithm of the density at `values`.

    Args:
        gaussian: Batch shape (...).
        values: (..., Z), broadcast against the batch.

    Returns:
        (...): log N(values; mean, covariance).

    Raises:
        numpy.linalg.LinAlgError: When a covariance is not positive definite.
    """
    factor = np.linalg.cholesky(gaussian.covariance)
    difference = values - gaussian.mean
    whitened = np.linalg.solve(factor, difference[..., None])[..., 0]
    half_log_determinant = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(-1)
    size = gaussian.mean.shape[-1]
    result: FloatArray = -0.5 * (size * LOG_TWO_PI + (whitened**2).sum(-1)) - half_log_determinant
    return result


def condition(gaussian: Gaussian, observed: FloatArray, observed_covariance: FloatArray | float = 0.0) -> Gaussian:
    """The remaining dimensions given the first Q.

    Args:
        gaussian: Over Z dimensions, batch shape (...).
        observed: (..., Q) the first Q dimensions, Q < Z.
        observed_covariance: (..., Q, Q) of the observation itself, added to the observed block; 0 when exact.

    Returns:
        Over Z - Q dimensions.

    Source: eq. 8 of MILD with the sign corrected: (z - mean), where the paper prints (mean - z). The covariance
        of the observation enters as in `mild_core/README.md`.
    """
    split = observed.shape[-1]
    observed_block = gaussian.covariance[..., :split, :split] + observed_covariance
    cross_block = gaussian.covariance[..., split:, :split]
    gain = np.swapaxes(np.linalg.solve(observed_block, np.swapaxes(cross_block, -1, -2)), -1, -2)
    difference = observed - gaussian.mean[..., :split]
    mean = gaussian.mean[..., split:] + (gain @ difference[..., None])[..., 0]
    covariance = gaussian.covariance[..., split:, split:] - gain @ np.swapaxes(cross_block, -1, -2)
    covariance = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
    return Gaussian(mean, np.broadcast_to(covariance, (*mean.shape, mean.shape[-1])))


def kl_divergence(first: Gaussian, second: Gaussian) -> FloatArray:
    """KL(first || second) in nats, for full covariances.

    Returns:
        (...): at least zero.

    Source: the regulariser of eq. 3 of MILD, in closed form.
    """
    inverse_first = np.linalg.solve(second.covariance, first.covariance)
    difference = second.mean - first.mean
    distance = (difference * np.linalg.solve(second.covariance, difference[..., None])[..., 0]).sum(-1)
    trace = np.trace(inverse_first, axis1=-2, axis2=-1)
    log_determinants = np.linalg.slogdet(second.covariance)[1] - np.linalg.slogdet(first.covariance)[1]
    result: FloatArray = 0.5 * (trace + distance - first.mean.shape[-1] + log_determinants)
    return result


def mixture_moments(weights: FloatArray, components: Gaussian) -> Gaussian:
    """Mean and covariance of a mixture.

    Args:
        weights: (..., K), sums to one.
        components: Batch shape (..., K).

    Returns:
        Batch shape (...): the one Gaussian with the mixture's first two moments.

    Source: the law of total variance, V = sum h (V_j + m_j m_j^T) - m m^T, written without the cancellation.
    """
    mean = (weights[..., None] * components.mean).sum(-2)
    spread = components.mean - mean[..., None, :]
    within = components.covariance + spread[..., :, None] * spread[..., None, :]
    return Gaussian(mean, (weights[..., None, None] * within).sum(-3))

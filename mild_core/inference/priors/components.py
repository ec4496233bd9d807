# SPDX-License-Identifier: Apache-2.0
"""What every prior does with its K Gaussians: densities of frames, conditioning, and their re-estimation."""

from __future__ import annotations

import numpy as np

from mild_core.inference.compiled import compiled
from mild_core.inference.gaussian import LOG_TWO_PI, Gaussian
from mild_core.shapes import FloatArray


@compiled
def factorise(matrix: FloatArray, size: int) -> float:
    """Cholesky factor of the leading block, in place in the lower triangle.

    Returns:
        The logarithm of the factor's determinant; NaN when the block is not positive definite.
    """
    log_determinant = 0.0
    for column in range(size):
        for row in range(column, size):
            value = matrix[row, column]
            for k in range(column):
                value -= matrix[row, k] * matrix[column, k]
            if row == column:
                matrix[row, row] = np.sqrt(value)
                log_determinant += np.log(matrix[row, row])
            else:
                matrix[row, column] = value / matrix[column, column]
    return log_determinant


@compiled
def observe_frame(
    means: FloatArray,
    covariances: FloatArray,
    observed: FloatArray,
    observed_covariance: FloatArray,
    log_emission: FloatArray,
    conditioned_means: FloatArray,
    conditioned_covariances: FloatArray,
) -> None:
    """Explain one observed latent by each component and say what each then expects of the controlled one.

    Args:
        means: (K, Z), observed dimensions first.
        covariances: (K, Z, Z).
        observed: (Q,) posterior mean of the encoder.
        observed_covariance: (Q, Q) its covariance: it widens the observed block.
        log_emission: (K,) filled with log N(observed; mean, covariance) of the observed block.
        conditioned_means: (K, Z - Q) filled.
        conditioned_covariances: (K, Z - Q, Z - Q) filled; an array of length 0 leaves them out.

    Source: eq. 8 with the sign corrected, METHOD section 2. One Cholesky factor serves density and conditioning.
    """
    components, total = means.shape
    size = observed.shape[0]
    block = np.empty((total, size))
    whitened = np.empty(size)
    for j in range(components):
        for row in range(total):
            for column in range(size):
                block[row, column] = covariances[j, row, column]
        for row in range(size):
            for column in range(size):
                block[row, column] += observed_covariance[row, column]
        log_determinant = factorise(block, size)
        distance = 0.0
        for row in range(size):
            value = observed[row] - means[j, row]
            for k in range(row):
                value -= block[row, k] * whitened[k]
            whitened[row] = value / block[row, row]
            distance += whitened[row] * whitened[row]
        log_emission[j] = -0.5 * (size * LOG_TWO_PI + distance) - log_determinant
        for row in range(size, total):
            for column in range(size):
                value = block[row, column]
                for k in range(column):
                    value -= block[row, k] * block[column, k]
                block[row, column] = value / block[column, column]
            value = means[j, row]
            for k in range(size):
                value += block[row, k] * whitened[k]
            conditioned_means[j, row - size] = value
        if conditioned_covariances.shape[0] > 0:
            for row in range(size, total):
                for column in range(size, total):
                    value = covariances[j, row, column]
                    for k in range(size):
                        value -= block[row, k] * block[column, k]
                    conditioned_covariances[j, row - size, column - size] = value


@compiled
def observe_frames(
    means: FloatArray,
    covariances: FloatArray,
    observed: FloatArray,
    observed_covariances: FloatArray,
    log_emissions: FloatArray,
    conditioned_means: FloatArray,
) -> None:
    """`observe_frame` for (T, Q) latents with (T, Q, Q) covariances, without conditioned covariances."""
    nothing = np.empty((0, 0, 0))
    for t in range(observed.shape[0]):
        observe_frame(
            means, covariances, observed[t], observed_covariances[t], log_emissions[t], conditioned_means[t], nothing
        )


def quadratic_features(latents: FloatArray) -> FloatArray:
    """(N, Z (Z + 1) / 2 + Z + 1): the products z_a z_b with a <= b, then z, then 1.

    Every log-density and every re-estimation of a Gaussian is one matrix product on these.
    """
    rows, columns = np.triu_indices(latents.shape[1])
    return np.concatenate([latents[:, rows] * latents[:, columns], latents, np.ones((len(latents), 1))], axis=1)


def log_emissions(components: Gaussian, features: FloatArray) -> FloatArray:
    """(N, K) log-densities of all frames under all components, from `quadratic_features` of the latents.

    Raises:
        numpy.linalg.LinAlgError: When a covariance is not positive definite.
    """
    size = components.mean.shape[1]
    rows, columns = np.triu_indices(size)
    precision = np.linalg.inv(components.covariance)
    half_log_determinant = np.log(np.diagonal(np.linalg.cholesky(components.covariance), axis1=1, axis2=2)).sum(1)
    linear = (precision @ components.mean[:, :, None])[:, :, 0]
    constant = -0.5 * (size * LOG_TWO_PI + (linear * components.mean).sum(1)) - half_log_determinant
    quadratic = np.where(rows == columns, -0.5, -1.0) * precision[:, rows, columns]
    result: FloatArray = features @ np.concatenate([quadratic, linear, constant[:, None]], axis=1).T
    return result


def estimate_components(
    previous: Gaussian, responsibilities: FloatArray, features: FloatArray, widening: FloatArray
) -> Gaussian:
    """The M-step of K Gaussians.

    Args:
        previous: (K,) components, kept where nothing is left to estimate one from.
        responsibilities: (N, K).
        features: (N, F) `quadratic_features` of latents that are centred, so that little is lost by cancellation.
        widening: (Z,) added to the diagonals of the covariances.

    Source: METHOD section 2: regularised by a fraction of the latent variance, not by a constant.
    """
    size = previous.mean.shape[1]
    rows, columns = np.triu_indices(size)
    sums = responsibilities.T @ features
    occupied = sums[:, -1] > 1e-6
    moments = sums / np.where(occupied, sums[:, -1], 1.0)[:, None]
    means = moments[:, len(rows) : len(rows) + size]
    covariances = np.empty((len(means), size, size))
    covariances[:, rows, columns] = moments[:, : len(rows)] - means[:, rows] * means[:, columns]
    covariances[:, columns, rows] = covariances[:, rows, columns]
    covariances += np.diag(widening)
    return Gaussian(
        np.where(occupied[:, None], means, previous.mean),
        np.where(occupied[:, None, None], covariances, previous.covariance),
    )

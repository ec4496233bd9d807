# SPDX-License-Identifier: Apache-2.0
"""What every prior does with its K Gaussians at each frame: densities of the observed latent, and conditioning."""

from __future__ import annotations

import numpy as np

from mild_core.inference.compiled import compiled
from mild_core.inference.gaussian import LOG_TWO_PI
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
def whiten(block: FloatArray, observed: FloatArray, mean: FloatArray, whitened: FloatArray) -> float:
    """Fill `whitened` (Q,) with L^-1 (observed - mean), where L is in the lower triangle of `block`.

    Returns:
        Its squared length: the squared Mahalanobis distance.
    """
    distance = 0.0
    for row in range(observed.shape[0]):
        value = observed[row] - mean[row]
        for k in range(row):
            value -= block[row, k] * whitened[k]
        whitened[row] = value / block[row, row]
        distance += whitened[row] * whitened[row]
    return distance


@compiled
def whiten_rows(block: FloatArray, size: int) -> None:
    """Replace the rows below the factor L (size, size) by themselves times L^-T: what conditioning takes twice."""
    for row in range(size, block.shape[0]):
        for column in range(size):
            value = block[row, column]
            for k in range(column):
                value -= block[row, k] * block[column, k]
            block[row, column] = value / block[column, column]


@compiled
def observe_frame(
    components: tuple[FloatArray, FloatArray],
    observed: tuple[FloatArray, FloatArray],
    log_emission: FloatArray,
    conditioned_means: FloatArray,
    conditioned_covariances: FloatArray,
) -> None:
    """Explain one observed latent by each component and say what each then expects of the controlled one.

    Args:
        components: Means (K, Z), observed dimensions first, and covariances (K, Z, Z).
        observed: Posterior mean (Q,) of the encoder and its covariance (Q, Q), which widens the observed block.
        log_emission: (K,) filled with log N(observed; mean, covariance) of the observed block.
        conditioned_means: (K, Z - Q) filled.
        conditioned_covariances: (K, Z - Q, Z - Q) filled; an array of length 0 leaves them out.

    Source: eq. 8 with the sign corrected, METHOD section 2. One Cholesky factor serves density and conditioning.
    """
    means, covariances = components
    latent, widening = observed
    count, total = means.shape
    size = latent.shape[0]
    block, whitened = np.empty((total, size)), np.empty(size)
    for j in range(count):
        block[:] = covariances[j, :, :size]
        block[:size] += widening
        log_determinant = factorise(block, size)
        distance = whiten(block, latent, means[j], whitened)
        log_emission[j] = -0.5 * (size * LOG_TWO_PI + distance) - log_determinant
        whiten_rows(block, size)
        for row in range(size, total):
            value = means[j, row]
            for k in range(size):
                value += block[row, k] * whitened[k]
            conditioned_means[j, row - size] = value
        if conditioned_covariances.shape[0] == 0:
            continue
        for row in range(size, total):
            for column in range(size, total):
                value = covariances[j, row, column]
                for k in range(size):
                    value -= block[row, k] * block[column, k]
                conditioned_covariances[j, row - size, column - size] = value


@compiled
def observe_frames(
    components: tuple[FloatArray, FloatArray],
    observed: tuple[FloatArray, FloatArray],
    log_emissions: FloatArray,
    conditioned_means: FloatArray,
) -> None:
    """`observe_frame` for (T, Q) latents with (T, Q, Q) covariances, without conditioned covariances."""
    latents, widenings = observed
    nothing = np.empty((0, 0, 0))
    for t in range(latents.shape[0]):
        observe_frame(components, (latents[t], widenings[t]), log_emissions[t], conditioned_means[t], nothing)

# SPDX-License-Identifier: Apache-2.0
"""The small sums of a step, compiled: posterior of the encoder, mixture of components, spread of joint angles."""

from __future__ import annotations

import numpy as np

from mild_core.compiled import compiled
from mild_core.inference.networks import Float32Array
from mild_core.shapes import FloatArray

DIAGONAL_FLOOR = 1e-4
"""Least standard deviation along a row of the encoder's factor."""

NEGLIGIBLE_WEIGHT = 1e-4
"""Components believed in less than this add nothing visible to a covariance."""


@compiled
def posterior(outputs: Float32Array, size: int) -> tuple[FloatArray, FloatArray]:
    """Mean (Q,) and covariance (Q, Q) of the latent from the encoder's Q + Q (Q + 1) / 2 outputs.

    After the mean come the rows of the lower triangle L; the covariance is L L^T, with 2 |l| + floor on L's diagonal.

    Source: section III-A of MILD.
    """
    mean, factor = np.empty(size), np.zeros((size, size))
    place = size
    for row in range(size):
        mean[row] = outputs[row]
        for column in range(row + 1):
            factor[row, column] = outputs[place]
            place += 1
        factor[row, row] = 2.0 * abs(factor[row, row]) + DIAGONAL_FLOOR
    covariance = np.empty((size, size))
    for row in range(size):
        for column in range(row + 1):
            value = 0.0
            for k in range(column + 1):
                value += factor[row, k] * factor[column, k]
            covariance[row, column] = value
            covariance[column, row] = value
    return mean, covariance


@compiled
def classify(logits: Float32Array) -> FloatArray:
    """(P,) log-probabilities from a recogniser's logits (P,)."""
    log_probabilities = np.empty(logits.shape[0])
    largest, total = logits.max(), 0.0
    for p in range(logits.shape[0]):
        total += np.exp(logits[p] - largest)
    for p in range(logits.shape[0]):
        log_probabilities[p] = logits[p] - largest - np.log(total)
    return log_probabilities


@compiled
def propagate_covariance(
    weights: FloatArray,
    components: tuple[FloatArray, FloatArray],
    centre: FloatArray,
    operators: FloatArray,
    covariance: FloatArray,
) -> None:
    """Add to `covariance` (N, N) what the components' own and mutual spread means for the decoded values.

    Args:
        weights: (K,).
        components: Means (K, C) and covariances (K, C, C) of the controlled latent.
        centre: (C,) what the spread is taken around.
        operators: (K, N N, C C) for each component: mean over the window of J (x) J, J the decoder's Jacobian there.
        covariance: (N, N), changed in place.

    Source: J V J^T with V of the mixture, linearised at each component (first-order propagation).
    """
    means, covariances = components
    size, controlled = covariance.shape[0], centre.shape[0]
    second = np.empty(controlled * controlled)
    for j in range(weights.shape[0]):
        if weights[j] < NEGLIGIBLE_WEIGHT:
            continue
        for a in range(controlled):
            for b in range(controlled):
                moment = covariances[j, a, b] + (means[j, a] - centre[a]) * (means[j, b] - centre[b])
                second[a * controlled + b] = weights[j] * moment
        for a in range(size):
            for b in range(size):
                total = 0.0
                for k in range(second.shape[0]):
                    total += operators[j, a * size + b, k] * second[k]
                covariance[a, b] += total

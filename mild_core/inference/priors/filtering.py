# SPDX-License-Identifier: Apache-2.0
"""The filter of a prior, compiled: densities of a frame, conditioning, and the explicit-duration recursion.

The state of a chain at a frame is (j, r): component j, and r frames left in it, this one included. It is an ordinary
Markov chain on K * D states whose transitions are nearly all trivial (r becomes r - 1), so a frame costs
K * D + K * K. The end of a recording asks nothing of r: the last segment is censored on the right by itself.

Source: S.-Z. Yu, "Hidden semi-Markov models", Artificial Intelligence 174 (2010).
"""

from __future__ import annotations

import numpy as np

from mild_core.compiled import compiled
from mild_core.inference.gaussian import LOG_TWO_PI
from mild_core.shapes import FloatArray

UNDERFLOW = -700.0
"""Below this logarithm a density is zero in double precision: no component can explain the frame."""

UNREACHABLE = 1e-250
"""A component with less mass than this before a frame cannot be the one behind it."""


@compiled
def factorise(matrix: FloatArray, size: int, reciprocals: FloatArray) -> float:
    """Cholesky factor of the leading block, in place in the lower triangle, and `reciprocals` (Q,) of its diagonal.

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
                reciprocals[row] = 1.0 / matrix[row, row]
                log_determinant += np.log(matrix[row, row])
            else:
                matrix[row, column] = value * reciprocals[column]
    return log_determinant


@compiled
def whiten(
    block: FloatArray, reciprocals: FloatArray, observed: FloatArray, mean: FloatArray, whitened: FloatArray
) -> float:
    """Fill `whitened` (Q,) with L^-1 (observed - mean), where L is in the lower triangle of `block`.

    Returns:
        Its squared length: the squared Mahalanobis distance.
    """
    distance = 0.0
    for row in range(observed.shape[0]):
        value = observed[row] - mean[row]
        for k in range(row):
            value -= block[row, k] * whitened[k]
        whitened[row] = value * reciprocals[row]
        distance += whitened[row] * whitened[row]
    return distance


@compiled
def whiten_rows(block: FloatArray, reciprocals: FloatArray) -> None:
    """Replace the rows below the factor L (Q, Q) by themselves times L^-T: what conditioning takes twice."""
    size = reciprocals.shape[0]
    for row in range(size, block.shape[0]):
        for column in range(size):
            value = block[row, column]
            for k in range(column):
                value -= block[row, k] * block[column, k]
            block[row, column] = value * reciprocals[column]


@compiled
def explain_component(
    means: FloatArray,
    covariances: FloatArray,
    observed: tuple[FloatArray, FloatArray],
    block: FloatArray,
    whitened: FloatArray,
    reciprocals: FloatArray,
) -> tuple[float, float]:
    """Explain one observed latent by one component: one Cholesky factor serves density and conditioning.

    Args:
        means: (Z,) observed dimensions first.
        covariances: (Z, Z).
        observed: Posterior mean (Q,) of the encoder and its covariance (Q, Q), which widens the observed block.
        block: (Z, Q) filled: above, in its lower triangle, the factor L of the widened block; below it the
            covariance of the controlled dimensions with the observed ones, times L^-T.
        whitened: (Q,) filled with L^-1 (observed - mean).
        reciprocals: (Q,) filled with those of L's diagonal.

    Returns:
        log N(observed; mean, covariance) of the observed block, and the squared Mahalanobis distance in it.
    """
    latent, widening = observed
    size = latent.shape[0]
    for row in range(means.shape[0]):
        for column in range(size):
            block[row, column] = covariances[row, column] + (widening[row, column] if row < size else 0.0)
    log_determinant = factorise(block, size, reciprocals)
    distance = whiten(block, reciprocals, latent, means, whitened)
    whiten_rows(block, reciprocals)
    return -0.5 * (size * LOG_TWO_PI + distance) - log_determinant, distance


@compiled
def observe_frame(
    components: tuple[FloatArray, FloatArray],
    observed: tuple[FloatArray, FloatArray],
    log_emission: FloatArray,
    distances: FloatArray,
    conditioned_means: FloatArray,
    conditioned_covariances: FloatArray,
) -> None:
    """Explain one observed latent by each component and say what each then expects of the controlled one.

    Args:
        components: Means (K, Z), observed dimensions first, and covariances (K, Z, Z).
        observed: Posterior mean (Q,) of the encoder and its covariance (Q, Q), which widens the observed block.
        log_emission: (K,) filled with log N(observed; mean, covariance) of the observed block.
        distances: (K,) filled with the Mahalanobis distances in it.
        conditioned_means: (K, Z - Q) filled.
        conditioned_covariances: (K, Z - Q, Z - Q) filled; an array of length 0 leaves them out.

    Source: eq. 8 of MILD with the sign corrected, see `mild_core/README.md`.
    """
    means, covariances = components
    count, total = means.shape
    size = observed[0].shape[0]
    block, whitened, reciprocals = np.empty((total, size)), np.empty(size), np.empty(size)
    for j in range(count):
        log_emission[j], distance = explain_component(means[j], covariances[j], observed, block, whitened, reciprocals)
        distances[j] = np.sqrt(distance)
        for row in range(size, total):
            value = means[j, row]
            for k in range(size):
                value += block[row, k] * whitened[k]
            conditioned_means[j, row - size] = value
        if conditioned_covariances.shape[0] == 0:
            continue
        for row in range(size, total):
            for column in range(size, row + 1):
                value = covariances[j, row, column]
                for k in range(size):
                    value -= block[row, k] * block[column, k]
                conditioned_covariances[j, row - size, column - size] = value
                conditioned_covariances[j, column - size, row - size] = value


@compiled
def enter_components(
    memory: FloatArray, scale: FloatArray, first: bool, chain: tuple[FloatArray, FloatArray], entering: FloatArray
) -> None:
    """Fill `entering` (K,): the probability that a segment of each component starts at the next frame."""
    initial, transitions = chain
    for j in range(initial.shape[0]):
        total = 0.0
        for i in range(initial.shape[0]):
            total += scale[i] * memory[i, 0] * transitions[i, j]
        entering[j] = initial[j] if first else total


@compiled
def shift_memory(
    memory: FloatArray, scale: FloatArray, durations: FloatArray, entering: FloatArray, mass: FloatArray
) -> None:
    """Let one frame pass, in place, and fill `mass` (K,) with the sums over the remaining time.

    `memory[j, r] = scale[j] * memory[j, r + 1] + durations[j, r] * entering[j]`, where `scale` (K,) is what the
    frame before is still owed. Four partial sums in a fixed order: the compiler may not reorder additions itself.
    """
    components, longest = durations.shape
    whole = longest - longest % 4
    for j in range(components):
        row, duration, share, factor = memory[j], durations[j], entering[j], scale[j]
        for r in range(longest - 1):
            row[r] = factor * row[r + 1] + duration[r] * share
        row[longest - 1] = duration[longest - 1] * share
        s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
        for r in range(0, whole, 4):
            s0 += row[r]
            s1 += row[r + 1]
            s2 += row[r + 2]
            s3 += row[r + 3]
        for r in range(whole, longest):
            s0 += row[r]
        mass[j] = (s0 + s1) + (s2 + s3)


@compiled
def weigh_frame(log_emission: FloatArray, mass: FloatArray, emission: FloatArray) -> tuple[float, float]:
    """Fill `emission` (K,) with densities divided by the largest reachable one.

    Returns:
        The logarithm of that largest density, and sum_j mass[j] * emission[j].
    """
    largest = -np.inf
    for j in range(mass.shape[0]):
        if mass[j] > UNREACHABLE and log_emission[j] > largest:
            largest = log_emission[j]
    total = 0.0
    for j in range(mass.shape[0]):
        # An unreachable component may be far likelier than every reachable one: its factor would overflow.
        emission[j] = np.exp(log_emission[j] - largest) if mass[j] > UNREACHABLE else 0.0
        total += mass[j] * emission[j]
    return largest, total


@compiled
def filter_frames(
    log_emissions: FloatArray,
    memory: FloatArray,
    first: bool,
    chain: tuple[FloatArray, FloatArray, FloatArray],
    lowest: float,
    weights: FloatArray,
    log_likelihoods: FloatArray,
    events: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Run the filter over frames.

    Args:
        log_emissions: (T, K) log densities of the frames.
        memory: (K, D) belief over component and remaining time, changed in place; zero before the first frame.
        first: Whether the first frame is the first of all, so that the chain starts there.
        chain: Start probabilities (K,), transitions (K, K), durations (K, D); column 0 is a duration of one frame.
        lowest: Online `UNDERFLOW`: a frame less likely under every reachable component is passed over as
            unobserved, if its log-likelihood is at most this. Minus infinity passes nothing over.
        weights: (T, K) filled with the belief after each frame.
        log_likelihoods: (T,) filled with log p(frame | frames before).
        events: Three (T, K) filled for the backward pass: probability that a segment starts at the frame, before it
            is seen; that it ends there, after; and the densities divided by the frame's total.
    """
    initial, transitions, durations = chain
    entering, leaving, emissions = events
    components, longest = durations.shape
    mass, scale = np.empty(components), np.empty(components)
    for j in range(components):
        scale[j] = 1.0
    for t in range(log_emissions.shape[0]):
        enter_components(memory, scale, first and t == 0, (initial, transitions), entering[t])
        shift_memory(memory, scale, durations, entering[t], mass)
        largest, total = weigh_frame(log_emissions[t], mass, emissions[t])
        log_likelihoods[t] = largest + np.log(total)
        if not largest > lowest:
            log_likelihoods[t] = min(largest, lowest)
            total = 0.0
            for j in range(components):
                emissions[t, j] = 1.0
                total += mass[j]
        for j in range(components):
            emissions[t, j] /= total
            scale[j] = emissions[t, j]
            weights[t, j] = mass[j] * scale[j]
            leaving[t, j] = memory[j, 0] * scale[j]
    for j in range(components):
        for r in range(longest):
            memory[j, r] *= scale[j]

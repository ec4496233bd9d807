# SPDX-License-Identifier: Apache-2.0
"""The explicit-duration recursions over (component, remaining time), compiled.

The state of the chain at a frame is (j, r): component j, and r frames left in it, this one included. It is an
ordinary Markov chain on K * D states whose transitions are nearly all trivial (r becomes r - 1), so a frame costs
K * D + K * K. The end of a recording asks nothing of r: the last segment is censored on the right by itself.

Source: METHOD section 2; S.-Z. Yu, "Hidden semi-Markov models", Artificial Intelligence 174 (2010).
"""

from __future__ import annotations

import numpy as np

from mild_core.inference.compiled import compiled
from mild_core.shapes import FloatArray

UNDERFLOW = -700.0
"""Below this logarithm a density is zero in double precision: no component can explain the frame."""

UNREACHABLE = 1e-250
"""A component with less mass than this before a frame cannot be the one behind it."""

CEILING = 1e250
"""Bound of the backward values. Only states of no forward mass come near it; beyond it they would turn into NaN."""


@compiled
def predict_frame(
    memory: FloatArray, first: bool, initial: FloatArray, transitions: FloatArray, entering: FloatArray
) -> None:
    """Fill `entering` (K,): the probability that a segment of each component starts at the next frame."""
    components = transitions.shape[0]
    for j in range(components):
        if first:
            entering[j] = initial[j]
        else:
            total = 0.0
            for i in range(components):
                total += memory[i, 0] * transitions[i, j]
            entering[j] = total


@compiled
def shift_memory(memory: FloatArray, durations: FloatArray, entering: FloatArray, after: FloatArray) -> None:
    """Let one frame pass: `after[j, r] = memory[j, r + 1] + durations[j, r] * entering[j]`; may work in place."""
    components, longest = durations.shape
    for j in range(components):
        share = entering[j]
        for r in range(longest - 1):
            after[j, r] = memory[j, r + 1] + durations[j, r] * share
        after[j, longest - 1] = durations[j, longest - 1] * share


@compiled
def sum_rows(matrix: FloatArray, sums: FloatArray) -> None:
    """Fill `sums` (K,). Four partial sums in a fixed order: the compiler may not reorder additions by itself."""
    rows, columns = matrix.shape
    whole = columns - columns % 4
    for j in range(rows):
        s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
        for r in range(0, whole, 4):
            s0 += matrix[j, r]
            s1 += matrix[j, r + 1]
            s2 += matrix[j, r + 2]
            s3 += matrix[j, r + 3]
        for r in range(whole, columns):
            s0 += matrix[j, r]
        sums[j] = (s0 + s1) + (s2 + s3)


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
    initial: FloatArray,
    transitions: FloatArray,
    durations: FloatArray,
    weights: FloatArray,
    log_likelihoods: FloatArray,
) -> None:
    """Run the online filter over frames; `memory` (K, D) holds the state before the first and after the last.

    Args:
        log_emissions: (T, K) log densities of the frames.
        memory: (K, D), changed in place.
        first: Whether the first frame is the first of all, so that the chain starts there.
        initial: (K,) start probabilities.
        transitions: (K, K), rows sum to one.
        durations: (K, D), rows sum to one; column 0 is a duration of one frame.
        weights: (T, K) filled with the belief after each frame.
        log_likelihoods: (T,) filled with log p(frame | frames before). A frame that no component can explain
            (every density underflows) is passed over as unobserved, and its log-likelihood, far below
            `UNDERFLOW`, tells so.
    """
    components = transitions.shape[0]
    entering = np.empty(components)
    emission = np.empty(components)
    mass = np.empty(components)
    for t in range(log_emissions.shape[0]):
        predict_frame(memory, first and t == 0, initial, transitions, entering)
        if first and t == 0:
            memory[:] = 0.0
        shift_memory(memory, durations, entering, memory)
        sum_rows(memory, mass)
        largest, total = weigh_frame(log_emissions[t], mass, emission)
        if not largest > UNDERFLOW:
            log_likelihoods[t] = largest
            emission[:] = 1.0
            total = mass.sum()
        else:
            log_likelihoods[t] = largest + np.log(total)
        for j in range(components):
            factor = emission[j] / total
            weights[t, j] = mass[j] * factor
            for r in range(memory.shape[1]):
                memory[j, r] *= factor


@compiled
def forward_frames(
    log_emissions: FloatArray,
    initial: FloatArray,
    transitions: FloatArray,
    durations: FloatArray,
    entering: FloatArray,
    leaving: FloatArray,
    emissions: FloatArray,
) -> float:
    """The forward pass over one demonstration, scaled frame by frame.

    Fills, for the backward pass, `entering` (T, K): a segment starts here, before the frame is seen; `leaving`
    (T, K): it ends here, after; `emissions` (T, K): the scaled densities. All divided by the frame's total.

    Returns:
        The log-likelihood of the demonstration.
    """
    components, longest = durations.shape
    memory = np.zeros((components, longest))
    mass = np.empty(components)
    log_likelihood = 0.0
    for t in range(log_emissions.shape[0]):
        predict_frame(memory, t == 0, initial, transitions, entering[t])
        shift_memory(memory, durations, entering[t], memory)
        sum_rows(memory, mass)
        largest, total = weigh_frame(log_emissions[t], mass, emissions[t])
        log_likelihood += largest + np.log(total)
        for j in range(components):
            factor = emissions[t, j] / total
            emissions[t, j] = factor
            for r in range(longest):
                memory[j, r] *= factor
            leaving[t, j] = memory[j, 0]
    return log_likelihood


@compiled
def backward_frames(
    transitions: FloatArray,
    durations: FloatArray,
    entering: FloatArray,
    leaving: FloatArray,
    emissions: FloatArray,
    responsibilities: FloatArray,
    transition_counts: FloatArray,
    duration_counts: FloatArray,
) -> None:
    """The backward pass and the expected counts of one demonstration.

    Fills `responsibilities` (T, K), and adds to `transition_counts` (K, K) and `duration_counts` (K, D) the
    expected numbers of transitions and of segments by their duration. Occupancy is the starts so far less the
    ends so far, which spares keeping all T * K * D forward values.
    """
    frames, components = emissions.shape
    longest = durations.shape[1]
    # `ahead[j, offset + r]`: likelihood of the frames after t given (j, r). Passing one frame back shifts r by one,
    # so the rows slide through a buffer instead of being moved.
    ahead = np.ones((components, frames + longest))
    started = np.empty(components)
    starts = np.empty((frames, components))
    ends = np.empty((frames, components))
    for back in range(frames):
        t = frames - 1 - back
        offset = t
        for j in range(components):
            p0, p1, p2, p3 = 0.0, 0.0, 0.0, 0.0
            whole = longest - longest % 4
            for r in range(0, whole, 4):
                p0 += durations[j, r] * ahead[j, offset + r]
                p1 += durations[j, r + 1] * ahead[j, offset + r + 1]
                p2 += durations[j, r + 2] * ahead[j, offset + r + 2]
                p3 += durations[j, r + 3] * ahead[j, offset + r + 3]
            for r in range(whole, longest):
                p0 += durations[j, r] * ahead[j, offset + r]
            started[j] = emissions[t, j] * ((p0 + p1) + (p2 + p3))
            starts[t, j] = entering[t, j] * started[j]
            ends[t, j] = leaving[t, j] * ahead[j, offset]
            weight = entering[t, j] * emissions[t, j]
            for r in range(longest):
                duration_counts[j, r] += weight * durations[j, r] * ahead[j, offset + r]
        if t == 0:
            break
        for j in range(components):
            factor = emissions[t, j]
            for r in range(longest):
                ahead[j, offset + r] = min(ahead[j, offset + r] * factor, CEILING)
            total = 0.0
            for k in range(components):
                moved = transitions[j, k] * started[k]
                total += moved
                transition_counts[j, k] += leaving[t - 1, j] * moved
            ahead[j, offset - 1] = min(total, CEILING)
    occupancy = np.zeros(components)
    for t in range(frames):
        for j in range(components):
            occupancy[j] = max(occupancy[j] + starts[t, j], 0.0)
            responsibilities[t, j] = occupancy[j]
            occupancy[j] = occupancy[j] - ends[t, j]

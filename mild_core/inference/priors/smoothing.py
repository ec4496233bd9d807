# SPDX-License-Identifier: Apache-2.0
"""Forward and backward over a demonstration, compiled: the expectation step of EM, which sees all frames at once.

The filter's memory of (component j, remaining time r) moves by one place a frame. Here it stands still instead: the
window of remaining times slides over a buffer as long as the demonstration. What a frame multiplies a component's
whole row by is not carried out but owed by the row, until that is so large or small that it has to be. So a row costs
one pass a frame in either direction. Sums are taken in whatever order is fastest: this is for learning alone.

Source: METHOD section 2; S.-Z. Yu, "Hidden semi-Markov models", Artificial Intelligence 174 (2010).
"""

from __future__ import annotations

import numpy as np

from mild_core.compiled import compiled, compiled_in_any_order
from mild_core.inference.priors.filtering import UNREACHABLE, weigh_frame
from mild_core.shapes import FloatArray

NEGLIGIBLE = 1e-20
"""An expected number of segments that changes no sum of theirs."""

CEILING = 1e250
"""Bound of the backward values. Only states of no forward mass come near it; beyond it they would turn into NaN."""

LEAST_OWED, MOST_OWED = 1e-50, 1e50
"""A row may be owed a factor between these. Beyond, values would leave what a double can hold."""

VANISHED = 1e-290
"""Smaller values are zero: there arithmetic takes a hundred times as long, and nothing depends on them."""


@compiled_in_any_order
def settle(row: FloatArray, owed: float, factor: float) -> float:
    """Owe `row` one more factor, or multiply it by both if that is too much.

    Returns:
        What it is owed now.
    """
    if LEAST_OWED < owed * factor < MOST_OWED:
        return owed * factor
    for r in range(row.shape[0]):
        value = min(row[r] * owed, CEILING) * factor
        row[r] = min(value, CEILING) if value > VANISHED else 0.0
    return 1.0


@compiled_in_any_order
def enter(row: FloatArray, durations: FloatArray, entering: float) -> float:
    """Let segments start, `entering` of them by duration; returns the sum of the row (D,)."""
    total = 0.0
    for r in range(row.shape[0]):
        row[r] += durations[r] * entering
        total += row[r]
    return total


@compiled_in_any_order
def forward_frames(
    log_emissions: FloatArray,
    densities: FloatArray,
    chain: tuple[FloatArray, FloatArray, FloatArray],
    events: tuple[FloatArray, FloatArray, FloatArray],
) -> float:
    """`filtering.filter_frames` from the start, by the way of this module.

    Args:
        log_emissions: (T, K).
        densities: (T, K) their exponentials, divided by each frame's largest.
        chain: Start probabilities (K,), transitions (K, K), durations (K, D).
        events: As of `filter_frames`, filled.

    Returns:
        The log-likelihood of the frames.
    """
    initial, transitions, durations = chain
    entering, leaving, emissions = events
    frames, components = log_emissions.shape
    longest = durations.shape[1]
    memory, owed, mass = np.zeros((components, frames + longest)), np.ones(components), np.empty(components)
    log_likelihood = 0.0
    for t in range(frames):
        enters, total, largest = initial.copy(), 0.0, log_emissions[t].max()
        if t > 0:
            enters[:] = 0.0
            for i in range(components):
                for j in range(components):
                    enters[j] += leaving[t - 1, i] * transitions[i, j]
        for j in range(components):
            entering[t, j] = enters[j]
            mass[j] = owed[j] * enter(memory[j, t : t + longest], durations[j], enters[j] / owed[j])
            emissions[t, j] = densities[t, j]
            total += mass[j] * densities[t, j]
        if total < UNREACHABLE:  # what explains the frame best cannot be behind it, and hides what can
            largest, total = weigh_frame(log_emissions[t], mass, emissions[t])
        log_likelihood += largest + np.log(total)
        for j in range(components):
            emissions[t, j] /= total
            owed[j] = settle(memory[j, t : t + longest], owed[j], emissions[t, j])
            leaving[t, j] = owed[j] * memory[j, t]
    return log_likelihood


@compiled_in_any_order
def explain_rest(durations: FloatArray, ahead: FloatArray, owed: float, entering: float, counts: FloatArray) -> float:
    """Likelihood of this frame and all after it, given that a segment of one component starts here.

    Args:
        durations: (D,) of the component.
        ahead: (D,) that likelihood by remaining time.
        owed: What `ahead` is to be multiplied by.
        entering: Probability that it starts here.
        counts: (D,) gets the expected number of segments that start here added, each divided by the probability of
            its duration.
    """
    total = 0.0
    for r in range(ahead.shape[0]):
        total += durations[r] * ahead[r]
    # Most frames start no segment. What is left out is below the rounding of what is counted.
    if entering * owed * total > NEGLIGIBLE:
        for r in range(ahead.shape[0]):
            counts[r] += entering * owed * ahead[r]
    return min(owed * total, CEILING)


@compiled_in_any_order
def backward_frames(
    transitions: FloatArray,
    durations: FloatArray,
    forward: tuple[FloatArray, FloatArray, FloatArray],
    ends: FloatArray,
    rest: FloatArray,
    counts: FloatArray,
) -> None:
    """The backward pass over one demonstration, and its expected events.

    Args:
        transitions: (K, K).
        durations: (K, D).
        forward: The events of `forward_frames`.
        ends: (T, K) filled with the probability that a segment ends with a frame, given all frames.
        rest: (T, K) filled with the likelihood of a frame and all after it, given that a segment starts there.
        counts: (K, D), see `explain_rest`.
    """
    entering, leaving, emissions = forward
    frames, components = emissions.shape
    longest = durations.shape[1]
    ahead, owed, before = np.ones((components, frames + longest)), np.ones(components), np.empty(components)
    for back in range(frames):
        t = frames - 1 - back
        before[:] = 0.0
        for j in range(components):
            row = ahead[j, t : t + longest]
            ends[t, j] = leaving[t, j] * owed[j] * row[0]
            owed[j] = settle(row, owed[j], emissions[t, j])
            rest[t, j] = explain_rest(durations[j], row, owed[j], entering[t, j], counts[j])
        for i in range(components):
            for j in range(components):
                before[i] += transitions[i, j] * rest[t, j]
            if t > 0:
                ahead[i, t - 1] = min(before[i], CEILING) / owed[i]


@compiled
def occupy_components(starts: FloatArray, ends: FloatArray, responsibilities: FloatArray) -> None:
    """Fill `responsibilities` (T, K): the starts so far less the ends before.

    This spares keeping all T * K * D forward values.
    """
    frames, components = starts.shape
    for j in range(components):
        occupied = 0.0
        for t in range(frames):
            occupied = max(occupied + starts[t, j], 0.0)
            responsibilities[t, j] = occupied
            occupied -= ends[t, j]

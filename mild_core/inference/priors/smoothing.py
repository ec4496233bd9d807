# SPDX-License-Identifier: Apache-2.0
"""The way back over a demonstration, compiled: what EM needs beyond the filter's way forward.

Source: METHOD section 2; S.-Z. Yu, "Hidden semi-Markov models", Artificial Intelligence 174 (2010).
"""

from __future__ import annotations

import numpy as np

from mild_core.compiled import compiled
from mild_core.shapes import FloatArray

NEGLIGIBLE = 1e-25
"""An expected number of segments that changes no sum of theirs."""

CEILING = 1e250
"""Bound of the backward values. Only states of no forward mass come near it; beyond it they would turn into NaN."""


@compiled
def explain_rest(
    durations: FloatArray, ahead: FloatArray, entering: float, emission: float, counts: FloatArray
) -> float:
    """Likelihood of this frame and all after it, given that a segment of one component starts here.

    Args:
        durations: (D,) of the component.
        ahead: (D,) likelihood of the frames after this one, by remaining time; changed to that of this one and
            the frames after.
        entering: Probability that it starts here.
        emission: Scaled density of this frame.
        counts: (D,) gets the expected number of segments that start here, by duration.
    """
    longest = durations.shape[0]
    whole = longest - longest % 4
    for r in range(longest):
        ahead[r] = min(ahead[r] * emission, CEILING)
    p0, p1, p2, p3 = 0.0, 0.0, 0.0, 0.0
    for r in range(0, whole, 4):
        p0 += durations[r] * ahead[r]
        p1 += durations[r + 1] * ahead[r + 1]
        p2 += durations[r + 2] * ahead[r + 2]
        p3 += durations[r + 3] * ahead[r + 3]
    for r in range(whole, longest):
        p0 += durations[r] * ahead[r]
    rest = (p0 + p1) + (p2 + p3)
    # Most frames start no segment. What is left out is below the rounding of what is counted.
    if entering * rest > NEGLIGIBLE:
        for r in range(longest):
            counts[r] += entering * durations[r] * ahead[r]
    return rest


@compiled
def backward_frames(
    transitions: FloatArray,
    durations: FloatArray,
    forward: tuple[FloatArray, FloatArray, FloatArray],
    starts: FloatArray,
    ends: FloatArray,
    transition_counts: FloatArray,
    duration_counts: FloatArray,
) -> None:
    """The backward pass over one demonstration, and its expected events.

    Args:
        transitions: (K, K).
        durations: (K, D).
        forward: The `events` of `filter_frames`.
        starts: (T, K) filled with the probability that a segment starts at a frame, given all frames.
        ends: (T, K) the same for its last frame.
        transition_counts: (K, K) gets the expected transitions added.
        duration_counts: (K, D) gets the expected segments by duration added.
    """
    entering, leaving, emissions = forward
    frames, components = emissions.shape
    longest = durations.shape[1]
    # `ahead[j, t + r]`: likelihood of the frames after t given (j, r). Going back a frame shifts r by one, so the
    # rows slide through a buffer instead of being moved.
    ahead, rest = np.ones((components, frames + longest)), np.empty(components)
    for back in range(frames):
        t = frames - 1 - back
        for j in range(components):
            row = ahead[j, t : t + longest]
            ends[t, j] = leaving[t, j] * row[0]
            rest[j] = explain_rest(durations[j], row, entering[t, j], emissions[t, j], duration_counts[j])
            starts[t, j] = entering[t, j] * rest[j]
        if t == 0:
            break
        for i in range(components):
            total = 0.0
            for j in range(components):
                moved = transitions[i, j] * rest[j]
                total += moved
                transition_counts[i, j] += leaving[t - 1, i] * moved
            ahead[i, t - 1] = min(total, CEILING)


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

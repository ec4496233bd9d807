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

NEGLIGIBLE = 1e-25
"""An expected number of segments that changes no sum of theirs."""

UNREACHABLE = 1e-250
"""A component with less mass than this before a frame cannot be the one behind it."""

CEILING = 1e250
"""Bound of the backward values. Only states of no forward mass come near it; beyond it they would turn into NaN."""


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
    chain: tuple[FloatArray, FloatArray],
    durations: FloatArray,
    weights: FloatArray,
    log_likelihoods: FloatArray,
) -> None:
    """Run the online filter over frames.

    Args:
        log_emissions: (T, K) log densities of the frames.
        memory: (K, D) belief over component and remaining time, changed in place; zero before the first frame.
        first: Whether the first frame is the first of all, so that the chain starts there.
        chain: Start probabilities (K,) and transitions (K, K).
        durations: (K, D); column 0 is a duration of one frame.
        weights: (T, K) filled with the belief after each frame.
        log_likelihoods: (T,) filled with log p(frame | frames before). A frame that no component can explain
            (every density underflows) is passed over as unobserved, and its log-likelihood, far below
            `UNDERFLOW`, tells so.
    """
    components, longest = durations.shape
    entering, emission, mass = np.empty(components), np.empty(components), np.empty(components)
    scale = np.ones(components)
    for t in range(log_emissions.shape[0]):
        enter_components(memory, scale, first and t == 0, chain, entering)
        shift_memory(memory, scale, durations, entering, mass)
        largest, total = weigh_frame(log_emissions[t], mass, emission)
        log_likelihoods[t] = largest + np.log(total)
        if not largest > UNDERFLOW:
            log_likelihoods[t] = min(largest, UNDERFLOW)
            emission[:] = 1.0
            total = mass.sum()
        for j in range(components):
            scale[j] = emission[j] / total
            weights[t, j] = mass[j] * scale[j]
    for j in range(components):
        for r in range(longest):
            memory[j, r] *= scale[j]


@compiled
def forward_frames(
    log_emissions: FloatArray,
    chain: tuple[FloatArray, FloatArray],
    durations: FloatArray,
    entering: FloatArray,
    leaving: FloatArray,
    emissions: FloatArray,
) -> float:
    """The forward pass over one demonstration, scaled frame by frame.

    Fills, for the backward pass, `entering` (T, K): a segment starts here, before the frame is seen; `leaving`
    (T, K): it ends here, after; `emissions` (T, K): the densities, divided by the frame's total.

    Returns:
        The log-likelihood of the demonstration.
    """
    components, longest = durations.shape
    memory, mass, scale = np.zeros((components, longest)), np.empty(components), np.ones(components)
    log_likelihood = 0.0
    for t in range(log_emissions.shape[0]):
        enter_components(memory, scale, t == 0, chain, entering[t])
        shift_memory(memory, scale, durations, entering[t], mass)
        largest, total = weigh_frame(log_emissions[t], mass, emissions[t])
        log_likelihood += largest + np.log(total)
        for j in range(components):
            emissions[t, j] /= total
            scale[j] = emissions[t, j]
            leaving[t, j] = memory[j, 0] * scale[j]
    return log_likelihood


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
        forward: `entering`, `leaving` and `emissions` of `forward_frames`.
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

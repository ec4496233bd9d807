# SPDX-License-Identifier: Apache-2.0
"""Forward and backward over a demonstration, compiled: the expectation step of EM, which sees all frames at once.

The filter's memory of (component j, remaining time r) moves by one place a frame. Here nothing moves: what is kept of a
component is one value for each frame, where its segments started (forward) or may end (backward), and what a frame
needs is the product of a stretch of them with the durations. What a frame multiplies all of them by is not carried out
but owed to them, until that is so large or small that it has to be. Of the stretch, the far end is left out for good
once it no longer counts: where components lie apart, a few frames remain of D. Sums are taken in whatever order is
fastest: this is for learning alone.

Source: METHOD section 2; S.-Z. Yu, "Hidden semi-Markov models", Artificial Intelligence 174 (2010).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mild_core.compiled import compiled, compiled_in_any_order
from mild_core.inference.priors.filtering import UNREACHABLE, weigh_frame
from mild_core.shapes import FloatArray

NEGLIGIBLE = 1e-20
"""An expected number of segments that changes no sum of theirs."""

CEILING = 1e200
"""Bound of the backward values. Only states of no forward mass come near it; beyond it they would turn into NaN."""

LEAST_OWED, MOST_OWED = 1e-100, 1e50
"""A row may be owed a factor between these. Beyond, values would leave what a double can hold."""

VANISHED = 1e-290
"""Smaller values are zero: there arithmetic takes a hundred times as long, and nothing depends on them."""

FORGOTTEN = 1e-180
"""Share of a row's sum below which its earliest starts, or latest ends, are left out from then on.

They share all other frames with the rest of the row and differ in the remaining time alone: those frames would have to
be this much likelier after the one remaining time than after the other to bring them back.
"""

BLOCK = 16
"""Frames are looked through, and left out, by so many: loops of few lengths are faster than shorter ones of any."""

MARGIN = 2 * BLOCK
"""Zeros on either side of the durations, for the frames of the outermost blocks that are out of their reach."""


@compiled_in_any_order
def settle(rows: FloatArray, j: int, first: int, stop: int, owed: float, factor: float) -> float:
    """Owe row `j` one more factor from place `first` to `stop`, or multiply it by both if that is too much.

    Returns:
        What it is owed now.
    """
    if LEAST_OWED < owed * factor < MOST_OWED:
        return owed * factor
    # What would vanish does so before it is multiplied: the product is what takes long.
    least = VANISHED / max(owed * factor, VANISHED)
    at = np.uint64(first)  # here and below: no sign to look at for each value, and no view that has to be counted
    for r in range(np.uint64(stop - first)):
        value = rows[j, at + r] if rows[j, at + r] > least else 0.0
        rows[j, at + r] = min(min(value * owed, CEILING) * factor, CEILING)
    return 1.0


@compiled
def largest_of_block(rows: FloatArray, j: int, first: int) -> float:
    """The largest value of row `j` in the block from place `first`."""
    largest = 0.0
    for s in range(first, first + BLOCK):
        largest = max(largest, rows[j, s])
    return largest


@compiled_in_any_order
def weigh_starts(
    starts: FloatArray, lasting: FloatArray, ending: FloatArray, j: int, first: int, stop: int, part: int
) -> tuple[float, float]:
    """How many segments of component `j` that started from `first` to `stop` last, and how many end.

    `part` is the place of `first` in `lasting` and `ending`.
    """
    at, where, last, end = np.uint64(first), np.uint64(part), 0.0, 0.0
    for r in range(np.uint64(stop - first)):
        last += starts[j, at + r] * lasting[j, where + r]
        end += starts[j, at + r] * ending[j, where + r]
    return last, end


@compiled_in_any_order
def forward_frames(
    log_emissions: FloatArray,
    largest: FloatArray,
    chain: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    events: tuple[FloatArray, FloatArray, FloatArray],
) -> float:
    """`filtering.filter_frames` from the start, by the way of this module.

    Args:
        log_emissions: (T, K).
        largest: (T,) the largest of each frame.
        chain: Start probabilities (K,), transitions (K, K), and from the longest duration to the shortest the
            probability of it or a longer one and of itself, both within their margins (K, D + 2 MARGIN).
        events: As of `filter_frames`, filled; the third comes with the exponentials of `log_emissions` less `largest`.

    Returns:
        The log-likelihood of the frames.
    """
    initial, transitions, lasting, ending = chain
    entering, leaving, emissions = events
    (frames, components), newest = log_emissions.shape, ending.shape[1] - MARGIN - 1
    starts, owed, earliest = np.zeros((components, frames + BLOCK)), np.ones(components), np.zeros(components, np.int64)
    enters, mass, ends, log_likelihood = initial.copy(), np.empty(components), np.empty(components), 0.0
    for t in range(frames):
        total, logarithm, here = 0.0, largest[t], t - t % BLOCK
        for j in range(components):
            entering[t, j], start, first = enters[j], enters[j] / owed[j], earliest[j]
            last, end = weigh_starts(starts, lasting, ending, j, first, here + BLOCK, newest - t + first)
            # The newest start is counted apart: what was only just written has to be waited for.
            last, end, starts[j, t] = last + start * lasting[j, newest], end + start * ending[j, newest], start
            mass[j], ends[j] = last * owed[j], end * owed[j]
            total += mass[j] * emissions[t, j]
            if t == here:
                least, reach = FORGOTTEN * last, t - newest + MARGIN
                while first < t and (first + BLOCK <= reach or largest_of_block(starts, j, first) < least):
                    first += BLOCK
                earliest[j] = first
        if total < UNREACHABLE:  # what explains the frame best cannot be behind it, and hides what can
            logarithm, total = weigh_frame(log_emissions[t], mass, emissions[t])
        log_likelihood += logarithm + np.log(total)
        enters[:] = 0.0
        for i in range(components):
            emissions[t, i] /= total
            leaving[t, i] = ends[i] * emissions[t, i]
            owed[i] = settle(starts, i, earliest[i], t + 1, owed[i], emissions[t, i])
            for j in range(components):
                enters[j] += leaving[t, i] * transitions[i, j]
    return log_likelihood


@compiled_in_any_order
def explain_rest(durations: FloatArray, ahead: FloatArray, j: int, first: int, stop: int, part: int) -> float:
    """Likelihood of this frame and all after it, given that a segment of component `j` starts here, but for the owed.

    `ahead` is that likelihood by the segment's last frame, from `first` to `stop`; `part` is the place of `first` in
    `durations`.
    """
    at, where, total = np.uint64(first), np.uint64(part), 0.0
    for r in range(np.uint64(stop - first)):
        total += durations[j, where + r] * ahead[j, at + r]
    return total


@compiled_in_any_order
def add_stretch(
    sums: FloatArray, j: int, place: int, share: float, values: FloatArray, row: int, first: int, stop: int
) -> None:
    """Add `share` times the values of `row` from `first` to `stop` to row `j` of `sums`, from `place` on."""
    at, where = np.uint64(first), np.uint64(place)
    for r in range(np.uint64(stop - first)):
        sums[j, where + r] += share * values[row, at + r]


@compiled_in_any_order
def backward_frames(
    chain: tuple[FloatArray, FloatArray],
    forward: tuple[FloatArray, FloatArray, FloatArray],
    ends: FloatArray,
    rest: FloatArray,
    counts: tuple[FloatArray, FloatArray],
) -> None:
    """The backward pass over one demonstration, and its expected events.

    Args:
        chain: Transitions (K, K), from column to row, and durations (K, D + 2 MARGIN) within their margins.
        forward: The events of `forward_frames`.
        ends: (T, K) filled with the probability that a segment ends with a frame, given all frames.
        rest: (T, K) filled with the likelihood of a frame and all after it, given that a segment starts there.
        counts: Get what is expected added, each divided by its probability in the chain: segments that follow one
            another, (K, K) from row to column, and that start here by their durations, (K, D + 2 MARGIN).
    """
    transitions, durations = chain
    entering, leaving, emissions = forward
    changes, lasts = counts
    (frames, components), longest = emissions.shape, durations.shape[1] - 2 * MARGIN
    ahead, owed, after = np.zeros((components, frames + longest + BLOCK)), np.ones(components), np.ones(components)
    ahead[:, frames:] = 1.0  # the last segment of all may go on unseen
    followed, latest = np.zeros(components), np.full(components, (frames + longest + BLOCK - 1) // BLOCK * BLOCK)
    for back in range(frames):
        t = frames - 1 - back
        here = t - t % BLOCK
        for j in range(components):
            after[j], last = min(after[j], CEILING), latest[j]
            ends[t, j] = leaving[t, j] * after[j]
            # Most frames end no segment, and start none. What is left out is below the rounding of what is counted.
            if back > 0 and ends[t, j] > NEGLIGIBLE * followed[j]:
                followed[j] += ends[t, j]
                add_stretch(changes, j, 0, leaving[t, j], rest, t + 1, 0, components)
            owed[j] = settle(ahead, j, t + 1, last, owed[j], emissions[t, j])
            now = min(after[j] * emissions[t, j], CEILING) / owed[j]
            total = explain_rest(durations, ahead, j, here, last, MARGIN + here - t) + durations[j, MARGIN] * now
            ahead[j, t], share, rest[t, j] = now, entering[t, j] * owed[j], min(owed[j] * total, CEILING)
            if share * total > NEGLIGIBLE:
                add_stretch(lasts, j, MARGIN, share, ahead, j, t, last)
            if t == here:
                while last > t + BLOCK and (
                    last - BLOCK >= t + longest or largest_of_block(ahead, j, last - BLOCK) < FORGOTTEN * total
                ):
                    last -= BLOCK
                latest[j] = last
        after[:] = 0.0
        for j in range(components):
            for i in range(components):
                after[i] += transitions[j, i] * rest[t, j]


@compiled
def occupy_components(entering: FloatArray, rest: FloatArray, ends: FloatArray, responsibilities: FloatArray) -> None:
    """Fill `responsibilities` (T, K): the starts so far, `entering` times `rest`, less the ends before.

    This spares keeping all T * K * D forward values.
    """
    frames, components = entering.shape
    occupied = np.zeros(components)
    for t in range(frames):
        for j in range(components):
            responsibilities[t, j] = max(occupied[j] + entering[t, j] * rest[t, j], 0.0)
            occupied[j] = responsibilities[t, j] - ends[t, j]


@compiled
def below_largest(log_emissions: FloatArray, largest: FloatArray, below: FloatArray) -> None:
    """Fill `largest` (N,) with the largest of each frame of `log_emissions` (N, K), `below` with them less it."""
    frames, components = log_emissions.shape
    for n in range(frames):
        largest[n] = log_emissions[n, 0]
        for j in range(1, components):
            largest[n] = max(largest[n], log_emissions[n, j])
        for j in range(components):
            below[n, j] = log_emissions[n, j] - largest[n]


@compiled
def expect_demonstrations(
    frames: tuple[FloatArray, FloatArray, FloatArray],
    lengths: NDArray[np.int64],
    chain: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    responsibilities: FloatArray,
    counts: tuple[FloatArray, FloatArray, FloatArray],
) -> float:
    """Forward and backward over demonstrations one after the other.

    Args:
        frames: Log-densities (N, K), the largest of each frame (N,), and the densities divided by that one's (N, K),
            which are overwritten.
        lengths: Frames of each demonstration.
        chain: As of `forward_frames`.
        responsibilities: (N, K) filled.
        counts: Get what is expected added: demonstrations that start in each component (K,), then as of
            `backward_frames`.

    Returns:
        The log-likelihood of all.
    """
    log_emissions, largest, densities = frames
    starting, changes, lasts = counts
    transitions, ending = chain[1], chain[3]
    back, durations = np.ascontiguousarray(transitions.T), np.ascontiguousarray(ending[:, ::-1])
    log_likelihood, start = 0.0, 0
    for length in lengths:
        part, shape = slice(start, start + length), (length, starting.shape[0])
        events = (np.empty(shape), np.empty(shape), densities[part])
        ends, rest = np.empty(shape), np.empty(shape)
        log_likelihood += forward_frames(log_emissions[part], largest[part], chain, events)
        backward_frames((back, durations), events, ends, rest, (changes, lasts))
        occupy_components(events[0], rest, ends, responsibilities[part])
        starting += responsibilities[start]
        start += length
    return log_likelihood

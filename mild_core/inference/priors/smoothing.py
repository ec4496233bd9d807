# SPDX-License-Identifier: Apache-2.0
"""Forward and backward over demonstrations, compiled: the expectation step of EM, which sees all frames at once.

The filter's memory of (component j, remaining time r) moves by one place a frame. Here nothing moves: what is kept of a
component is one value for each frame, where its segments started (forward) or may end (backward), and what a frame
needs is the product of a stretch of them with the durations (`stretches`).

Eight demonstrations of about the same length are gone through side by side, each in a lane of its own; arrays have the
lanes last. Until the longest has ended the others go on: forward with their last frame again and again, of which
nothing is kept, and backward as if nothing were seen and nothing ended.

Source: S.-Z. Yu, "Hidden semi-Markov models", Artificial Intelligence 174 (2010).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mild_core.compiled import compiled
from mild_core.inference.priors.filtering import UNREACHABLE, weigh_frame
from mild_core.inference.priors.lanes import LANES, any_above, load, repeat, store, where_above
from mild_core.inference.priors.stretches import BLOCK, CEILING, forget, settle, weigh, weigh_both
from mild_core.shapes import FloatArray

NEGLIGIBLE = 1e-20
"""An expected number of segments that changes no sum of theirs."""

Parameters = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Of a chain: start probabilities (K,), transitions (K, K), and (K, D) that of each duration and of it or a longer."""

Events = tuple[FloatArray, FloatArray, FloatArray]
"""(T, K, lanes), as of `filter_frames`."""

Demonstrations = NDArray[np.int64]
"""Two columns: the first frame of each, and its number of frames."""


@compiled
def reach_frames(
    log_emissions: FloatArray,
    largest: FloatArray,
    lanes: Demonstrations,
    t: int,
    mass: FloatArray,
    emissions: FloatArray,
    totals: FloatArray,
) -> None:
    """Reweigh frame `t` where what explains it best cannot be behind it, and hides what can."""
    for lane in range(LANES):
        if totals[lane] < UNREACHABLE:
            n = lanes[lane, 0] + min(t, lanes[lane, 1] - 1)
            logarithm, totals[lane] = weigh_frame(log_emissions[n], mass[:, lane], emissions[:, lane])
            if t < lanes[lane, 1]:
                largest[n] = logarithm


@compiled
def forward_frames(
    frames: tuple[FloatArray, FloatArray],
    lanes: Demonstrations,
    chain: Parameters,
    rows: FloatArray,
    events: Events,
    totals: FloatArray,
) -> None:
    """`filtering.filter_frames` from the start, by the way of this module.

    Args:
        frames: Log-densities (N, K) and the largest of each frame (N,), corrected to the largest reachable one.
        lanes: What each goes through.
        chain: The current estimate.
        rows: (K, T or more, lanes) of zeros, changed.
        events: Filled; the third comes with the densities divided by the largest.
        totals: (T, lanes) filled with the likelihood of each frame given those before, divided by the largest density.
    """
    initial, transitions, durations, lasting = chain
    entering, leaving, emissions = events
    (count, components, _), longest = emissions.shape, durations.shape[1]
    stops, owed = np.full(components, count), np.ones((components, LANES))
    mass, enters = np.empty((components, LANES)), np.empty((components, LANES))
    for j in range(components):
        store(enters, (j,), initial[j])
    for t in range(count):
        total, place = repeat(0.0), count - 1 - t
        for j in range(components):
            share, start, stop = load(owed, (j,)), load(enters, (j,)), min(stops[j], place + longest)
            store(entering, (t, j), start)
            store(rows, (j, place), start / share)
            last, end = weigh_both(rows, j, place, stop, lasting, durations)
            stops[j] = forget(rows, j, place, stop, last) if t % BLOCK == 0 else stop
            store(mass, (j,), last * share)
            store(leaving, (t, j), end * share)
            total += last * share * load(emissions, (t, j))
        store(totals, (t,), total)
        if any_above(UNREACHABLE, total):
            reach_frames(frames[0], frames[1], lanes, t, mass, emissions[t], totals[t])
        scale = 1.0 / load(totals, (t,))
        for j in range(components):
            factor = load(emissions, (t, j)) * scale
            store(emissions, (t, j), factor)
            store(leaving, (t, j), load(leaving, (t, j)) * factor)
            settle(rows, j, place, stops[j], owed, factor)
        for j in range(components):
            start = repeat(0.0)
            for i in range(components):
                start += load(leaving, (t, i)) * transitions[i, j]
            store(enters, (j,), start)


@compiled
def backward_frames(
    bounds: FloatArray, chain: Parameters, rows: FloatArray, events: Events, counts: tuple[FloatArray, FloatArray]
) -> None:
    """The backward pass, and the expected events.

    Args:
        bounds: (2, lanes) frames of each lane, and how many of them are counted: all, or none.
        chain: The current estimate.
        rows: (K, T + D or more, lanes) of ones, changed: the last segment of all may go on unseen.
        events: Of `forward_frames`. The first two are replaced by the probabilities that a segment starts with a frame
            and that one ends with it, given all frames.
        counts: Get what is expected added, each divided by its probability in the chain: segments that follow one
            another, (K, K, lanes) from row to column, and that start here by their durations, (K, D, lanes).
    """
    _, transitions, durations, _ = chain
    entering, leaving, emissions = events
    changes, lasts = counts
    (count, components, _), longest = emissions.shape, durations.shape[1]
    stops, owed = np.full(components, count + longest), np.ones((components, LANES))
    after, rest, until = np.ones((components, LANES)), np.empty((components, LANES)), load(bounds, (0,))
    counted = load(bounds, (1,))
    for t in range(count - 1, -1, -1):
        now = repeat(float(t))
        for j in range(components):
            factor, stop = where_above(until, now, load(emissions, (t, j)), 1.0), min(stops[j], t + longest)
            settle(rows, j, t + 1, stop, owed, factor)
            share, ahead = load(owed, (j,)), load(after, (j,)) * factor
            store(rows, (j, t), where_above(ahead, CEILING, CEILING, ahead) / share)
            total = weigh(rows, j, t, stop, durations)
            stops[j] = forget(rows, j, t, stop, total) if t % BLOCK == 0 else stop
            start, ahead = where_above(counted, now, load(entering, (t, j)), 0.0), total * share
            ahead = where_above(ahead, CEILING, CEILING, ahead)
            store(rest, (j,), ahead)
            store(entering, (t, j), start * ahead)
            if any_above(start * ahead, NEGLIGIBLE):
                for r in range(stop - t):
                    store(lasts, (j, r), load(lasts, (j, r)) + start * share * load(rows, (j, t + r)))
        for i in range(components if t > 0 else 0):
            ahead, left = repeat(0.0), where_above(counted, now, load(leaving, (t - 1, i)), 0.0)
            for j in range(components):
                ahead += load(rest, (j,)) * transitions[i, j]
                store(changes, (i, j), load(changes, (i, j)) + left * load(rest, (j,)))
            # Where a lane joins with the next frame, nothing is known of what would follow.
            ahead = where_above(until, now, where_above(ahead, CEILING, CEILING, ahead), 1.0)
            store(leaving, (t - 1, i), left * ahead)
            store(after, (i,), ahead)


@compiled
def take_frames(densities: FloatArray, lanes: Demonstrations, emissions: FloatArray) -> None:
    """Fill `emissions` (T, K, lanes) with `densities` (N, K), and with a lane's last frame again after its end."""
    for t in range(emissions.shape[0]):
        for lane in range(LANES):
            n = lanes[lane, 0] + min(t, lanes[lane, 1] - 1)
            for j in range(emissions.shape[1]):
                emissions[t, j, lane] = densities[n, j]


@compiled
def occupy_components(events: Events, lanes: Demonstrations, counted: FloatArray, responsibilities: FloatArray) -> None:
    """Fill `responsibilities` (N, K): the starts so far less the ends before. This spares keeping all forward values.

    Args:
        events: As `backward_frames` leaves them. The first is overwritten.
        lanes: What each went through.
        counted: (lanes,) how many frames of each are counted.
        responsibilities: Filled in these frames.
    """
    entering, leaving, _ = events
    count, components, _ = entering.shape
    occupied = np.zeros((components, LANES))
    for t in range(count):
        for j in range(components):
            share = load(occupied, (j,)) + load(entering, (t, j))
            share = where_above(share, 0.0, share, 0.0)
            store(entering, (t, j), share)
            store(occupied, (j,), share + load(leaving, (t, j)) * -1.0)
        for lane in range(LANES):
            if t < counted[lane]:
                for j in range(components):
                    responsibilities[lanes[lane, 0] + t, j] = entering[t, j, lane]


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
    frames: tuple[FloatArray, FloatArray],
    demonstrations: Demonstrations,
    chain: Parameters,
    responsibilities: FloatArray,
    counts: tuple[FloatArray, FloatArray, FloatArray],
) -> float:
    """Forward and backward over demonstrations, as many as there are lanes at once.

    Args:
        frames: Log-densities (N, K) and the largest of each frame (N,), which is changed.
        demonstrations: From the longest to the shortest, none empty.
        chain: The current estimate.
        responsibilities: (N, K) filled; comes with the densities divided by the largest of their frame.
        counts: Get what is expected added: demonstrations that start in each component (K,), then as of
            `backward_frames`.

    Returns:
        The log-likelihood of all.
    """
    largest, (starting, changes, lasts) = frames[1], counts
    components, longest = chain[2].shape
    count, most, log_likelihood = len(demonstrations), demonstrations[0, 1], 0.0
    rows, totals = np.empty((components, most + longest, LANES)), np.empty((most, LANES))
    shape, bounds = (most, components, LANES), np.empty((2, LANES))
    entering, leaving, emissions = np.empty(shape), np.empty(shape), np.empty(shape)
    lanes = np.empty((LANES, 2), np.int64)
    for first in range(0, count, LANES):
        for lane in range(LANES):
            counts_here = first + lane < count
            n = first + lane if counts_here else first  # lanes that are left over repeat the first
            lanes[lane, 0], lanes[lane, 1] = demonstrations[n, 0], demonstrations[n, 1]
            bounds[0, lane], bounds[1, lane] = lanes[lane, 1], lanes[lane, 1] if counts_here else 0.0
        stop = lanes[0, 1]
        events = (entering[:stop], leaving[:stop], emissions[:stop])
        take_frames(responsibilities, lanes, events[2])
        rows[:] = 0.0
        forward_frames(frames, lanes, chain, rows, events, totals)
        rows[:] = 1.0
        backward_frames(bounds, chain, rows, events, (changes, lasts))
        occupy_components(events, lanes, bounds[1], responsibilities)
        for lane in range(min(LANES, count - first)):
            for j in range(components):
                starting[j] += responsibilities[lanes[lane, 0], j]
            for t in range(lanes[lane, 1]):
                log_likelihood += largest[lanes[lane, 0] + t] + np.log(totals[t, lane])
    return log_likelihood

# SPDX-License-Identifier: Apache-2.0
"""The order and the durations of components, as a value, and what demonstrations say about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.compiled import compiled, compiled_in_any_order
from mild_core.inference.priors.filtering import UNDERFLOW, filter_frames
from mild_core.shapes import FloatArray, read_only, require_shape

CEILING = 1e200
"""Bound of the backward values. Only states of no forward mass come near it; beyond it they would turn into NaN."""

VANISHED = 1e-290
"""Smaller values are zero: there arithmetic takes a hundred times as long, and nothing depends on them."""

Parameters = tuple[FloatArray, FloatArray, FloatArray]
"""Of a chain: start probabilities (K,), transitions (K, K), durations (K, D)."""


@dataclass(frozen=True, eq=False)
class SemiMarkovChain:
    """A semi-Markov chain over K components. With D = 1 it is a Markov chain; with equal rows too, a mixture.

    Attributes:
        initial: (K,) probability that a recording starts with a segment of each component.
        transitions: (K, K) from row to column, at the end of a segment.
        durations: (K, D); column d is the probability that a segment lasts d + 1 frames.

    Raises:
        ValueError: When a shape is wrong, or a row is negative, not finite or does not sum to one.
    """

    initial: FloatArray
    transitions: FloatArray
    durations: FloatArray

    def __post_init__(self) -> None:
        for name, shape in (("initial", ()), ("transitions", (self.components,)), ("durations", (None,))):
            array = read_only(getattr(self, name))
            object.__setattr__(self, name, array)
            require_shape(name, array, (self.components, *shape))
            if not (np.isfinite(array).all() and (array >= 0.0).all()):
                raise ValueError(f"{name} holds something that is no probability")
            if abs(array.sum(axis=-1) - 1.0).max() > 1e-6:
                raise ValueError(f"{name} does not sum to one")

    @property
    def parameters(self) -> Parameters:
        """All three, for compiled functions."""
        return self.initial, self.transitions, self.durations

    @property
    def components(self) -> int:
        """K."""
        return len(self.initial)

    @property
    def longest(self) -> int:
        """D, the longest duration in frames."""
        return int(self.durations.shape[1])


@dataclass(frozen=True, eq=False)
class ChainCounts:
    """Expected numbers of events in demonstrations.

    Attributes:
        initial: (K,) demonstrations that start in each component.
        transitions: (K, K).
        durations: (K, D) segments by duration; a last, cut segment counts by what it may have become.
    """

    initial: FloatArray
    transitions: FloatArray
    durations: FloatArray


@dataclass(frozen=True, eq=False)
class ChainExpectation:
    """The E-step over all demonstrations of an interaction.

    Attributes:
        responsibilities: (N, K) posterior of the components at every frame, given the whole demonstration.
        counts: Summed over demonstrations.
        log_likelihood: Of all demonstrations.
    """

    responsibilities: FloatArray
    counts: ChainCounts
    log_likelihood: float


def normalise_rows(counts: FloatArray, otherwise: FloatArray) -> FloatArray:
    """Rows divided by their sums; a row without counts is taken from `otherwise`."""
    sums = counts.sum(axis=-1, keepdims=True)
    result: FloatArray = np.where(sums > 0.0, counts / np.where(sums > 0.0, sums, 1.0), otherwise)
    return result


@compiled_in_any_order
def pass_back(ahead: FloatArray, ending: float, emission: float) -> None:
    """Let one frame pass backward: what was ahead of `r` frames left is ahead of one more, `ending` of the last.

    Args:
        ahead: (D,) of a component by the frames left, changed in place. All of it is multiplied by `emission`.
        ending: Of a segment that ends with this frame.
        emission: Density of this frame, divided by its likelihood.
    """
    least = VANISHED / max(emission, VANISHED)  # what would vanish does so before it is multiplied
    for r in range(ahead.shape[0] - 1, 0, -1):
        value = ahead[r - 1] if ahead[r - 1] > least else 0.0
        ahead[r] = min(value * emission, CEILING)
    ahead[0] = min(ending * emission, CEILING)


@compiled_in_any_order
def add_starts(share: float, durations: FloatArray, ahead: FloatArray, lasts: FloatArray) -> float:
    """Add to `lasts` (D,) the segments that start at a frame, by their durations (D,), each divided by its own.

    Returns:
        Likelihood of the frame and all after it, given that a segment starts with it.
    """
    rest = 0.0
    for r in range(ahead.shape[0]):
        rest += durations[r] * ahead[r]
        lasts[r] += share * ahead[r]
    return rest


@compiled
def backward_frames(
    chain: Parameters,
    events: tuple[FloatArray, FloatArray, FloatArray],
    counts: tuple[FloatArray, FloatArray],
    responsibilities: FloatArray,
) -> None:
    """The backward pass over one demonstration: its expected events, and its components at every frame.

    Nothing is asked of what comes after the last frame: the last segment may go on unseen.

    Args:
        chain: The current estimate.
        events: Of `filter_frames` over the whole demonstration. The first two are replaced by the probabilities that
            a segment starts with a frame and that one ends with it, given all frames.
        counts: Get what is expected added, each divided by its probability in the chain: segments that follow one
            another (K, K), from row to column, and that start here by their durations (K, D).
        responsibilities: (T, K) filled: the starts so far less the ends before, which spares keeping all T K D forward
            values.

    Source: S.-Z. Yu, "Hidden semi-Markov models", Artificial Intelligence 174 (2010).
    """
    _, transitions, durations = chain
    entering, leaving, emissions = events
    changes, lasts = counts
    frames, components = emissions.shape
    ahead, after, rest = np.ones(durations.shape), np.ones(components), np.empty(components)
    for t in range(frames - 1, -1, -1):
        for j in range(components):
            pass_back(ahead[j], after[j], emissions[t, j])
            rest[j] = min(add_starts(entering[t, j], durations[j], ahead[j], lasts[j]), CEILING)
            entering[t, j] *= rest[j]
        for i in range(components if t > 0 else 0):
            after[i] = 0.0
            for j in range(components):
                after[i] += transitions[i, j] * rest[j]
                changes[i, j] += leaving[t - 1, i] * rest[j]
            after[i] = min(after[i], CEILING)
            leaving[t - 1, i] *= after[i]
    for j in range(components):
        occupied = 0.0
        for t in range(frames):
            responsibilities[t, j] = max(occupied + entering[t, j], 0.0)
            occupied = responsibilities[t, j] - leaving[t, j]


def expect(chain: SemiMarkovChain, log_emissions: FloatArray, lengths: Sequence[int]) -> ChainExpectation:
    """Forward-backward over each demonstration on its own: no segment runs from one into the next.

    Args:
        chain: The current estimate.
        log_emissions: (N, K) log-densities of all frames, demonstrations one after the other.
        lengths: Frames of each demonstration, N in sum.

    Raises:
        ValueError: When the lengths do not sum to N.

    Source: explicit-duration forward pass; Yu (2010), section 2.2.
    """
    require_shape("log_emissions", log_emissions, (sum(lengths), chain.components))
    responsibilities, log_likelihood = np.empty_like(log_emissions), 0.0
    starting, changes, lasts = (np.zeros_like(part) for part in (chain.initial, chain.transitions, chain.durations))
    ends = np.cumsum(lengths)
    for first, stop in zip(ends - lengths, ends, strict=True):
        if stop > first:
            forward = run_filter(chain, log_emissions[first:stop], lowest=-np.inf)
            backward_frames(chain.parameters, forward.events, (changes, lasts), responsibilities[first:stop])
            log_likelihood += float(forward.log_likelihoods.sum())
            starting += responsibilities[first]
    counts = ChainCounts(starting, changes * chain.transitions, lasts * chain.durations)
    return ChainExpectation(responsibilities, counts, log_likelihood)


@dataclass(frozen=True, eq=False)
class ForwardPass:
    """The filter's way over frames, as of `filter_frames`; `memory` (K, D) is that after the last."""

    memory: FloatArray
    weights: FloatArray
    log_likelihoods: FloatArray
    events: tuple[FloatArray, FloatArray, FloatArray]


def run_filter(
    chain: SemiMarkovChain, log_emissions: FloatArray, memory: FloatArray | None = None, lowest: float = UNDERFLOW
) -> ForwardPass:
    """Filter frames with log-densities (T, K), on from `memory` (K, D), changed in place, or from the start."""
    first = memory is None
    if memory is None:
        memory = np.zeros((chain.components, chain.longest))
    weights, log_likelihoods = np.empty_like(log_emissions), np.empty(len(log_emissions))
    events = (np.empty_like(weights), np.empty_like(weights), np.empty_like(weights))
    filter_frames(log_emissions, memory, first, chain.parameters, lowest, weights, log_likelihoods, events)
    return ForwardPass(memory, weights, log_likelihoods, events)


def component_probabilities(chain: SemiMarkovChain, frames: int) -> FloatArray:
    """(T, K) probability of each component at each frame when nothing is observed.

    Source: the forward variable without observations of eq. 9.
    """
    return run_filter(chain, np.zeros((frames, chain.components))).weights

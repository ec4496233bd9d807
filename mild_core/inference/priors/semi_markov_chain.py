# SPDX-License-Identifier: Apache-2.0
"""The order and the durations of components, as a value, and what demonstrations say about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.inference.priors.filtering import UNDERFLOW, filter_frames
from mild_core.inference.priors.lanes import LANES
from mild_core.inference.priors.smoothing import below_largest, expect_demonstrations
from mild_core.shapes import FloatArray, read_only, require_shape


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
    responsibilities, largest = np.empty_like(log_emissions), np.empty(len(log_emissions))
    below_largest(log_emissions, largest, responsibilities)
    np.exp(responsibilities, out=responsibilities)  # the densities, until they are replaced
    sizes = np.array(lengths, np.int64)
    order = np.argsort(-sizes, kind="stable")[: np.count_nonzero(sizes)]
    demonstrations = np.stack([np.cumsum(sizes) - sizes, sizes], axis=1)[order]
    initial, transitions, durations = chain.initial, chain.transitions, chain.durations
    parts = (initial, transitions, durations, durations[:, ::-1].cumsum(axis=1)[:, ::-1].copy())
    starting, changes, lasts = np.zeros(initial.shape), *(np.zeros((*a.shape, LANES)) for a in (transitions, durations))
    counted = (starting, changes, lasts)
    log_likelihood = expect_demonstrations((log_emissions, largest), demonstrations, parts, responsibilities, counted)
    counts = ChainCounts(starting, changes.sum(axis=2) * transitions, lasts.sum(axis=2) * durations)
    return ChainExpectation(responsibilities, counts, log_likelihood)


@dataclass(frozen=True, eq=False)
class ForwardPass:
    """The filter's way over frames, as of `filter_frames`; `memory` (K, D) is that after the last."""

    memory: FloatArray
    weights: FloatArray
    log_likelihoods: FloatArray


def run_filter(chain: SemiMarkovChain, log_emissions: FloatArray, memory: FloatArray | None = None) -> ForwardPass:
    """Filter frames with log-densities (T, K), on from `memory` (K, D), changed in place, or from the start."""
    first = memory is None
    if memory is None:
        memory = np.zeros((chain.components, chain.longest))
    weights, log_likelihoods = np.empty_like(log_emissions), np.empty(len(log_emissions))
    events = (np.empty_like(weights), np.empty_like(weights), np.empty_like(weights))
    parts = (chain.initial, chain.transitions, chain.durations)
    filter_frames(log_emissions, memory, first, parts, UNDERFLOW, weights, log_likelihoods, events)
    return ForwardPass(memory, weights, log_likelihoods)


def component_probabilities(chain: SemiMarkovChain, frames: int) -> FloatArray:
    """(T, K) probability of each component at each frame when nothing is observed.

    Source: the forward variable without observations of eq. 9.
    """
    return run_filter(chain, np.zeros((frames, chain.components))).weights

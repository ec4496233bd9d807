# SPDX-License-Identifier: Apache-2.0
"""The explicit-duration model by brute force: every way to cut a recording into segments is listed and weighed.

Nothing here is shared with the code under test but the parameters.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from mild_core.inference.priors.semi_markov_chain import SemiMarkovChain

Segmentation = tuple[tuple[int, int, bool], ...]
"""Segments as (component, frames seen, cut): the last one may be cut by the end of the recording."""


def segmentations(components: int, longest: int, frames: int) -> Iterator[Segmentation]:
    """Every way to fill `frames` with segments; a segment that ends with the recording is distinguished from one that
    would have gone on."""
    if frames == 0:
        yield ()
        return
    for component in range(components):
        for duration in range(1, min(longest, frames) + 1):
            for rest in segmentations(components, longest, frames - duration):
                yield ((component, duration, False), *rest)
        if frames < longest:
            yield ((component, frames, True),)


def weight(chain: SemiMarkovChain, segmentation: Segmentation, emissions: np.ndarray) -> float:
    """Joint probability of one segmentation and all frames; a cut segment has the mass of all longer durations."""
    value, time, before = 1.0, 0, None
    for component, duration, cut in segmentation:
        value *= chain.initial[component] if before is None else chain.transitions[before, component]
        row = chain.durations[component]
        value *= row[duration:].sum() if cut else row[duration - 1]
        value *= emissions[time : time + duration, component].prod()
        time, before = time + duration, component
    return float(value)


def posterior(chain: SemiMarkovChain, emissions: np.ndarray) -> tuple[float, np.ndarray]:
    """Likelihood of the frames, and (T, K) probability of each component at each frame given all of them."""
    total, table = 0.0, np.zeros(emissions.shape)
    for segmentation in segmentations(chain.components, chain.longest, len(emissions)):
        value = weight(chain, segmentation, emissions)
        total += value
        path = [component for component, duration, _ in segmentation for _ in range(duration)]
        table[np.arange(len(path)), path] += value
    return total, table / total


def counts(chain: SemiMarkovChain, emissions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Expected transitions (K, K), and segments by duration (K, D), where a cut one counts by all it may become."""
    total, _ = posterior(chain, emissions)
    transitions, durations = np.zeros((chain.components, chain.components)), np.zeros(chain.durations.shape)
    for segmentation in segmentations(chain.components, chain.longest, len(emissions)):
        value = weight(chain, segmentation, emissions) / total
        for (first, _, _), (second, _, _) in itertools.pairwise(segmentation):
            transitions[first, second] += value
        for component, duration, cut in segmentation:
            if cut:
                tail = chain.durations[component, duration:]
                durations[component, duration:] += value * tail / tail.sum()
            else:
                durations[component, duration - 1] += value
    return transitions, durations

# SPDX-License-Identifier: Apache-2.0
"""Hidden semi-Markov model: components follow each other, and each has its own distribution of durations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mild_core.inference.priors.prior import FitSettings, Prior
from mild_core.inference.priors.semi_markov_chain import ChainCounts, SemiMarkovChain, normalise_rows
from mild_core.shapes import FloatArray


@dataclass(frozen=True, eq=False)
class HSMM(Prior):
    """The prior of MILD. A segment's length is drawn when it starts; then another component follows.

    A lone component follows itself. The last one may go on to the first, so that an interaction can be repeated
    and no belief is ever lost.

    Source: section III-B of MILD; Yu (2010).
    """

    kind: ClassVar[str] = "hsmm"

    @staticmethod
    def check_chain(chain: SemiMarkovChain) -> None:
        """Raise ValueError when a component follows itself, except when it is alone."""
        if chain.components > 1 and np.diagonal(chain.transitions).any():
            raise ValueError("transitions of an HSMM have a zero diagonal: durations say how long a component stays")

    @staticmethod
    def first_chain(components: int, lengths: Sequence[int], settings: FitSettings) -> SemiMarkovChain:
        """Durations around the equal cuts, up to twice the longest one; mostly one component after the other."""
        cuts = np.asarray(lengths) / components
        longest = max(2, int(np.ceil(2.0 * cuts.max())))
        spread = max(float(cuts.std()), max(settings.duration_spread, 0.3) * float(cuts.mean()))
        row = _discretised_normal(
            np.array([cuts.mean()]), np.array([spread]), longest, max(settings.duration_floor, 0.01)
        )
        initial = np.full(components, 0.1 / components)
        initial[0] += 0.9
        return SemiMarkovChain(initial, _cyclic(components), np.repeat(row, components, axis=0))

    @staticmethod
    def estimate_chain(previous: SemiMarkovChain, counts: ChainCounts, settings: FitSettings) -> SemiMarkovChain:
        """Counts, kept from zero by what `settings` counts as seen before; durations with a proper spread."""
        components = previous.components
        initial = counts.initial + settings.pseudo_count / components
        transitions = counts.transitions + settings.pseudo_count * _cyclic(components)
        if settings.duration_spread > 0.0:
            durations = _spread(counts.durations, previous.durations, settings)
        else:
            floor = settings.duration_floor
            uniform = 1.0 / previous.longest
            durations = (1.0 - floor) * normalise_rows(counts.durations, previous.durations) + floor * uniform
        return SemiMarkovChain(
            normalise_rows(initial, previous.initial), normalise_rows(transitions, previous.transitions), durations
        )


def _cyclic(components: int) -> FloatArray:
    """(K, K) transitions mostly to the next component, from the last to the first, a little to any other."""
    if components == 1:
        return np.ones((1, 1))
    others = 0.1 / (components - 1)
    matrix = np.full((components, components), others)
    np.fill_diagonal(matrix, 0.0)
    matrix[np.arange(components), (np.arange(components) + 1) % components] += 0.9
    return matrix


def _discretised_normal(means: FloatArray, deviations: FloatArray, longest: int, floor: float) -> FloatArray:
    """(K, D) normal distributions on 1..D, mixed with a share `floor` of the uniform one."""
    frames = np.arange(1, longest + 1)
    logarithms = -0.5 * ((frames - means[:, None]) / deviations[:, None]) ** 2
    shapes = np.exp(logarithms - logarithms.max(axis=1, keepdims=True))
    result: FloatArray = (1.0 - floor) * shapes / shapes.sum(axis=1, keepdims=True) + floor / longest
    return result


def _spread(counts: FloatArray, previous: FloatArray, settings: FitSettings) -> FloatArray:
    """Durations as discretised normals of the expected counts' moments.

    A handful of demonstrations gives a handful of segments per component: their histogram would forbid every
    duration that was not among them.
    """
    histogram = normalise_rows(counts, previous)
    frames = np.arange(1, counts.shape[1] + 1)
    means = histogram @ frames
    deviations = np.sqrt(np.maximum(histogram @ frames**2 - means**2, 0.0))
    deviations = np.maximum(deviations, np.maximum(settings.duration_spread * means, 0.5))
    return _discretised_normal(means, deviations, counts.shape[1], settings.duration_floor)

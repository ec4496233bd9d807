# SPDX-License-Identifier: Apache-2.0
"""Gaussian mixture model: every frame draws its component independently, so there is no order and no memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mild_core.inference.priors.prior import FitSettings, Prior
from mild_core.inference.priors.semi_markov_chain import ChainCounts, SemiMarkovChain
from mild_core.shapes import FloatArray


@dataclass(frozen=True, eq=False)
class GMM(Prior):
    """The chain without memory: the start and every row of its transitions are the mixture's weights.

    Source: Calinon (2016), "A tutorial on task-parameterized movement learning and retrieval", section on GMR.
    """

    kind: ClassVar[str] = "gmm"

    @staticmethod
    def check_chain(chain: SemiMarkovChain) -> None:
        """Raise ValueError unless all rows are the same weights and segments last one frame."""
        if chain.longest != 1 or abs(chain.transitions - chain.initial).max() > 1e-9:
            raise ValueError("a GMM has durations of one frame, and its start equals every row of its transitions")

    @staticmethod
    def first_chain(components: int, lengths: Sequence[int], settings: FitSettings) -> SemiMarkovChain:
        """Equal weights."""
        return _mixture(np.full(components, 1.0 / components))

    @staticmethod
    def estimate_chain(previous: SemiMarkovChain, counts: ChainCounts, settings: FitSettings) -> SemiMarkovChain:
        """Weights in proportion to the frames of each component, however they were entered."""
        frames = counts.initial + counts.transitions.sum(axis=0) + settings.pseudo_count / previous.components
        return _mixture(frames / frames.sum())


def _mixture(weights: FloatArray) -> SemiMarkovChain:
    components = len(weights)
    return SemiMarkovChain(weights, np.tile(weights, (components, 1)), np.ones((components, 1)))

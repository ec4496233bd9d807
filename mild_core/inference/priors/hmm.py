# SPDX-License-Identifier: Apache-2.0
"""Hidden Markov model: components follow each other; how long one stays is a coin thrown at every frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mild_core.inference.priors.prior import FitSettings, Prior
from mild_core.inference.priors.semi_markov_chain import ChainCounts, SemiMarkovChain, normalise_rows


@dataclass(frozen=True, eq=False)
class HMM(Prior):
    """What eq. 6 of MILD amounts to as printed: its duration sums out, so that durations are geometric.

    Source: Rabiner (1989).
    """

    kind: ClassVar[str] = "hmm"

    @staticmethod
    def check_chain(chain: SemiMarkovChain) -> None:
        """Raise ValueError when segments last longer than a frame: staying is a transition here."""
        if chain.longest != 1:
            raise ValueError(f"an HMM has durations of one frame, not of up to {chain.longest}")

    @staticmethod
    def first_chain(components: int, lengths: Sequence[int], settings: FitSettings) -> SemiMarkovChain:
        """Stay as long as the equal cuts last on average; then mostly on to the next, from the last to the first."""
        leave = min(1.0, components / float(np.mean(lengths))) if components > 1 else 0.0
        transitions = np.full((components, components), 0.1 * leave / max(components - 1, 1))
        transitions[np.arange(components), (np.arange(components) + 1) % components] += 0.9 * leave
        np.fill_diagonal(transitions, 0.0)
        np.fill_diagonal(transitions, 1.0 - transitions.sum(axis=1))
        initial = np.full(components, 0.1 / components)
        initial[0] += 0.9
        return SemiMarkovChain(initial, transitions, np.ones((components, 1)))

    @staticmethod
    def estimate_chain(previous: SemiMarkovChain, counts: ChainCounts, settings: FitSettings) -> SemiMarkovChain:
        """Counts, kept from zero by what `settings` counts as seen before."""
        share = settings.pseudo_count / previous.components
        return SemiMarkovChain(
            normalise_rows(counts.initial + share, previous.initial),
            normalise_rows(counts.transitions + share, previous.transitions),
            previous.durations,
        )

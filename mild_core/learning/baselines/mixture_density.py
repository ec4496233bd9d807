# SPDX-License-Identifier: Apache-2.0
"""A mixture density network in the manner of MoVEInt, which is not told the interaction, and the same one told."""

from __future__ import annotations

from collections.abc import Sequence

from mild_core.learning.baseline import Baseline, Predictor
from mild_core.learning.demonstration import Demonstration
from mild_core.learning.windows import Protocol


def fit(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int, told: bool = False) -> Predictor:
    """Learn all interactions with one network; `told`: it knows which one it sees (see `Fit`)."""
    from mild_core.learning.mixture_density import MixtureDensity
    from mild_core.learning.recurrent import fit_recurrent

    return fit_recurrent(demonstrations, protocol, seed, MixtureDensity, told)


def fit_told(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> Predictor:
    """As `fit`, with the interaction."""
    return fit(demonstrations, protocol, seed, told=True)


MIXTURE_DENSITY = Baseline("mixture_density", "mixture density (as MoVEInt)", fit, seeded=True, told=False)
MIXTURE_DENSITY_TOLD = Baseline("mixture_density_told", "mixture density, told", fit_told, seeded=True)

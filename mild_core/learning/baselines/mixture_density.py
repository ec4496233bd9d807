# SPDX-License-Identifier: Apache-2.0
"""A mixture density network in the manner of MoVEInt, without the interaction as an input, and with it."""

from __future__ import annotations

from collections.abc import Sequence

from mild_core.learning.data.baseline import Baseline, Predictor
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol


def fit(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int, given: bool = False) -> Predictor:
    """Learn all interactions with one network; `given`: the interaction is an input (see `Fit`)."""
    from mild_core.learning.baselines.density_network import MixtureDensity
    from mild_core.learning.baselines.recurrent import fit_recurrent

    return fit_recurrent(
        demonstrations, protocol, seed, lambda view, answers: MixtureDensity(view.size, answers), given
    )


def fit_given(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> Predictor:
    """As `fit`, with the interaction."""
    return fit(demonstrations, protocol, seed, given=True)


MIXTURE_DENSITY = Baseline("mixture_density", "mixture density (as MoVEInt)", fit, seeded=True, uses_label=False)
MIXTURE_DENSITY_GIVEN = Baseline("mixture_density_given", "mixture density, given", fit_given, seeded=True)

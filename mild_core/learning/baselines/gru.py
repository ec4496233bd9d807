# SPDX-License-Identifier: Apache-2.0
"""A plain recurrent network: what a model without latent dynamics reaches."""

from __future__ import annotations

from collections.abc import Sequence

from mild_core.learning.data.baseline import Baseline, Predictor
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol


def fit(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> Predictor:
    """Learn all interactions with one network (see `Fit`)."""
    from mild_core.learning.baselines.recurrent import (
        fit_recurrent,  # torch takes seconds to import, and the others need none
    )

    return fit_recurrent(demonstrations, protocol, seed)


GRU = Baseline("gru", "plain GRU", fit, seeded=True)

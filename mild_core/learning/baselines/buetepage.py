# SPDX-License-Identifier: Apache-2.0
"""Bütepage et al.'s model: both agents in one embedding, the robot moved on in it from its own predictions alone."""

from __future__ import annotations

from collections.abc import Sequence

from mild_core.learning.data.baseline import Baseline, Predictor
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol


def fit(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> Predictor:
    """Learn all interactions with one network (see `Fit`)."""
    from mild_core.learning.baselines.recurrent import fit_recurrent
    from mild_core.learning.baselines.shared_embedding import SharedEmbedding

    return fit_recurrent(
        demonstrations, protocol, seed, lambda inputs, answers: SharedEmbedding(inputs, answers.shape[1])
    )


BUETEPAGE = Baseline("buetepage", "Bütepage et al.", fit, seeded=True)

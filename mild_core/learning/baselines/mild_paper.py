# SPDX-License-Identifier: Apache-2.0
"""MILD as the paper describes it, its misprints corrected: the same code as ours under the paper's settings."""

from __future__ import annotations

from collections.abc import Sequence

from mild_core.learning.data.baseline import Baseline, Predictor
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol


def fit(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> Predictor:
    """Train with preset "paper" (see `Fit`)."""
    from mild_core.learning.training.learned_model import (
        learn,  # torch takes seconds to import, and the others need none
    )
    from mild_core.learning.training.presets import PRESETS

    return learn(demonstrations, protocol, PRESETS["paper"], seed)


MILD_PAPER = Baseline("mild_paper", "MILD, the paper's", fit, seeded=True)

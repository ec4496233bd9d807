# SPDX-License-Identifier: Apache-2.0
"""All methods of the table of errors: the one that is shipped, and those it has to be measured beside."""

from __future__ import annotations

from collections.abc import Sequence

from mild_core.learning.baseline import Baseline, Predictor
from mild_core.learning.baselines import BASELINES
from mild_core.learning.demonstration import Demonstration
from mild_core.learning.settings import PRESETS
from mild_core.learning.windows import Protocol


def _fit_shipped(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> Predictor:
    """Train with the preset of the protocol (see `Fit`)."""
    from mild_core.learning.learned_model import learn

    return learn(demonstrations, protocol, PRESETS[protocol.name], seed)


SHIPPED = Baseline("mild", "MILD, ours", _fit_shipped, seeded=True)

METHODS: dict[str, Baseline] = {SHIPPED.name: SHIPPED, **BASELINES}
"""By name; the slow ones first, so that many cores end together."""

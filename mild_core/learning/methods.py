# SPDX-License-Identifier: Apache-2.0
"""All methods of the table of errors: the one that is shipped, and those it has to be measured beside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from mild_core.learning.baseline import Baseline, Predictor
from mild_core.learning.baselines import BASELINES
from mild_core.learning.configuration import settings_for
from mild_core.learning.demonstration import Demonstration
from mild_core.learning.settings import PRESETS, TrainingSettings
from mild_core.learning.windows import Protocol


def _fit_shipped(
    demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int, settings: TrainingSettings | None = None
) -> Predictor:
    """Train with `settings`, or the preset of the protocol (see `Fit`)."""
    from mild_core.learning.learned_model import learn

    return learn(demonstrations, protocol, settings or PRESETS[protocol.name], seed)


SHIPPED = Baseline("mild", "MILD, ours", _fit_shipped, seeded=True)

METHODS: dict[str, Baseline] = {SHIPPED.name: SHIPPED, **BASELINES}
"""By name; the slow ones first, so that many cores end together."""


def method_for(name: str, dataset: str, protocol: str, settings: TrainingSettings | None = None) -> Baseline:
    """A method as it is used on a recording: ours is trained as the model that is shipped for it.

    Args:
        name: Of `METHODS`.
        dataset: Name of the recording.
        protocol: Name of the protocol.
        settings: To train ours with instead.
    """
    method = METHODS[name]
    if method is not SHIPPED:
        return method
    return replace(SHIPPED, fit=partial(_fit_shipped, settings=settings or settings_for(dataset, protocol)))

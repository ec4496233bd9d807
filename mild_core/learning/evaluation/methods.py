# SPDX-License-Identifier: Apache-2.0
"""All methods of the table of errors: the one that is shipped, and those it has to be measured beside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from mild_core.learning.baselines import BASELINES
from mild_core.learning.data.baseline import Baseline, Predictor
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol
from mild_core.learning.training.configuration import Configuration
from mild_core.learning.training.presets import PRESETS


def _fit_shipped(
    demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int, configuration: Configuration | None = None
) -> Predictor:
    """Train as a configuration says, or with the preset of the protocol (see `Fit`)."""
    from mild_core.learning.training.learned_model import learn
    from mild_core.learning.training.transfer import start_of

    if configuration is None:
        return learn(demonstrations, protocol, PRESETS[protocol.name], seed)
    return learn(demonstrations, protocol, configuration.settings, seed, start_of(configuration))


SHIPPED = Baseline("mild", "MILD, ours", _fit_shipped, seeded=True)

METHODS: dict[str, Baseline] = {SHIPPED.name: SHIPPED, **BASELINES}
"""By name; the slow ones first, so that many cores end together."""


def method_for(name: str, configuration: Configuration | None) -> Baseline:
    """The method `name` of `METHODS`; ours as a configuration says, if there is one."""
    method = METHODS[name]
    return replace(method, fit=partial(_fit_shipped, configuration=configuration)) if method is SHIPPED else method

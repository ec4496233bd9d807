# SPDX-License-Identifier: Apache-2.0
"""Kernel ridge regression, one machine per interaction: the plain method that a learned model must not lose to.

It stores the recorded windows it learned from, so it is measured here and never shipped.
"""

from __future__ import annotations

from collections.abc import Sequence

from mild_core.learning.baselines.kernels import SearchGrid, fit_chosen, gaussian
from mild_core.learning.baselines.ridge import Regression
from mild_core.learning.data.baseline import Baseline, by_interaction
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol

GRID = SearchGrid(widths=(0.03, 0.1, 0.3, 1.0, 3.0), penalties=(0.1, 0.3, 1.0, 3.0, 10.0))


def fit(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> Regression:
    """Learn each interaction alone (see `Fit`)."""
    groups = by_interaction(demonstrations).items()
    return Regression(protocol, {name: fit_chosen(part, protocol, gaussian, GRID) for name, part in groups})


KERNEL_RIDGE = Baseline("kernel_ridge", "kernel ridge", fit, seeded=False)

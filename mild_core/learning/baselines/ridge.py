# SPDX-License-Identifier: Apache-2.0
"""A linear map from the human's window to the robot's, one per interaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mild_core.learning.baselines.kernels import KernelMachine, SearchGrid, fit_chosen, linear
from mild_core.learning.data.baseline import Baseline, by_interaction
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol, cut
from mild_core.shapes import FloatArray

GRID = SearchGrid(widths=(1.0,), penalties=(1.0, 10.0, 100.0, 1000.0, 10000.0))


@dataclass(frozen=True, eq=False)
class Regression:
    """A machine for each interaction."""

    protocol: Protocol
    machines: Mapping[str, KernelMachine]

    def predict(self, demonstration: Demonstration) -> FloatArray:
        """Each window on its own (see `Predictor`)."""
        windows = cut(demonstration, self.protocol)
        machine = self.machines[demonstration.interaction]
        return machine.answers(windows.observed.reshape(len(windows.observed), -1)).reshape(windows.controlled.shape)


def fit(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> Regression:
    """Learn each interaction alone (see `Fit`)."""
    groups = by_interaction(demonstrations).items()
    return Regression(protocol, {name: fit_chosen(part, protocol, linear, GRID) for name, part in groups})


RIDGE = Baseline("ridge", "ridge", fit, seeded=False)

# SPDX-License-Identifier: Apache-2.0
"""What every method promises that is compared in one table, the shipped one included."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol as TypingProtocol

import numpy as np

from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol, cut
from mild_core.shapes import FloatArray

GIVEN, RECOGNISED, UNKNOWN, STARTED = "given", "recognised", "unknown", "given, start pose"
"""What a method is given: the interaction; nothing, so that it has to recognise it; nothing, as it uses none; or the
interaction and where the robot stood before."""


class Predictor(TypingProtocol):
    """What a method has learned."""

    def predict(self, demonstration: Demonstration) -> FloatArray:
        """Answer every window of a trial from what the human has shown by then, never from the answer.

        Args:
            demonstration: A trial. Its interaction may be looked at; its `controlled` may not.

        Returns:
            (N, W, J) joint angles [rad], or (N, W, J, 3) the partner's arm [m], in the order of `windows.cut`.
        """
        ...


Fit = Callable[[Sequence[Demonstration], Protocol, int], Predictor]
"""(trials to learn from, protocol, seed) -> what was learned. Equal arguments give equal predictors."""


@dataclass(frozen=True)
class Baseline:
    """One method of the table.

    Attributes:
        name: Its name in `BASELINES`.
        title: For the table.
        fit: Learns it.
        seeded: Whether the seed changes anything; if not, one seed is enough.
        uses_label: Whether its predictor uses the interaction of a trial.
    """

    name: str
    title: str
    fit: Fit
    seeded: bool
    uses_label: bool = True


def by_interaction(demonstrations: Sequence[Demonstration]) -> Mapping[str, tuple[Demonstration, ...]]:
    """The trials of each interaction, in order."""
    names = dict.fromkeys(demonstration.interaction for demonstration in demonstrations)
    return {name: tuple(d for d in demonstrations if d.interaction == name) for name in names}


def window_matrices(
    demonstrations: Sequence[Demonstration], protocol: Protocol, stride: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Questions and answers of trials, one flattened window a row.

    Args:
        demonstrations: Trials.
        protocol: How to cut them.
        stride: Every how many windows one is taken: neighbours are almost equal.

    Returns:
        (N, W D) features and (N, W J) answers.
    """
    windows = [cut(demonstration, protocol) for demonstration in demonstrations]
    observed = np.concatenate([w.observed[::stride].reshape(len(w.observed[::stride]), -1) for w in windows])
    controlled = np.concatenate([w.controlled[::stride].reshape(len(w.controlled[::stride]), -1) for w in windows])
    return observed, controlled

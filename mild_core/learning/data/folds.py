# SPDX-License-Identifier: Apache-2.0
"""Which trials are learned from and which are held out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from mild_core.errors import DatasetError
from mild_core.learning.data.demonstration import Demonstration

FOLDS = 4


@dataclass(frozen=True)
class Fold:
    """One division of the trials."""

    learned: tuple[Demonstration, ...]
    held_out: tuple[Demonstration, ...]


LEAST_TRIALS = 3
"""Of an interaction, for a cross-validation: with two, a method learns from one and has none left to choose by."""


def require_folds(demonstrations: Sequence[Demonstration], interactions: Sequence[str]) -> None:
    """Refuse a recording that cannot be divided.

    Raises:
        DatasetError: It has no trial, or too few of an interaction that it shows.
    """
    counts = Counter(demonstration.interaction for demonstration in demonstrations)
    for name in interactions:
        if 0 < counts[name] < LEAST_TRIALS:
            problem = (
                f"interaction '{name}' has {counts[name]} training trials, a cross-validation needs {LEAST_TRIALS}"
            )
            raise DatasetError("recording", problem, "record more, or leave the interaction out")
    if not counts:
        raise DatasetError("recording", "its training split is empty", "give a recording with training trials")


def folds_of(demonstrations: Sequence[Demonstration], count: int = FOLDS) -> tuple[Fold, ...]:
    """Divide trials so that each is held out once and each interaction is spread evenly.

    A trial's fold is its index within its interaction modulo `count`; windows of one trial are never divided, because
    they overlap.

    Args:
        demonstrations: In the order of the recording.
        count: Number of folds.

    Source: ours; the publishers divide the trials into training and test only.
    """
    seen: Counter[str] = Counter()
    fold_of = []
    for demonstration in demonstrations:
        fold_of.append(seen[demonstration.interaction] % count)
        seen[demonstration.interaction] += 1
    paired = tuple(zip(fold_of, demonstrations, strict=True))
    return tuple(
        Fold(tuple(d for f, d in paired if f != index), tuple(d for f, d in paired if f == index))
        for index in range(count)
    )

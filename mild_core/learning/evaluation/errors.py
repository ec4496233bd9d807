# SPDX-License-Identifier: Apache-2.0
"""How wrong predictions are: per interaction and over all, with intervals over trials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol, cut
from mild_core.shapes import FloatArray, require_shape

BOOTSTRAP_DRAWS = 2000


@dataclass(frozen=True, eq=False)
class TrialErrors:
    """Errors of the windows of one trial.

    Attributes:
        trial: Index in the recording.
        interaction: Its name.
        squared: (N,) squared error averaged over joints and window [rad^2]; of two people, the squared distance
            averaged over joints and window [m^2].
        absolute: (N,) absolute error averaged alike [rad]; of two people, the distance [m].
        covariance: (J, J) mean of error times error over frames and windows [rad^2]; of two people (3 J, 3 J) [m^2].
    """

    trial: int
    interaction: str
    squared: FloatArray
    absolute: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class InteractionErrors:
    """Errors over the windows of one interaction; None of none.

    Attributes:
        mse: Mean of the squared error [rad^2 or m^2].
        mse_std: Its standard deviation over windows.
        mean_absolute: Mean of the absolute error [rad or m].
        windows: How many.
        trials: How many.
    """

    mse: float | None
    mse_std: float | None
    mean_absolute: float | None
    windows: int
    trials: int


@dataclass(frozen=True, eq=False)
class Errors:
    """What is reported of a method on some trials.

    Attributes:
        interactions: By name.
        macro_mse: Mean over the interactions that have windows; None when none has.
        macro_interval: 95 % interval of it, by drawing trials within each interaction.
        pooled_rmse: Root of the squared error averaged over all windows [rad or m].
        mean_absolute: Absolute error averaged over all windows [rad or m].
        windows: N over all.
        trials: Number of trials.
        covariance: (J, J) mean of error times error over all windows; None of none.
    """

    interactions: dict[str, InteractionErrors]
    macro_mse: float | None
    macro_interval: tuple[float, float] | None
    pooled_rmse: float | None
    mean_absolute: float | None
    windows: int
    trials: int
    covariance: FloatArray | None


def errors_of_trial(demonstration: Demonstration, protocol: Protocol, predicted: FloatArray) -> TrialErrors:
    """Compare a prediction with what the controlled agent did.

    Args:
        demonstration: The trial.
        protocol: By which it is cut.
        predicted: (N, W, J) [rad] or (N, W, J, 3) [m].

    Raises:
        ValueError: `predicted` has another shape or is not finite.

    Source: the squared error of the MILD paper's tables; all windows at stride 1, resting ones included.
    """
    true = cut(demonstration, protocol).controlled
    require_shape("predicted", predicted, true.shape)
    if not np.isfinite(predicted).all():
        raise ValueError(f"the prediction for trial {demonstration.trial} is not finite")
    error = predicted - true
    squared = error**2 if error.ndim == 3 else (error**2).sum(axis=3)
    rows = error.reshape(true.shape[0] * true.shape[1], -1)
    return TrialErrors(
        trial=demonstration.trial,
        interaction=demonstration.interaction,
        squared=squared.mean((1, 2)),
        absolute=np.sqrt(squared).mean((1, 2)),
        covariance=rows.T @ rows / max(len(rows), 1),
    )


def summarise(trials: Sequence[TrialErrors], interactions: Sequence[str], seed: int = 0) -> Errors:
    """Put the errors of trials together.

    Args:
        trials: Errors by trial; may be empty.
        interactions: All that shall be reported, also those without a trial.
        seed: Of the draws of trials.
    """
    trials = [trial for trial in trials if len(trial.squared)]
    by_interaction = {name: [t for t in trials if t.interaction == name] for name in interactions}
    rows = {name: _row(parts) for name, parts in by_interaction.items()}
    if not trials:
        return Errors(rows, None, None, None, None, 0, 0, None)
    squared = np.concatenate([trial.squared for trial in trials])
    absolute = np.concatenate([trial.absolute for trial in trials])
    groups = [[trial.squared for trial in parts] for parts in by_interaction.values() if parts]
    return Errors(
        interactions=rows,
        macro_mse=float(np.mean([np.concatenate(parts).mean() for parts in groups])),
        macro_interval=_interval(groups, seed),
        pooled_rmse=math.sqrt(squared.mean()),
        mean_absolute=float(absolute.mean()),
        windows=len(squared),
        trials=len(trials),
        covariance=np.average([t.covariance for t in trials], axis=0, weights=[len(t.squared) for t in trials]),
    )


def _row(parts: Sequence[TrialErrors]) -> InteractionErrors:
    if not parts:
        return InteractionErrors(None, None, None, 0, 0)
    squared, absolute = (np.concatenate([getattr(part, name) for part in parts]) for name in ("squared", "absolute"))
    mse, deviation = float(squared.mean()), float(squared.std())
    return InteractionErrors(mse, deviation, float(absolute.mean()), len(squared), len(parts))


def _interval(groups: Sequence[Sequence[FloatArray]], seed: int) -> tuple[float, float]:
    """95 % interval of the macro error when trials, not their overlapping windows, are drawn with replacement."""
    rng = np.random.default_rng(seed)
    macro = np.zeros(BOOTSTRAP_DRAWS)
    for parts in groups:
        sums, counts = np.array([part.sum() for part in parts]), np.array([len(part) for part in parts])
        drawn = rng.integers(len(parts), size=(BOOTSTRAP_DRAWS, len(parts)))
        macro += sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1) / len(groups)
    low, high = np.quantile(macro, [0.025, 0.975])
    return float(low), float(high)

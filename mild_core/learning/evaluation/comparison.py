# SPDX-License-Identifier: Apache-2.0
"""The table of a cross-validation: each method's error, how sure it is, and what it is relative to the bars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import wilcoxon  # type: ignore[import-untyped]  # scipy brings no types

from mild_core.learning.evaluation.cross_validation import Result
from mild_core.learning.evaluation.errors import BOOTSTRAP_DRAWS, Errors, TrialErrors, summarise
from mild_core.learning.evaluation.methods import METHODS
from mild_core.learning.evaluation.run_time import HeldOut, RunTime, summarise_run_time
from mild_core.shapes import FloatArray

BARS = ("mild_paper", "kernel_ridge", "gru")
"""What every method is compared with."""

PAPERS_BAR = "buetepage"
"""What the tables of the MILD paper test each interaction against."""


@dataclass(frozen=True)
class Relative:
    """Change of the macro error against another method on the same trials: -0.25 is a quarter less.

    Attributes:
        change: Of the means over seeds.
        interval: 95 %, by drawing trials, the same for both.
        p_value: Of Wilcoxon's signed-rank test, two-sided, on the trials' mean errors: how often chance alone would set
            equally good methods so far apart; 1 where no trial distinguishes them.
    """

    change: float
    interval: tuple[float, float]
    p_value: float


@dataclass(frozen=True)
class Row:
    """One method, with one kind of labels.

    Attributes:
        method: Name in `METHODS`.
        title: For people.
        labels: Which labels it was given, see `baseline.GIVEN`.
        seeds: How many were run.
        macro_mean: Macro squared error, mean over seeds.
        macro_std: Its standard deviation over seeds; None with one seed.
        errors: Of the squared errors averaged over seeds, trial by trial.
        relative: Against each of `BARS` that was run (labels given), by its name.
        seconds: To learn one fold, mean.
        run_time: What the run-time stage did with the trials; None for a method that it does not run.
        p_against_buetepage: By interaction, of the same test as in `Relative`, on its trials alone, against Bütepage et
            al. with labels given; empty where that was not run, and of itself.
    """

    method: str
    title: str
    labels: str
    seeds: int
    macro_mean: float
    macro_std: float | None
    errors: Errors
    relative: Mapping[str, Relative]
    seconds: float
    run_time: RunTime | None = None
    p_against_buetepage: Mapping[str, float] = field(default_factory=dict)


def compare(results: Sequence[Result], interactions: Sequence[str]) -> tuple[Row, ...]:
    """Put results of jobs together, best method first.

    Args:
        results: Of all folds of each method and seed, in any order.
        interactions: Names to report.
    """
    groups: dict[tuple[str, str], dict[int, list[TrialErrors]]] = {}
    held_out: dict[str, dict[int, list[HeldOut]]] = {}
    for result in sorted(results, key=lambda one: (one.job.seed, one.job.fold)):
        for labels, errors in result.errors.items():
            groups.setdefault((result.job.method, labels), {}).setdefault(result.job.seed, []).extend(errors)
        if result.held_out:
            held_out.setdefault(result.job.method, {}).setdefault(result.job.seed, []).extend(result.held_out)
    averaged = {key: averaged_over_seeds(list(seeds.values())) for key, seeds in groups.items()}
    run_times = {method: summarise_run_time(list(seeds.values())) for method, seeds in held_out.items()}
    bars = {name: averaged[name, "given"] for name in BARS if (name, "given") in averaged}
    papers_bar = averaged.get((PAPERS_BAR, "given"))
    rows = []
    for (method, labels), seeds in groups.items():
        macro = [summarise(errors, interactions).macro_mse or 0.0 for errors in seeds.values()]
        mean = averaged[method, labels]
        rows.append(
            Row(
                method=method,
                title=METHODS[method].title,
                labels=labels,
                seeds=len(seeds),
                macro_mean=float(np.mean(macro)),
                macro_std=float(np.std(macro, ddof=1)) if len(macro) > 1 else None,
                errors=summarise(mean, interactions),
                relative={name: change_against(mean, bar) for name, bar in bars.items() if name != method},
                seconds=float(np.mean([result.seconds for result in results if result.job.method == method])),
                run_time=run_times.get(method),
                p_against_buetepage=_by_interaction(mean, papers_bar) if papers_bar and method != PAPERS_BAR else {},
            )
        )
    return tuple(sorted(rows, key=lambda row: row.macro_mean))


def averaged_over_seeds(seeds: Sequence[Sequence[TrialErrors]]) -> list[TrialErrors]:
    """The errors of each trial, averaged over seeds window by window."""
    by_trial: dict[int, list[TrialErrors]] = {}
    for errors in seeds:
        for one in errors:
            by_trial.setdefault(one.trial, []).append(one)
    return [
        TrialErrors(
            trial,
            parts[0].interaction,
            np.mean([part.squared for part in parts], axis=0),
            np.mean([part.absolute for part in parts], axis=0),
            np.mean([part.covariance for part in parts], axis=0),
        )
        for trial, parts in sorted(by_trial.items())
    ]


def _macro(errors: Sequence[TrialErrors], drawn: Mapping[str, NDArray[np.intp]]) -> FloatArray:
    """(draws,) macro error of the trials drawn, (draws, trials) indices of each interaction."""
    parts = []
    for interaction, indices in drawn.items():
        mine = [one for one in errors if one.interaction == interaction]
        sums, counts = np.array([one.squared.sum() for one in mine]), np.array([len(one.squared) for one in mine])
        parts.append(sums[indices].sum(axis=1) / counts[indices].sum(axis=1))
    macro: FloatArray = np.mean(parts, axis=0)
    return macro


def change_against(errors: Sequence[TrialErrors], bar: Sequence[TrialErrors], seed: int = 0) -> Relative:
    """Paired: both methods meet the same drawn trials, so what is hard for both cancels."""
    rng = np.random.default_rng(seed)
    names = sorted({one.interaction for one in bar})
    trials = {name: sum(1 for one in bar if one.interaction == name) for name in names}
    all_once = {name: np.arange(count)[None] for name, count in trials.items()}
    drawn = {name: rng.integers(count, size=(BOOTSTRAP_DRAWS, count)) for name, count in trials.items()}
    change = float((_macro(errors, all_once) / _macro(bar, all_once))[0] - 1)
    low, high = np.quantile(_macro(errors, drawn) / _macro(bar, drawn) - 1, [0.025, 0.975])
    return Relative(change, (float(low), float(high)), _p_value(errors, bar))


def _by_interaction(errors: Sequence[TrialErrors], bar: Sequence[TrialErrors]) -> dict[str, float]:
    """`_p_value` of the trials of each interaction."""
    names = dict.fromkeys(one.interaction for one in bar)
    return {name: _p_value([one for one in errors if one.interaction == name], bar) for name in names}


def _p_value(errors: Sequence[TrialErrors], bar: Sequence[TrialErrors]) -> float:
    """Source: F. Wilcoxon, "Individual comparisons by ranking methods", 1945, as scipy has it."""
    scored = {one.trial: one.squared.mean() for one in bar if len(one.squared)}
    differences = [one.squared.mean() - scored[one.trial] for one in errors if one.trial in scored]
    if not np.any(differences):
        return 1.0
    return float(wilcoxon(differences).pvalue)

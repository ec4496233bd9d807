# SPDX-License-Identifier: Apache-2.0
"""What a robot would have done with trials that were held out: recognise them or not, and know how sure it is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.learning.calibration import Calibration, Doubt, calibrate
from mild_core.learning.demonstration import Demonstration
from mild_core.learning.model_predictor import AUTO, ModelPredictor
from mild_core.learning.novelty import SETTLED_S
from mild_core.learning.windows import cut, onset_window

AFTER_S = (1.0, 5.0)
"""Seconds after the onset of a motion at which it is asked which interaction the model acts upon."""

EVERY = 5
"""Windows from one to the next whose covariance is looked at: neighbours are almost equal."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """The run-time stage on one trial, window by window as on the robot.

    Attributes:
        named: The interaction that it acted upon, unasked, at each of `AFTER_S`; "" for none.
        unknown: Share of the frames that it called unknown, from a second after the onset.
        doubt: Errors and covariances, the interaction given.
    """

    named: tuple[str, ...]
    unknown: float
    doubt: Doubt


@dataclass(frozen=True, eq=False)
class RunTime:
    """All held-out trials.

    Attributes:
        trials: How many there were.
        wrong: At each of `AFTER_S`, in how many of them it acted upon none or another interaction; mean over seeds.
        unknown: Share of the frames called unknown, mean over trials and seeds: all are false alarms.
        calibration: One per seed.
    """

    trials: int
    wrong: Mapping[float, float]
    unknown: float
    calibrations: tuple[Calibration, ...]


def watch(predictor: ModelPredictor, trial: Demonstration, fold: int) -> HeldOut:
    """Run a trial twice, the interaction unknown and given.

    Args:
        predictor: What was learned without the trial.
        trial: Which.
        fold: In which it is held out.
    """
    free, told = predictor.answers(trial, AUTO), predictor.answers(trial, trial.interaction)
    last = len(free.interactions) - 1
    named = [free.interactions[min(last, onset_window(trial, predictor.protocol, s))] for s in AFTER_S]
    settled = min(last, onset_window(trial, predictor.protocol, SETTLED_S))
    unknown = float(np.mean(free.out_of_distribution[settled:] > 1.0))
    errors = (told.predicted - cut(trial, predictor.protocol).controlled)[::EVERY]
    errors = errors.reshape(*errors.shape[:2], -1)
    spread = told.covariances[::EVERY] - predictor.model.residual_covariance
    return HeldOut(tuple(named), unknown, Doubt(fold, trial.interaction, errors, spread))


def summarise_run_time(seeds: Sequence[Sequence[HeldOut]]) -> RunTime:
    """Put the trials of each seed together."""
    wrong = Counter(dict.fromkeys(AFTER_S, 0))
    for trials in seeds:
        for one in trials:
            wrong.update(s for s, name in zip(AFTER_S, one.named, strict=True) if name != one.doubt.interaction)
    return RunTime(
        len(seeds[0]),
        {s: count / len(seeds) for s, count in wrong.items()},
        float(np.mean([one.unknown for trials in seeds for one in trials])),
        tuple(calibrate([one.doubt for one in trials]) for trials in seeds),
    )

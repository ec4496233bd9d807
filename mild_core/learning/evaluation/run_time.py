# SPDX-License-Identifier: Apache-2.0
"""What a robot would have done with trials that were held out: recognise them or not, and know how sure it is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.learning.data.baseline import GIVEN, RECOGNISED, STARTED
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import cut, onset_window
from mild_core.learning.evaluation.errors import errors_of_trial
from mild_core.learning.evaluation.uncertainty_calibration import CalibrationSample, UncertaintyCalibration, calibrate
from mild_core.learning.training.model_predictor import AUTO, Answers, ModelPredictor
from mild_core.learning.training.novelty import SETTLED_S
from mild_core.shapes import FloatArray

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
        windows: How many there were.
        squared: (3,) sums over them of squared errors [rad^2 or m^2]: the interaction given; what is added where it is
            not, up to a second after the onset; and later.
    """

    named: tuple[str, ...]
    unknown: float
    doubt: CalibrationSample
    windows: int
    squared: FloatArray


@dataclass(frozen=True, eq=False)
class RunTime:
    """All held-out trials.

    Attributes:
        trials: How many there were.
        wrong: At each of `AFTER_S`, in how many of them it acted upon none or another interaction; mean over seeds.
        unknown: Share of the frames called unknown, mean over trials and seeds: all are false alarms.
        recognition_cost: (2,) share by which the error grows where the interaction is not given, in frames up to a
            second after the onset, where a resting person shows nothing, and in later ones; macro, mean over seeds.
        calibration: One per seed.
    """

    trials: int
    wrong: Mapping[float, float]
    unknown: float
    recognition_cost: FloatArray
    calibrations: tuple[UncertaintyCalibration, ...]


def label_kinds(predictor: ModelPredictor) -> tuple[str, ...]:
    """All kinds of labels a model can be given, see `baseline.GIVEN`."""
    return (GIVEN, RECOGNISED) if predictor.model.start_pose is None else (GIVEN, RECOGNISED, STARTED)


def run_trial(predictor: ModelPredictor, trial: Demonstration) -> dict[str, Answers]:
    """Run a held-out trial by the run-time stage, once for each of `label_kinds`."""
    return {
        labels: predictor.answers(trial, AUTO if labels == RECOGNISED else trial.interaction, started=labels == STARTED)
        for labels in label_kinds(predictor)
    }


def watch(predictor: ModelPredictor, trial: Demonstration, run: Mapping[str, Answers], fold: int) -> HeldOut:
    """What is reported of a run beside its errors.

    Args:
        predictor: What was learned without the trial.
        trial: Which.
        run: What `run_trial` says of it.
        fold: In which it is held out.
    """
    given, recognised = run[GIVEN], run[RECOGNISED]
    last = len(recognised.interactions) - 1
    named = [recognised.interactions[min(last, onset_window(trial, predictor.protocol, s))] for s in AFTER_S]
    settled = min(last, onset_window(trial, predictor.protocol, SETTLED_S))
    unknown = float(np.mean(recognised.out_of_distribution[settled:] > 1.0))
    errors = (given.predicted - cut(trial, predictor.protocol).controlled)[::EVERY]
    errors = errors.reshape(*errors.shape[:2], -1)
    spread = given.covariances[::EVERY] - predictor.model.residual_covariance
    errors_given, errors_recognised = (
        errors_of_trial(trial, predictor.protocol, one.predicted).squared for one in (given, recognised)
    )
    more = errors_recognised - errors_given
    squared = np.array([errors_given.sum(), more[:settled].sum(), more[settled:].sum()])
    return HeldOut(
        tuple(named), unknown, CalibrationSample(fold, trial.interaction, errors, spread), len(errors_given), squared
    )


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
        np.mean([_recognition_cost(trials) for trials in seeds], axis=0),
        tuple(calibrate([one.doubt for one in trials]) for trials in seeds),
    )


def _recognition_cost(trials: Sequence[HeldOut]) -> FloatArray:
    """(2,) see `RunTime.recognition_cost`."""
    groups = [[t for t in trials if t.doubt.interaction == name] for name in {t.doubt.interaction for t in trials}]
    means = [np.sum([t.squared for t in group], axis=0) / sum(t.windows for t in group) for group in groups]
    given, *added = (float(mean) for mean in np.mean(means, axis=0))
    return np.array([share / given for share in added])

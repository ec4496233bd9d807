# SPDX-License-Identifier: Apache-2.0
"""Learning a reservoir's readouts: the answers of each interaction alone, and from all of them which one it is.

Each is one linear system; its penalty, and the sharpness of its classification, are chosen on held-out trials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mild_core.inference.reservoir import Reservoir
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol
from mild_core.learning.training.corpus import Corpus, corpus_of
from mild_core.learning.training.reservoir_trials import STRIDE, Trial, answers_of, probabilities_of, seen_trials
from mild_core.learning.training.ridge import Linear, solve, total
from mild_core.learning.training.settings import ReservoirSettings, TrainingSettings
from mild_core.shapes import FloatArray

PENALTIES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
LABEL_PENALTIES = (0.001, 0.01, 0.1, 1.0, 10.0)
SHARPNESSES = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 13.0)
INNER_FOLDS = 3

ANSWER_COORDINATES = 20
"""Principal components of the controlled agent's window: they hold all but a thousandth of its variance."""

LEAST_SCALE_M = 1e-6
"""Positions that differ by less do not differ."""


@dataclass(frozen=True, eq=False)
class _Part:
    """One reservoir of several.

    Attributes:
        units: Without readouts.
        answers: A readout for each interaction.
        labels: That of the interactions' probabilities.
        left_out: (n, A) answers of those that have not learned from a trial, for each trial.
        class_scores: (n, P) of the interactions, likewise.
    """

    units: Reservoir
    answers: list[Linear]
    labels: Linear
    left_out: list[FloatArray]
    class_scores: list[FloatArray]


_Folds = list[tuple[list[int], list[int]]]
"""Numbers of the trials learned from, and of those left out."""


def fit_reservoir(
    demonstrations: Sequence[Demonstration],
    protocol: Protocol,
    interactions: Sequence[str],
    training: TrainingSettings,
    seed: int,
) -> tuple[Reservoir, list[FloatArray]] | None:
    """Draw units, learn their readouts.

    Args:
        demonstrations: Of every interaction at least one.
        protocol: How to cut them.
        interactions: By label.
        training: Its `reservoir`, for which None gives None, and its `augmentation`.
        seed: Of all draws.

    Returns:
        The reservoir, and what one that had not learned from it answers to every `STRIDE`-th window of each trial,
        (n, W J).
    """
    settings = training.reservoir
    if settings is None:
        return None
    corpus = corpus_of(demonstrations, protocol, interactions, training.paired, seed)
    every = np.concatenate(answers_of(corpus, corpus.everything))
    mean = every.mean(axis=0)
    back = np.linalg.svd((every - mean)[::STRIDE], full_matrices=False)[2][:ANSWER_COORDINATES]
    parts = [_learn(corpus, training, (seed, number), back, mean) for number in range(settings.count)]
    left_out, scores = (
        [np.mean(said, axis=0) for said in zip(*of_parts, strict=True)]
        for of_parts in ([part.left_out for part in parts], [part.class_scores for part in parts])
    )
    sharpness = _sharpness(np.concatenate(scores), np.concatenate(probabilities_of(corpus, corpus.tracks)))
    return _together(parts, sharpness), [answer @ back + mean for answer in left_out]


def _learn(
    corpus: Corpus, training: TrainingSettings, seed: tuple[int, int], back: FloatArray, mean: FloatArray
) -> _Part:
    """One reservoir and its readouts."""
    assert training.reservoir is not None
    units = _drawn(corpus, training.reservoir, np.random.default_rng(seed), back, mean)
    trials = seen_trials(corpus, units, training, seed)
    scale = total([trial.moments for trial in trials]).scale()
    answer, label = slice(len(back)), slice(len(back), None)
    known = sorted({trial.label for trial in trials})
    apart = [fold for one in known for fold in _folds(trials, [one])]
    together = _folds(trials, known)
    penalty = _chosen(trials, scale, apart, PENALTIES, answer)
    label_penalty = _chosen(trials, scale, together, LABEL_PENALTIES, label)
    return _Part(
        units,
        [_readout([t for t in trials if t.label == one], scale, penalty, answer) for one in known],
        _readout(trials, scale, label_penalty, label),
        _left_out(trials, scale, apart, penalty, answer),
        _left_out(trials, scale, together, label_penalty, label),
    )


def _drawn(
    corpus: Corpus, settings: ReservoirSettings, rng: np.random.Generator, back: FloatArray, mean: FloatArray
) -> Reservoir:
    """Units without readouts."""
    recorded = corpus.tracks.observed[corpus.tracks.alive].double().numpy()
    centre, scale = recorded.mean(axis=0), max(float(recorded.std()), LEAST_SCALE_M)
    values, units, labels = len(centre), settings.units, len(corpus.interactions)
    intake = settings.input_scale * rng.normal(size=(2 * values + 1, units))
    intake[:values] /= scale
    intake[values:-1] *= settings.velocity_weight_s / scale
    intake[-1] -= centre @ intake[:values]
    strengths = rng.choice([-1.0, 1.0], (settings.sources, units)) * settings.gain / np.sqrt(settings.sources)
    slowest, fastest = np.log(settings.time_constants_s[1]), np.log(settings.time_constants_s[0])
    leak = 1.0 - np.exp(-1.0 / (corpus.rate_hz * np.exp(rng.uniform(fastest, slowest, units))))
    return Reservoir(
        intake=_single(intake),
        sources=np.array([rng.permutation(units) for _ in range(settings.sources)], dtype=np.float64),
        strengths=_single(strengths),
        leak=_single(leak),
        readout=np.zeros((labels, units + 3 * values, len(back))),
        bias=np.zeros((labels, len(back))),
        back=back,
        mean=mean,
        share=np.array([settings.share]),
        label_weight=np.zeros((units + 3 * values, labels)),
        label_bias=np.zeros(labels),
    )


def _single(array: FloatArray) -> FloatArray:
    """Rounded to what a model folder stores, so that what is learned here runs alike there."""
    return array.astype(np.float32).astype(np.float64)


def _readout(trials: Sequence[Trial], scale: FloatArray, penalty: float, columns: slice) -> Linear:
    """Of some trials, to some columns of what is wanted."""
    one = solve(total([trial.moments for trial in trials]), scale, penalty)
    return Linear(one.weight[:, columns], one.bias[columns])


def _folds(trials: Sequence[Trial], labels: Sequence[int]) -> _Folds:
    """Of the trials of some interactions a third of each left out, three times; a single one never is."""
    own = [[place for place, trial in enumerate(trials) if trial.label == label] for label in labels]
    found = []
    for fold in range(INNER_FOLDS):
        out = [place for places in own if len(places) > 1 for place in places[fold::INNER_FOLDS]]
        if out:
            found.append(([place for places in own for place in places if place not in out], out))
    return found


def _chosen(
    trials: Sequence[Trial], scale: FloatArray, folds: _Folds, penalties: Sequence[float], columns: slice
) -> float:
    """The penalty with the least sum over interactions of errors relative to the interaction's least."""
    errors = np.zeros((max(trial.label for trial in trials) + 1, len(penalties)))
    for learned, out in folds:
        moments = total([trials[place].moments for place in learned])
        for column, penalty in enumerate(penalties):
            one = solve(moments, scale, penalty)
            for trial in (trials[place] for place in out):
                errors[trial.label, column] += ((one.answer(trial.features) - trial.wanted)[:, columns] ** 2).sum()
    errors /= np.maximum(errors.min(axis=1, keepdims=True), np.finfo(float).tiny)
    return penalties[int(errors.sum(axis=0).argmin())]


def _left_out(
    trials: Sequence[Trial], scale: FloatArray, folds: _Folds, penalty: float, columns: slice
) -> list[FloatArray]:
    """What is said of each trial by readouts learned without it; of one that is never left out, what is mostly so."""
    said = [np.tile(trial.wanted[:, columns].mean(axis=0), (len(trial.wanted), 1)) for trial in trials]
    for learned, out in folds:
        one = _readout([trials[place] for place in learned], scale, penalty, columns)
        for place in out:
            said[place] = one.answer(trials[place].features)
    return said


def _sharpness(scores: FloatArray, probable: FloatArray) -> float:
    """Factor of `scores` (n, P) whose softmax comes closest to the probabilities (n, P)."""

    def surprise(sharpness: float) -> float:
        logits = sharpness * scores
        return float((probable * (np.logaddexp.reduce(logits, axis=1, keepdims=True) - logits)).sum())

    return min(SHARPNESSES, key=surprise)


def _together(parts: Sequence[_Part], sharpness: float) -> Reservoir:
    """Several reservoirs as one, whose answer is the mean of theirs."""
    first, units = parts[0].units, len(parts[0].units.leak)
    readouts = [_side_by_side(own, units) for own in zip(*(part.answers for part in parts), strict=True)]
    labels = _side_by_side([part.labels for part in parts], units)
    return replace(
        first,
        intake=np.hstack([part.units.intake for part in parts]),
        sources=np.hstack([part.units.sources + number * units for number, part in enumerate(parts)]),
        strengths=np.hstack([part.units.strengths for part in parts]),
        leak=np.concatenate([part.units.leak for part in parts]),
        readout=np.array([one.weight for one in readouts]),
        bias=np.array([one.bias for one in readouts]),
        label_weight=sharpness * labels.weight,
        label_bias=sharpness * labels.bias,
    )


def _side_by_side(readouts: Sequence[Linear], units: int) -> Linear:
    """The mean of several readouts, each of its own `units` units and all of the same frames."""
    weights = [one.weight / len(readouts) for one in readouts]
    frames = sum((weight[units:] for weight in weights[1:]), weights[0][units:])
    bias: FloatArray = np.mean([one.bias for one in readouts], axis=0)
    return Linear(np.vstack([*(weight[:units] for weight in weights), frames]), bias)

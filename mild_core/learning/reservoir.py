# SPDX-License-Identifier: Apache-2.0
"""Learning a reservoir's readouts: one linear system per interaction, its penalty by trials left out.

A trial begins a second or two before its motion, and how long before is nearly the same in all: units that remember
could read the time from that and answer it instead of the person. At run time people stand for minutes. So every trial
is learned from after rests of several lengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mild_core.inference.reservoir import SETTLED_S, Reservoir
from mild_core.learning.corpus import Corpus, Tracks, bend, corpus_of, cut_tracks
from mild_core.learning.demonstration import Demonstration
from mild_core.learning.draws import drawing_from
from mild_core.learning.settings import ReservoirSettings, TrainingSettings
from mild_core.learning.windows import Protocol
from mild_core.shapes import FloatArray

PENALTIES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
INNER_FOLDS = 3

STRIDE = 4
"""One window in so many is learned from: neighbours are almost equal."""

ANSWER_COORDINATES = 20
"""Principal components of the controlled agent's window: they hold all but a thousandth of its variance."""

RESTS_S = (SETTLED_S, 10.0, 50.0)
"""How long a person has stood before a trial, each time that it is learned from."""

LEAST_SCALE_M, LEAST_SPREAD = 1e-6, 1e-6
"""What differs by less does not differ."""


@dataclass(frozen=True, eq=False)
class _Moments:
    """Sums over windows: how many, of features (F,), of answers (A,), of products (F, F) and (F, A)."""

    count: int
    features: FloatArray
    answers: FloatArray
    squares: FloatArray
    products: FloatArray

    def __add__(self, other: _Moments) -> _Moments:
        return _Moments(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class _Linear:
    """An answer (A,) to features (F,): weight (F, A), bias (A,)."""

    weight: FloatArray
    bias: FloatArray


@dataclass(frozen=True, eq=False)
class _Trial:
    """Features (n, F) and answers (n, A) of a trial as recorded, and moments of all that is learned from it."""

    label: int
    features: FloatArray
    answers: FloatArray
    moments: _Moments


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
    corpus = corpus_of(demonstrations, protocol, interactions)
    every = np.concatenate(_answers(corpus, corpus.tracks))
    mean = every.mean(axis=0)
    back = np.linalg.svd((every - mean)[::STRIDE], full_matrices=False)[2][:ANSWER_COORDINATES]
    parts, left_out = [], [np.zeros(0)] * len(demonstrations)
    for number in range(settings.count):
        units = _drawn(corpus, settings, np.random.default_rng((seed, number)), back, mean)
        trials = _trials(corpus, units, training, (seed, number))
        scale = np.sqrt(np.maximum(_covariance(_sum(trials)).diagonal(), 0.0)) + LEAST_SPREAD
        penalty = _chosen(trials, scale)
        own = [_sum([trial for trial in trials if trial.label == label]) for label in _labels(trials)]
        parts.append((units, [_solve(moments, scale, penalty) for moments in own]))
        answers = [(answer @ back + mean) / settings.count for answer in _left_out(trials, scale, penalty)]
        left_out = [answer + before if number else answer for answer, before in zip(answers, left_out, strict=True)]
    return _together(parts), left_out


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
    )


def _single(array: FloatArray) -> FloatArray:
    """Rounded to what a model folder stores, so that what is learned here runs alike there."""
    return array.astype(np.float32).astype(np.float64)


def _trials(corpus: Corpus, units: Reservoir, training: TrainingSettings, seed: tuple[int, int]) -> list[_Trial]:
    """Every trial after rests of all lengths, as recorded and bent."""
    answered = _answers(corpus, corpus.tracks, units)
    learned = [(_features(corpus, corpus.tracks, units, rest_s), answered) for rest_s in RESTS_S]
    if training.augmentation is not None and training.reservoir is not None:
        with drawing_from(*seed):
            for copy in range(training.reservoir.copies):
                bent = bend(corpus.tracks, replace(training.augmentation, copies=1))
                rest_s = RESTS_S[copy % len(RESTS_S)]
                learned.append((_features(corpus, bent, units, rest_s), _answers(corpus, bent, units)))
    trials = []
    for place, label in enumerate(corpus.tracks.label.tolist()):
        pairs = [(features[place], answers[place]) for features, answers in learned]
        moments = [_moments(features, answers) for features, answers in pairs]
        trials.append(_Trial(label, *pairs[0], sum(moments[1:], moments[0])))
    return trials


def _features(corpus: Corpus, tracks: Tracks, units: Reservoir, rest_s: float) -> list[FloatArray]:
    """(n, F) of every `STRIDE`-th window of each trial: states, newest frame, oldest, the one between."""
    protocol, found = corpus.protocol, []
    for observed, alive in zip(tracks.observed, tracks.alive, strict=True):
        frames = int(alive.sum()) // protocol.keep_every
        positions = observed[: frames * protocol.keep_every : protocol.keep_every].double().numpy()
        rest = np.repeat(positions[:1], round((rest_s - SETTLED_S) * corpus.rate_hz), axis=0)
        states = units.listen(np.vstack([rest, positions]), corpus.rate_hz, None, 0)[len(rest) :]
        newest = np.arange(protocol.window - 1, protocol.window - 1 + protocol.windows_of(frames), STRIDE)
        seen = [positions[newest - back] for back in (0, protocol.window - 1, protocol.window // 2)]
        found.append(np.hstack([states[newest], *seen]))
    return found


def _answers(corpus: Corpus, tracks: Tracks, units: Reservoir | None = None) -> list[FloatArray]:
    """(N, W J) windows of each trial; with units, (n, A) coordinates of every `STRIDE`-th."""
    batch = cut_tracks(corpus, tracks, 0, 1)
    answers = [a[v > 0].double().numpy() for a, v in zip(batch.answer, batch.valid, strict=True)]
    return answers if units is None else [((a - units.mean) @ units.back.T)[::STRIDE] for a in answers]


def _moments(features: FloatArray, answers: FloatArray) -> _Moments:
    sums = features.sum(axis=0), answers.sum(axis=0)
    return _Moments(len(features), *sums, features.T @ features, features.T @ answers)


def _sum(trials: Sequence[_Trial]) -> _Moments:
    return sum((t.moments for t in trials[1:]), trials[0].moments)


def _labels(trials: Sequence[_Trial]) -> list[int]:
    return sorted({trial.label for trial in trials})


def _covariance(moments: _Moments) -> FloatArray:
    """(F, F) of the features."""
    middle = moments.features / moments.count
    return moments.squares / moments.count - np.outer(middle, middle)


def _solve(moments: _Moments, scale: FloatArray, penalty: float) -> _Linear:
    """Ridge regression of features divided by `scale` (F,), which is the same for all interactions.

    Source: Hoerl, Kennard, "Ridge regression", Technometrics 12 (1970).
    """
    middle, answer = moments.features / moments.count, moments.answers / moments.count
    right = (moments.products / moments.count - np.outer(middle, answer)) / scale[:, None]
    square = _covariance(moments) / np.outer(scale, scale) + penalty * np.eye(len(scale))
    weight = np.asarray(np.linalg.solve(square, right) / scale[:, None], dtype=np.float64)
    return _Linear(weight, answer - middle @ weight)


def _folds(trials: Sequence[_Trial]) -> list[tuple[list[int], list[int]]]:
    """Of each interaction a third of the trials left out, three times: numbers of those learned from, and of those."""
    found = []
    for label in _labels(trials):
        own = [place for place, trial in enumerate(trials) if trial.label == label]
        for fold in range(min(INNER_FOLDS, len(own)) if len(own) > 1 else 0):
            out = own[fold::INNER_FOLDS]
            found.append(([place for place in own if place not in out], out))
    return found


def _chosen(trials: Sequence[_Trial], scale: FloatArray) -> float:
    """The penalty with the least sum over interactions of errors relative to the interaction's least."""
    errors = np.zeros((max(_labels(trials)) + 1, len(PENALTIES)))
    for learned, out in _folds(trials):
        moments = _sum([trials[place] for place in learned])
        for column, penalty in enumerate(PENALTIES):
            one = _solve(moments, scale, penalty)
            for trial in (trials[place] for place in out):
                errors[trial.label, column] += ((trial.features @ one.weight + one.bias - trial.answers) ** 2).sum()
    errors /= np.maximum(errors.min(axis=1, keepdims=True), np.finfo(float).tiny)
    return PENALTIES[int(errors.sum(axis=0).argmin())]


def _left_out(trials: Sequence[_Trial], scale: FloatArray, penalty: float) -> list[FloatArray]:
    """(n, A) what is answered to each trial by readouts learned without it; of a single one, the mean answer."""
    answers = [np.tile(trial.answers.mean(axis=0), (len(trial.answers), 1)) for trial in trials]
    for learned, out in _folds(trials):
        one = _solve(_sum([trials[place] for place in learned]), scale, penalty)
        for place in out:
            answers[place] = trials[place].features @ one.weight + one.bias
    return answers


def _together(parts: Sequence[tuple[Reservoir, list[_Linear]]]) -> Reservoir:
    """Several reservoirs as one, whose answer is the mean of theirs."""
    first, count, units = parts[0][0], len(parts), len(parts[0][0].leak)
    readouts = []
    for label in range(len(parts[0][1])):
        weights = [linear[label].weight / count for _, linear in parts]
        frames = sum((weight[units:] for weight in weights[1:]), weights[0][units:])
        readouts.append(np.vstack([*(weight[:units] for weight in weights), frames]))
    return replace(
        first,
        intake=np.hstack([one.intake for one, _ in parts]),
        sources=np.hstack([one.sources + number * units for number, (one, _) in enumerate(parts)]),
        strengths=np.hstack([one.strengths for one, _ in parts]),
        leak=np.concatenate([one.leak for one, _ in parts]),
        readout=np.array(readouts),
        bias=np.array([np.mean([linear[p].bias for _, linear in parts], axis=0) for p in range(len(readouts))]),
    )

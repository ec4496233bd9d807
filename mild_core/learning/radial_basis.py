# SPDX-License-Identifier: Apache-2.0
"""Learning a radial-basis-function network: clusters, one linear system, and its two knobs by trials left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from mild_core.inference.past import fade, kept_per_frame
from mild_core.inference.radial_basis import RadialBasis
from mild_core.learning.clusters import clusters, squared_distances
from mild_core.learning.demonstration import Demonstration
from mild_core.learning.settings import RadialBasisSettings, TrainingSettings
from mild_core.learning.windows import Protocol, cut
from mild_core.shapes import FloatArray

WIDTHS = (0.1, 0.3, 1.0, 3.0)
PENALTIES = (0.1, 0.3, 1.0, 3.0, 10.0)
INNER_FOLDS = 3

STRIDE = 3
"""One window in so many is learned from: neighbours are almost equal."""

ANSWER_COORDINATES = 20
"""Principal components of the controlled agent's window: they hold all but a thousandth of its variance."""

LEAST_SCALE_M = 1e-6
"""Positions that differ by less do not differ."""

JITTER = 1e-7
"""Times the number of windows, on the diagonal: two centres at one place still give a solution."""


@dataclass(frozen=True, eq=False)
class _Windows:
    """Windows of one trial: (N, F) coordinates of question and past, (N, A) of the answer."""

    interaction: str
    question: FloatArray
    answer: FloatArray


@dataclass(frozen=True, eq=False)
class _Solved:
    """One interaction: centres (M, F), coefficients (M, A), offset (A,)."""

    centres: FloatArray
    coefficients: FloatArray
    offset: FloatArray


def fit_radial_basis(
    demonstrations: Sequence[Demonstration],
    protocol: Protocol,
    interactions: Sequence[str],
    training: TrainingSettings,
    seed: int,
) -> RadialBasis | None:
    """Learn every interaction by itself; width and penalty are those that serve trials left out best on the whole.

    Args:
        demonstrations: Of every interaction at least one.
        protocol: How to cut them.
        interactions: By label.
        training: Its `radial_basis`, for which None gives None, and its `past_s`.
        seed: Of the clusters' beginnings.
    """
    settings = training.radial_basis
    if settings is None:
        return None
    questions = _questions(demonstrations, protocol, training.past_s)
    answers = _answers(demonstrations, protocol)
    weight, bias = _coordinates(demonstrations, protocol, questions, settings)
    every = np.concatenate(answers)
    mean = every.mean(axis=0)
    back = np.linalg.svd((every - mean)[::STRIDE], full_matrices=False)[2][:ANSWER_COORDINATES]
    windows = [
        _Windows(trial.interaction, (question @ weight + bias)[::STRIDE], ((answer - mean) @ back.T)[::STRIDE])
        for trial, question, answer in zip(demonstrations, questions, answers, strict=True)
    ]
    width, penalty = _chosen(windows, settings, seed)
    solved = []
    for name in interactions:
        own = [w for w in windows if w.interaction == name]
        solved += _solve(own, _centres(own, settings.centres, seed), width, (penalty,))
    return RadialBasis(
        weight=weight,
        bias=bias,
        centres=np.concatenate([one.centres for one in solved]),
        owners=np.repeat(np.arange(len(solved)), [len(one.centres) for one in solved]).astype(np.float64),
        width=np.array([width]),
        coefficients=np.concatenate([one.coefficients for one in solved]),
        offsets=np.stack([one.offset for one in solved]),
        back=back,
        mean=mean,
        share=np.array([settings.share]),
    )


def _questions(
    demonstrations: Sequence[Demonstration], protocol: Protocol, past_s: Sequence[float]
) -> list[FloatArray]:
    """(N, W D + T 3 J) windows of each trial and the past at each."""
    rows = []
    for trial in demonstrations:
        observed = cut(trial, protocol).observed
        rows.append(np.hstack([part.reshape(len(observed), -1) for part in (observed, pasts(trial, protocol, past_s))]))
    return rows


def pasts(demonstration: Demonstration, protocol: Protocol, past_s: Sequence[float]) -> FloatArray:
    """(N, T, 3 J) the past at each window of a trial, see `inference.past`."""
    kept = kept_per_frame(past_s, demonstration.rate_hz / protocol.keep_every)
    past: FloatArray | None = None
    found = []
    for newest in cut(demonstration, protocol).observed[:, -1, : demonstration.observed_m[0].size]:
        past = fade(past, newest, kept)
        found.append(past)
    return np.array(found)


def _answers(demonstrations: Sequence[Demonstration], protocol: Protocol) -> list[FloatArray]:
    """(N, W J) windows of each trial."""
    found = [cut(trial, protocol).controlled for trial in demonstrations]
    return [windows.reshape(len(windows), -1) for windows in found]


def _coordinates(
    demonstrations: Sequence[Demonstration],
    protocol: Protocol,
    questions: Sequence[FloatArray],
    settings: RadialBasisSettings,
) -> tuple[FloatArray, FloatArray]:
    """Weight and bias from window and past to coordinates whose distances mean something.

    Positions all count alike, so that a hand that moves much counts more than a shoulder that hardly moves; velocities
    and the past are weighed against them. A frame counts as much as the past at one time constant.
    """
    every = np.concatenate(questions)
    joints = demonstrations[0].observed_m[0].size
    values = 2 * joints if protocol.features == "positions_velocities" else joints
    size = protocol.window * values
    importance = np.tile(np.where(np.arange(values) < joints, 1.0, settings.velocity_weight), protocol.window)
    scale = max(float((every[:, :size] * importance).std()), LEAST_SCALE_M)
    mean = every[:, :size].mean(axis=0)
    centred = ((every[:, :size] - mean) * importance)[::STRIDE]
    directions = np.linalg.svd(centred, full_matrices=False)[2][: settings.coordinates].T
    directions = importance[:, None] * directions / (scale * np.sqrt(size))
    past = np.eye(every.shape[1] - size) * (settings.past_weight / (scale * np.sqrt(joints)))
    weight = np.block(
        [
            [directions, np.zeros((size, len(past)))],
            [np.zeros((len(past), directions.shape[1])), past],
        ]
    )
    return weight, np.concatenate([-mean @ directions, np.zeros(len(past))])


def _chosen(windows: Sequence[_Windows], settings: RadialBasisSettings, seed: int) -> tuple[float, float]:
    """Width and penalty with the least sum over interactions of errors relative to the interaction's least."""
    total = np.zeros((len(WIDTHS), len(PENALTIES)))
    for name in dict.fromkeys(w.interaction for w in windows):
        own = [w for w in windows if w.interaction == name]
        errors, folds = np.zeros_like(total), min(INNER_FOLDS, len(own))
        for fold in range(folds if folds > 1 else 0):
            learned, left_out = ([w for k, w in enumerate(own) if (k % folds == fold) == out] for out in (False, True))
            question, answer = _together(left_out)
            centres = _centres(learned, settings.centres, seed)
            for row, width in enumerate(WIDTHS):
                heights = _heights(question, centres, width)
                for column, one in enumerate(_solve(learned, centres, width, PENALTIES)):
                    errors[row, column] += ((heights @ one.coefficients + one.offset - answer) ** 2).sum()
        total += errors / max(float(errors.min()), np.finfo(float).tiny)
    width, penalty = list(product(WIDTHS, PENALTIES))[int(total.argmin())]
    return width, penalty


def _together(windows: Sequence[_Windows]) -> tuple[FloatArray, FloatArray]:
    """Questions and answers of all trials."""
    return np.concatenate([w.question for w in windows]), np.concatenate([w.answer for w in windows])


def _centres(windows: Sequence[_Windows], most: int, seed: int) -> FloatArray:
    """(M, F) of one interaction."""
    question = _together(windows)[0]
    return clusters(question, max(1, min(most, len(question) // 3)), np.random.default_rng(seed))


def _solve(windows: Sequence[_Windows], centres: FloatArray, width: float, penalties: Sequence[float]) -> list[_Solved]:
    """Coefficients of one interaction for each penalty.

    Source: the regularisation networks of Poggio and Girosi with fewer centres than examples (their section V).
    """
    question, answer = _together(windows)
    offset = answer.mean(axis=0)
    heights, between = _heights(question, centres, width), _heights(centres, centres, width)
    square, right = heights.T @ heights, heights.T @ (answer - offset)
    jitter = JITTER * len(question) * np.eye(len(centres))
    return [
        _Solved(centres, np.linalg.solve(square + penalty * between + jitter, right), offset) for penalty in penalties
    ]


def _heights(points: FloatArray, centres: FloatArray, width: float) -> FloatArray:
    heights: FloatArray = np.exp(-squared_distances(points, centres) / width)
    return heights

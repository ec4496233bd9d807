# SPDX-License-Identifier: Apache-2.0
"""What a reservoir learns from: its states and frames of each trial, the answers, and which interaction it is.

A trial begins a second or two before its motion, and how long before is nearly the same in all: units that remember
could read the time from that and answer it instead of the person. At run time people stand for minutes. So every trial
is learned from after rests of several lengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array  # type: ignore[import-untyped]  # scipy brings no types

from mild_core.inference.reservoir import SETTLED_S, Reservoir
from mild_core.learning.data.seeding import drawing_from
from mild_core.learning.data.windows import Protocol
from mild_core.learning.training.corpus import Corpus, Tracks, augment, cut_tracks
from mild_core.learning.training.recogniser import has_started
from mild_core.learning.training.ridge import Moments, moments_of, total
from mild_core.learning.training.settings import TrainingSettings
from mild_core.shapes import FloatArray

STRIDE = 4
"""One window in so many is learned from: neighbours are almost equal."""

RESTS_S = (SETTLED_S, 10.0, 50.0)
"""How long a person has stood before a trial, each time that it is learned from: ever longer."""

TOGETHER = 32
"""Trials that units listen to at once: several times as fast as one after the other, and memory holds them."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A trial as recorded, and all that is learned from it.

    Attributes:
        label: Number of its interaction.
        features: (n, F) of every `STRIDE`-th window.
        wanted: (n, A + P) coordinates of the answer, then how probable each interaction is.
        moments: Of both, after rests of all lengths.
    """

    label: int
    features: FloatArray
    wanted: FloatArray
    moments: Moments


def seen_trials(corpus: Corpus, units: Reservoir, training: TrainingSettings, seed: tuple[int, int]) -> list[Trial]:
    """Every trial after rests of all lengths, as recorded and bent.

    Args:
        corpus: The trials.
        units: A reservoir without readouts.
        training: Its `augmentation`, and how many bent copies its `reservoir` wants.
        seed: Of how they are bent.
    """
    wanted = _wanted(corpus, corpus.tracks, units)
    learned = [(features, wanted) for features in _features(corpus, corpus.tracks, units, RESTS_S)]
    if training.augmentation is not None and training.reservoir is not None:
        with drawing_from(*seed):
            for copy in range(training.reservoir.copies):
                bent = augment(corpus.tracks, replace(training.augmentation, copies=1))
                (features,) = _features(corpus, bent, units, [RESTS_S[copy % len(RESTS_S)]])
                learned.append((features, _wanted(corpus, bent, units)))
    if corpus.again:  # what was recorded counts as much beside them as it does for the networks
        kept = len(corpus.again) * (1.0 - corpus.share) / (corpus.share * len(learned))
        learned *= max(1, round(kept))
    for number, again in enumerate(corpus.again):
        (features,) = _features(corpus, again, units, [RESTS_S[number % len(RESTS_S)]])
        learned.append((features, _wanted(corpus, again, units)))
    trials = []
    for place, label in enumerate(corpus.tracks.label.tolist()):
        pairs = [(features[place], answers[place]) for features, answers in learned]
        trials.append(Trial(label, *pairs[0], total([moments_of(*pair) for pair in pairs])))
    return trials


def _features(corpus: Corpus, tracks: Tracks, units: Reservoir, rests_s: Sequence[float]) -> list[list[FloatArray]]:
    """(n, F) of every `STRIDE`-th window, by rest and trial: states, newest frame, oldest, the one between."""
    protocol, kept = corpus.protocol, []
    for observed, alive in zip(tracks.observed, tracks.alive, strict=True):
        frames = int(alive.sum()) // protocol.keep_every
        kept.append(observed[: frames * protocol.keep_every : protocol.keep_every].double().numpy())
    found: list[list[FloatArray]] = [[] for _ in rests_s]
    for first in range(0, len(kept), TOGETHER):
        trials = kept[first : first + TOGETHER]
        states = _states(units, trials, corpus.rate_hz, rests_s, protocol.window - 1)
        for own, of_rest in zip(found, states, strict=True):
            for trial, of_trial in zip(trials, of_rest, strict=True):
                newest = _newest(protocol, len(trial))
                seen = [trial[newest - back] for back in (0, protocol.window - 1, protocol.window // 2)]
                own.append(np.hstack([of_trial[: len(newest)], *seen]))
    return found


def _states(
    units: Reservoir, trials: Sequence[FloatArray], rate_hz: float, rests_s: Sequence[float], first: int
) -> FloatArray:
    """(rests, trials, n, R) states after every `STRIDE`-th frame from the `first` on; after a trial's end its last.

    As of `Reservoir.listen`, for all trials at once.
    """
    longest = max(map(len, trials))
    drives = [units.drive(np.pad(trial, ((0, longest - len(trial)), (0, 0)), "edge"), rate_hz) for trial in trials]
    drive, leak = np.ascontiguousarray(np.array(drives).transpose(1, 2, 0)), units.leak[:, None]
    hearing = np.tile(np.arange(len(leak)), len(units.sources))
    heard = csr_array((units.strengths.ravel(), (hearing, units.sources.ravel().astype(np.int64))))

    def after(state: FloatArray, given: FloatArray) -> FloatArray:
        moved: FloatArray = state + leak * (np.tanh(heard @ state + given) - state)
        return moved

    state, rested, initial = np.zeros(drive.shape[1:]), 0, []
    for rest_s in rests_s:
        for _ in range(round(rest_s * rate_hz) - rested):
            state = after(state, drive[0])
        rested = round(rest_s * rate_hz)
        initial.append(state)
    state, states = np.hstack(initial), []
    for number, given in enumerate(drive):
        state = after(state, np.tile(given, len(rests_s)))
        if number >= first and (number - first) % STRIDE == 0:
            states.append(state.reshape(len(state), len(rests_s), -1))
    return np.array(states).transpose(2, 3, 0, 1)


def _newest(protocol: Protocol, frames: int) -> NDArray[np.int64]:
    """Number of the newest frame of every `STRIDE`-th window of a trial."""
    return np.arange(protocol.window - 1, protocol.window - 1 + protocol.windows_of(frames), STRIDE)


def _wanted(corpus: Corpus, tracks: Tracks, units: Reservoir) -> list[FloatArray]:
    """(n, A + P) of every `STRIDE`-th window of each trial."""
    answers = [((answer - units.mean) @ units.back.T)[::STRIDE] for answer in answers_of(corpus, tracks)]
    return [np.hstack(both) for both in zip(answers, probabilities_of(corpus, tracks), strict=True)]


def answers_of(corpus: Corpus, tracks: Tracks) -> list[FloatArray]:
    """(N, W J) windows of each trial."""
    batch = cut_tracks(corpus, tracks, 0, 1)
    return [a[v > 0].double().numpy() for a, v in zip(batch.answer, batch.valid, strict=True)]


def probabilities_of(corpus: Corpus, tracks: Tracks) -> list[FloatArray]:
    """(n, P) of every `STRIDE`-th window of each trial: before the hand has moved, all are alike."""
    protocol, certain, found = corpus.protocol, np.eye(len(corpus.interactions)), []
    for observed, alive, label in zip(tracks.observed, tracks.alive, tracks.label.tolist(), strict=True):
        frames = int(alive.sum()) // protocol.keep_every
        started = has_started(observed[None, : frames * protocol.keep_every : protocol.keep_every])[0].numpy()
        found.append(np.where(started[_newest(protocol, frames), None], certain[label], 1.0 / len(certain)))
    return found

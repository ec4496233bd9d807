# SPDX-License-Identifier: Apache-2.0
"""Bütepage et al.'s model: learned from pairs of people first, then the robot is moved on given the person's motion."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mild_core.learning.data.baseline import Baseline, Predictor
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.recording import Recording
from mild_core.learning.data.windows import Protocol
from mild_core.shapes import FloatArray

if TYPE_CHECKING:
    from torch import Tensor

    from mild_core.learning.baselines.recurrent import InputLayout
    from mild_core.learning.baselines.shared_embedding import People, SharedEmbedding

WAVES = ("hand_wave", "waving", "wave")
"""What the recordings call one and the same interaction."""


def fit(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> Predictor:
    """Learn all interactions with one model (see `Fit`)."""
    from mild_core.learning.baselines.recurrent import fit_recurrent

    def network_of(view: InputLayout, answers: Tensor) -> SharedEmbedding:
        from mild_core.learning.baselines.shared_embedding import (
            CONTROLLED,
            SharedEmbedding,
            learn_embedding,
            learn_people,
        )

        person = learn_people(people_at_hand(demonstrations, view))
        return SharedEmbedding(person, learn_embedding(answers, CONTROLLED), len(view.interactions))

    return fit_recurrent(demonstrations, protocol, seed, network_of)


def people_at_hand(demonstrations: Sequence[Demonstration], view: InputLayout) -> People:
    """The people of these trials, and the pairs of every recording of two people that is on this machine."""
    from mild_core.learning.baselines.shared_embedding import people_of
    from mild_core.learning.datasets import DATASETS

    tracks: list[Tensor] = []
    partner: list[int] = []
    for trial in (*demonstrations, *pairs_elsewhere(demonstrations, DATASETS.values())):
        if not trial.partner:
            partner.append(len(tracks))
            tracks.append(view.frames(trial))
            continue
        partner += [len(tracks) + 1, len(tracks)]
        tracks += [view.frames(trial), view.frames(replace(trial, observed_m=trial.controlled))]
    features = len(view.mean)
    return people_of(tracks, partner, features, view.protocol.window, view.stride)


def pairs_elsewhere(
    demonstrations: Sequence[Demonstration], recordings: Iterable[Recording]
) -> tuple[Demonstration, ...]:
    """Two people who do one of the same interactions, at the rate of these trials and under their interaction's name.

    A recording that these trials are of is left out: the others of it are held out.
    """
    rate_hz, interactions = demonstrations[0].rate_hz, tuple(dict.fromkeys(d.interaction for d in demonstrations))
    names = {other: name for name in interactions for other in ((name, *WAVES) if name in WAVES else (name,))}
    found: list[Demonstration] = []
    for recording in recordings:
        if recording.robot or not recording.default_path().exists():
            continue
        trials = recording.read(recording.default_path()).train
        if any(np.array_equal(trial.observed_m, demonstrations[0].observed_m) for trial in trials):
            continue
        found += [
            replace(at_rate(trial, rate_hz), interaction=names[trial.interaction])
            for trial in trials
            if trial.interaction in names and trial.observed_names == demonstrations[0].observed_names
        ]
    return tuple(found)


def at_rate(trial: Demonstration, rate_hz: float) -> Demonstration:
    """A trial at another rate, between its frames."""
    times = np.arange(trial.frames) / trial.rate_hz
    wanted = np.arange(0.0, times[-1] + 1e-9, 1.0 / rate_hz)

    def resampled(values: FloatArray) -> FloatArray:
        columns = [np.interp(wanted, times, column) for column in values.reshape(trial.frames, -1).T]
        return np.stack(columns, axis=1).reshape(len(wanted), *values.shape[1:])

    observed, controlled, active = map(resampled, (trial.observed_m, trial.controlled, trial.active))
    return replace(trial, rate_hz=rate_hz, observed_m=observed, controlled=controlled, active=active)


BUETEPAGE = Baseline("buetepage", "Bütepage et al.", fit, seeded=True)

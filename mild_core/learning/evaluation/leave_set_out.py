# SPDX-License-Identifier: Apache-2.0
"""How well gestures are recognised in a data set that the recogniser never saw: each left out in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mild_core.inference.gesture_recogniser import (
    GESTURES,
    PERIOD_NS,
    RATE_HZ,
    UNDECIDED_S,
    GestureRecogniser,
    GestureState,
)
from mild_core.learning.data.people import STANDING_S
from mild_core.learning.evaluation.strangers import MOMENTS_S
from mild_core.learning.evaluation.unknown import separation
from mild_core.learning.training.gestures import Arm, GestureSettings, background_arms, has_left_rest, train_gestures
from mild_core.shapes import FloatArray

NOISE = 0.004
"""Of the tracker, while an arm stands and later [arm lengths]."""

START_WITHIN_S, CAUTIOUS_WITHIN_S = 2.6, 4.0
BOOTSTRAP_DRAWS = 2000


@dataclass(frozen=True, eq=False)
class Played:
    """One arm as the recogniser saw it.

    Attributes:
        gesture: What it does.
        right: (T,) whether the likeliest gesture is that, while the hand is away from its rest.
        started_s: When it was first taken for a known gesture, after the onset; infinite: never.
        cautious_s: When it was first named where it is asked for more evidence; infinite: never.
        named_right: (M,) at `MOMENTS_S`, whether it has started and the likeliest is right.
        named_wrong: (M,) the same, and it is wrong.
        at_rest: Whether it started before the hand left its rest.
        familiar: How familiar it looks two seconds after the onset, or when the hand came back.
    """

    gesture: str
    right: FloatArray
    started_s: float
    cautious_s: float
    named_right: FloatArray
    named_wrong: FloatArray
    at_rest: bool
    familiar: float


def play(recogniser: GestureRecogniser, arm: Arm, certain: float, seed: int = 0) -> Played | None:
    """Show an arm to a recogniser; None when the hand never leaves its rest."""
    rng, standing = np.random.default_rng(seed), round(STANDING_S * RATE_HZ)
    frames = np.concatenate([np.repeat(arm.frames[:1], standing, axis=0), arm.frames])
    frames[:, 1:] += NOISE * rng.normal(size=frames[:, 1:].shape)
    away = np.concatenate([np.zeros(standing, dtype=bool), has_left_rest(arm.frames)])
    if not away.any():
        return None
    states, cautious = _states(recogniser, frames, False), _states(recogniser, frames, True)
    onset = int(away.argmax())
    likeliest = [GESTURES[int(one.evidence.argmax())] == arm.gesture for one in states]
    named = [_names(one, certain) for one in states]
    cautiously = [index for index, one in enumerate(cautious) if _names(one, certain)]
    places = [min(onset + round(after_s * RATE_HZ), len(states) - 1) for after_s in MOMENTS_S]
    started = [index for index, one in enumerate(states) if one.started]
    decided = [one for one in states[onset : onset + round(UNDECIDED_S * RATE_HZ) + 1] if one.active_s > 0.0]
    return Played(
        gesture=arm.gesture,
        right=np.array(likeliest, dtype=np.float64)[away],
        started_s=(started[0] - onset) / RATE_HZ if started else float("inf"),
        cautious_s=(cautiously[0] - onset) / RATE_HZ if cautiously else float("inf"),
        named_right=np.array([named[place] and likeliest[place] for place in places], dtype=np.float64),
        named_wrong=np.array([named[place] and not likeliest[place] for place in places], dtype=np.float64),
        at_rest=bool(started) and started[0] < onset,
        familiar=decided[-1].familiar if decided else 1.0,
    )


def _states(recogniser: GestureRecogniser, frames: FloatArray, cautious: bool) -> list[GestureState]:
    states, state = [], recogniser.init()
    for index, frame in enumerate(frames):
        state = recogniser.step(state, frame, 10**9 + index * PERIOD_NS, cautious)
        states.append(state)
    return states


def _names(state: GestureState, certain: float) -> bool:
    return state.started and float(np.exp(state.evidence).max() / np.exp(state.evidence).sum()) >= certain


def leave_sets_out(arms: Sequence[Arm], settings: GestureSettings, seeds: int, certain: float) -> dict[str, Any]:
    """By data set left out, figures with 95 % intervals over its arms (percentile bootstrap).

    Args:
        arms: Of all data sets; those of other gestures are foreign.
        settings: How the recogniser is learned.
        seeds: Of its draws.
        certain: Probability from which a gesture is named.
    """
    found: dict[str, Any] = {}
    for source in dict.fromkeys(arm.source for arm in arms):
        known: list[Played] = []
        foreign: dict[str, list[Played]] = {}
        for seed in range(seeds):
            others = [arm for arm in arms if arm.source != source]
            learned = replace(settings, seed=seed)
            recogniser = train_gestures(others, background_arms(settings.background, seed), learned)
            for arm in arms:
                played = play(recogniser, arm, certain) if arm.source == source else None
                if played is not None:
                    (known if arm.gesture in GESTURES else foreign.setdefault(arm.gesture, [])).append(played)
        found[source] = _figures(known, foreign)
    return found


def _figures(known: Sequence[Played], foreign: dict[str, list[Played]]) -> dict[str, Any]:
    right = np.array([one.right.mean() for one in known])
    rng = np.random.default_rng(0)
    draws = right[rng.integers(len(right), size=(BOOTSTRAP_DRAWS, len(right)))].mean(axis=1)
    scores = [np.array([-one.familiar]) for one in known]
    return {
        "arms": len(known),
        "active_likeliest": float(right.mean()),
        "interval": np.quantile(draws, (0.025, 0.975)).tolist(),
        "right": dict(
            zip(map(str, MOMENTS_S), np.mean([one.named_right for one in known], axis=0).tolist(), strict=True)
        ),
        "wrong": dict(
            zip(map(str, MOMENTS_S), np.mean([one.named_wrong for one in known], axis=0).tolist(), strict=True)
        ),
        "started_at_rest": float(np.mean([one.at_rest for one in known])),
        "started_in_time": float(np.mean([one.started_s <= START_WITHIN_S for one in known])),
        "cautious_in_time": float(np.mean([one.cautious_s <= CAUTIOUS_WITHIN_S for one in known])),
        "started": float(np.mean([np.isfinite(one.started_s) for one in known])),
        "unknown": {
            name: {"area": found.area, "share": found.share}
            for name, played in foreign.items()
            for found in [separation(scores, [np.array([-one.familiar]) for one in played])]
        },
    }

# SPDX-License-Identifier: Apache-2.0
"""In which interactions hands touch, and when, found in the trials themselves.

Where a robot was there, people stood so that hands met, which is where the places of a model come from. Of two people
each is recorded from the own shoulder alone, so that it is not known how far their hands were apart. But people who
greet stand opposite each other, right shoulder aside from right shoulder by two half widths of a trunk: hands that
touch come to one place then, and hands that wave stay on either side.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mild_core.inference.manifest import HumanPlacement
from mild_core.learning.data.baseline import by_interaction
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.training.place_fit import FACE_TO_FACE_RAD, touching, turned_about_z
from mild_core.shapes import FloatArray

SHOULDERS_M = 0.37
"""Between the right shoulders of two people who stand straight opposite each other, sideways: an adult's width."""

BESIDE_M = 0.4
"""Hands that stay further from each other than this, sideways, do not touch. In all ten interactions of NuiSI's two
recordings: at most 0.29 where hands touch, at least 0.52 where people wave."""

RAISED = 0.1
"""A motion begins and ends where the hand is this share of its farthest from its rest."""


def contact_phases(
    demonstrations: Sequence[Demonstration], placement: HumanPlacement
) -> dict[str, tuple[float, float]]:
    """By interaction in which hands touch: from which to which share of the motion they do, medians over its trials.

    Args:
        demonstrations: Trials of a robot or of two people.
        placement: Of people before the robot: hands touch in the interactions that have places of their own.
    """
    found = {}
    for name, trials in by_interaction(demonstrations).items():
        if _hands_meet(trials) if trials[0].partner else name in placement.by_interaction:
            first, last = np.median([_phase(trial.observed_m[:, -1]) for trial in trials], axis=0)
            found[name] = (round(float(first), 2), round(float(last), 2))
    return found


def _hands_meet(trials: Sequence[Demonstration]) -> bool:
    """Whether two people's hands come to one place in most trials."""
    turn = turned_about_z(FACE_TO_FACE_RAD).T
    aside = []
    for trial in trials:
        one, other = trial.observed_m[:, -1], trial.controlled[:, -1] @ turn
        out = touching(one) & touching(other)
        out = out if out.any() else touching(one)
        aside.append(abs(float(np.median((one - other)[out, 1])) - SHOULDERS_M))
    return float(np.median(aside)) < BESIDE_M


def _phase(hand_m: FloatArray) -> tuple[float, float]:
    """From which to which share of the motion a hand (T, 3) is held out."""
    away = np.linalg.norm(hand_m - hand_m[0], axis=1)
    moving, out = np.flatnonzero(away > RAISED * away.max()), np.flatnonzero(touching(hand_m))
    length = max(moving[-1] - moving[0], 1)
    return float((out[0] - moving[0]) / length), float((out[-1] - moving[0]) / length)

# SPDX-License-Identifier: Apache-2.0
"""Checks of trials before training: a model of invalid trials would be nonsense or fail."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mild_core.errors import DatasetError
from mild_core.learning.data.demonstration import Demonstration
from mild_core.perception.joint_validity import FARTHEST_M, HUMAN_BONE_M
from mild_core.shapes import FloatArray

LARGEST_RAD = 25.0
"""Four turns: no arm's joint goes further, and degrees do at once."""

LARGEST_STEP_RAD = np.pi
"""No joint turns half a turn from one frame to the next; a lost message, a glitch and an angle that wraps do."""

LARGEST_STEP_M = 2.0
"""No joint of an arm goes so far from one frame to the next: at 8 Hz a thrown ball leaves at as much."""

NEAR_TURN_RAD = 1.0
"""So near to whole turns between the medians of two trials, they are meant."""

STILL_RAD, STILL_M = 0.01, 0.01
"""Trials in which the person moves by less than this contain nothing to learn from [m]."""

REPAIR = "leave the trial out, or repair it"


def require_valid(demonstrations: Sequence[Demonstration]) -> None:
    """Refuse trials that cannot be so, and trials in none of which one of the two moves.

    A joint that never moves, and an agent that stands still in some of the trials, are learned as they are.

    Raises:
        DatasetError: Names the trial, the joint and the frame, or who never moves.
    """
    for trial in demonstrations:
        _require_arm(trial, trial.observed_m, trial.observed_names, "the person's")
        if trial.partner:
            _require_arm(trial, trial.controlled, trial.controlled_names, "the partner's")
        else:
            _require_angles(trial)
    _require_same_turn([trial for trial in demonstrations if not trial.partner])
    robot = "the partner's hand" if demonstrations and demonstrations[0].partner else "the robot"
    record = "record its joint_states while it moves" if robot == "the robot" else "check which joints were recorded"
    _require_motion(
        demonstrations, "the person's hand", lambda t: t.observed_m, STILL_M, "m", "check what was recorded"
    )
    _require_motion(demonstrations, robot, lambda t: t.controlled, STILL_RAD, "rad", record)


def _require_motion(
    demonstrations: Sequence[Demonstration],
    who: str,
    of: Callable[[Demonstration], FloatArray],
    least: float,
    unit: str,
    remedy: str,
) -> None:
    """One of the trials shows a motion."""
    largest = max((float(np.ptp(of(trial), axis=0).max()) for trial in demonstrations), default=least)
    if largest < least:
        problem = f"{who} never moves by more than {largest:.3f} {unit} in any of its {len(demonstrations)} trials"
        raise DatasetError("recording", problem, remedy)


def _require_arm(trial: Demonstration, arm_m: FloatArray, names: Sequence[str], whose: str) -> None:
    """Joints in range that do not leap, none exactly zero but the first (`perception.joint_validity`).

    Their bones are of possible length.
    """
    places = [f"{whose} {name}" for name in names]
    far = np.abs(arm_m).max(axis=2) > FARTHEST_M
    _refuse(trial, far, places, f"is beyond {FARTHEST_M:.0f} m: a glitch, or millimetres?")
    leaps = np.linalg.norm(np.diff(arm_m, axis=0), axis=2) > LARGEST_STEP_M
    zeroed = (arm_m[:, 1:] == 0.0).all(axis=2)
    _refuse(trial, zeroed, [f"{whose} {name}" for name in names[1:]], "is at exactly zero: the tracker lost it")
    low, high = HUMAN_BONE_M
    lengths = np.linalg.norm(np.diff(arm_m, axis=1), axis=2)
    bones = [f"{whose} bone from {one} to {other}" for one, other in pairwise(names)]
    _refuse(trial, lengths > high, bones, f"is longer than {high:.2f} m")
    _refuse(
        trial, leaps, places, f"leaps by more than {LARGEST_STEP_M:.0f} m to the next: a glitch, or another person?"
    )
    _refuse(trial, np.median(lengths, axis=0, keepdims=True) < low, bones, f"is mostly shorter than {low:.2f} m")


def _require_angles(trial: Demonstration) -> None:
    """Joint angles within a few turns that do not leap."""
    joints, angles = [f"joint '{name}'" for name in trial.controlled_names], trial.controlled
    _refuse(trial, np.abs(angles) > LARGEST_RAD, joints, f"is beyond {LARGEST_RAD:.0f} rad: a glitch, or degrees?")
    steps = np.abs(np.diff(angles, axis=0)) > LARGEST_STEP_RAD
    _refuse(trial, steps, joints, "leaps by more than half a turn to the next")


def _require_same_turn(trials: Sequence[Demonstration]) -> None:
    """Every joint is counted from the same turn in all trials: a turn more is the same pose and another number."""
    middles = [np.median(trial.controlled, axis=0) for trial in trials]
    for trial, middle in zip(trials, middles, strict=True):
        away = middle - middles[0]
        turns = np.round(away / (2.0 * np.pi))
        wrong = (turns != 0.0) & (np.abs(away - 2.0 * np.pi * turns) < NEAR_TURN_RAD)
        joints = [f"joint '{name}'" for name in trial.controlled_names]
        _refuse(trial, wrong[None], joints, f"lies a whole turn from where it lies in trial {trials[0].trial}")


def _refuse(trial: Demonstration, wrong: NDArray[np.bool_], what: Sequence[str], problem: str) -> None:
    if wrong.any():
        frame, place = np.argwhere(wrong)[0]
        where = f"in frame {frame} " if len(wrong) > 1 else ""
        raise DatasetError(f"trial {trial.trial} ({trial.interaction})", f"{where}{what[place]} {problem}", REPAIR)

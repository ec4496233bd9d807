# SPDX-License-Identifier: Apache-2.0
"""`traj_data.npz`, the layout that all these recordings are published in: motions and labels by split, checked."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mild_core.errors import DatasetError
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.recording import SPLITS, Demonstrations
from mild_core.learning.data.safe_npz import REMEDY, numbers, read_safe_npz
from mild_core.shapes import FloatArray

TrialOf = Callable[[str, int, Any, Any], Demonstration]
"""(what to call it in an error, index, motion, label) -> the trial."""


def read_splits(path: Path, trial_of: TrialOf) -> Demonstrations:
    """Read all trials of both splits.

    Args:
        path: The file.
        trial_of: Makes one trial; raises DatasetError for a malformed one.

    Raises:
        DatasetError: The file cannot be read, or holds another number of labels than of trials.
    """
    arrays = read_safe_npz(path, tuple(f"{split}_{what}" for split in SPLITS for what in ("data", "labels")))
    parts = []
    for split in SPLITS:
        tracks, labels = arrays[f"{split}_data"], arrays[f"{split}_labels"]
        if tracks.ndim == 0 or labels.ndim == 0 or len(tracks) != len(labels):
            counts = [1 if array.ndim == 0 else len(array) for array in (tracks, labels)]
            problem = f"has {counts[0]} trials but {counts[1]} labels in split '{split}'"
            raise DatasetError(f"recording '{path}'", problem, REMEDY)
        things = [f"trial {index} of split '{split}' in '{path}'" for index in range(len(tracks))]
        parts.append(tuple(trial_of(things[i], i, *pair) for i, pair in enumerate(zip(tracks, labels, strict=True))))
    return Demonstrations(*parts)


def numbered(thing: str, label: Any, interactions: tuple[str, ...]) -> str:
    """The interaction that a trial's label numbers, from 0.

    Raises:
        DatasetError: It numbers none.
    """
    value = np.asarray(label)
    if value.ndim or value.dtype.kind not in "iuf" or float(value) not in range(len(interactions)):
        problem = f"its label is {str(label)[:40]}, expected a number from 0 to {len(interactions) - 1}"
        raise DatasetError(thing, problem, REMEDY)
    return interactions[int(value)]


def one_hot(thing: str, labels: Any, frames: int, interactions: tuple[str, ...]) -> tuple[str, FloatArray]:
    """The interaction that a trial's (T, P + 1) one-hot labels name, and (T,) where it goes on: not the last label.

    Raises:
        DatasetError: They do not name one interaction.
    """
    found = numbers(thing, "labels", labels, len(interactions) + 1)
    if len(found) != frames:
        raise DatasetError(thing, f"has {frames} frames but {len(found)} labels", REMEDY)
    frames_of = found[:, :-1].sum(axis=0)
    if not ((found == 0) | (found == 1)).all() or (found.sum(axis=1) > 1).any() or np.count_nonzero(frames_of) != 1:
        raise DatasetError(thing, "its labels do not name one interaction, one-hot in each frame", REMEDY)
    return interactions[int(frames_of.argmax())], found[:, :-1].sum(axis=1)


def from_the_shoulder(arm: FloatArray) -> FloatArray:
    """An arm (T, 9) or (T, 3, 3), shoulder first, as (T, 3, 3) with its origin at the shoulder of the first frame."""
    joints = arm.reshape(len(arm), -1, 3)
    moved: FloatArray = joints - joints[0, 0]
    return moved

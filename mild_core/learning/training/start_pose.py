# SPDX-License-Identifier: Apache-2.0
"""Learning the start pose correction: a regression of the prediction errors of held-out trials.

Of the few starts that there are, little can be learned of each interaction by itself: every gain is half the same for
all. Sizes of the gains were chosen by cross-validation over the training trials, see docs/accuracy.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.inference.start_pose import StartPose, near_start
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol, cut
from mild_core.shapes import FloatArray

NEARNESS_RAD, STANDING_RAD = 0.6, 0.25
SHARED = 0.5
"""Share of a gain's prior variance that all interactions have in common."""

OWN_JOINT, ANY_JOINT, AT_REST = 1.0, 1.0, 5.0
"""Prior variances of the gains, in units of the error's over the start's: of the same joint, of all joints together,
and of the same joint near the start."""

PENALTY = 10.0
"""Variance of an error that has nothing to do with the start, in the same units."""

LEAST_SPREAD_RAD = 1e-3
"""A robot whose starts differ by less always starts at one place: nothing can be learned of that."""

REACH = 1.5
"""A start means something up to so many times the largest distance from the mean one that was seen."""

LEAST_NEAR, MOST_PENALTY = 0.02, 20.0
NEAR_SHARE = 0.4
"""An error near the start counts by how much of the trial is near it; at this share as much as any other."""


@dataclass(frozen=True, eq=False)
class _Wrong:
    """What is wrong with the predictions for a trial left out.

    Attributes:
        unusual: (J,) its start less the mean one [rad].
        label: Number of its interaction.
        resting: (J,) mean error near the start [rad].
        moving: (J,) mean error elsewhere [rad].
        near: Share of it that is near the start.
    """

    unusual: FloatArray
    label: int
    resting: FloatArray
    moving: FloatArray
    near: float


def fit_start_pose(
    demonstrations: Sequence[Demonstration],
    protocol: Protocol,
    interactions: Sequence[str],
    left_out: Sequence[FloatArray],
    stride: int,
) -> StartPose | None:
    """Learn from each trial's start and what was wrong with a prediction that had not learned from it.

    Args:
        demonstrations: A robot's.
        protocol: How to cut them.
        interactions: By label; of each at least one trial.
        left_out: Predictions of every `stride`-th window of each trial, (n, W J) [rad].
        stride: See there.

    Returns:
        None for a robot that always starts at one place, and for a partner's arm.
    """
    starts = np.array([trial.controlled[0].ravel() for trial in demonstrations])
    if demonstrations[0].controlled.ndim == 3:
        return None
    labels = np.array([interactions.index(trial.interaction) for trial in demonstrations])
    mean = np.array([starts[labels == label].mean(axis=0) for label in range(len(interactions))])
    unusual = starts - mean[labels]
    if unusual.std() < LEAST_SPREAD_RAD:
        return None
    wrong = [
        _wrong(trial, protocol, int(label), mean[label], predicted, stride)
        for trial, label, predicted in zip(demonstrations, labels, left_out, strict=True)
    ]
    reach = REACH * np.linalg.norm(unusual, axis=1).max()
    resting, moving = _gains(wrong, len(interactions))
    return StartPose(mean, np.array([reach]), resting, moving, np.array([NEARNESS_RAD]), np.array([STANDING_RAD]))


def _wrong(
    trial: Demonstration, protocol: Protocol, label: int, mean: FloatArray, predicted: FloatArray, stride: int
) -> _Wrong:
    joints = trial.controlled[0].size
    error = (cut(trial, protocol).controlled[::stride]).reshape(-1, joints) - predicted.reshape(-1, joints)
    near = near_start(predicted.reshape(-1, joints), mean, NEARNESS_RAD)
    resting, moving = (share @ error / max(float(share.sum()), 1.0) for share in (near, 1.0 - near))
    return _Wrong(trial.controlled[0] - mean, label, resting, moving, float(near.mean()))


def _gains(wrong: Sequence[_Wrong], interactions: int) -> tuple[FloatArray, FloatArray]:
    """(P, J, J) of poses near the start, and of others: regressions of a Gaussian process, linear in the start."""
    unusual = np.array([one.unusual for one in wrong])
    labels = np.array([one.label for one in wrong])
    variances = np.maximum((unusual**2).mean(axis=0), LEAST_SPREAD_RAD**2)
    common = SHARED + (1.0 - SHARED) * (np.arange(interactions)[:, None] == labels)
    near = np.array([one.near for one in wrong])
    doubtful = PENALTY * np.clip(NEAR_SHARE / np.maximum(near, LEAST_NEAR), 1.0, MOST_PENALTY)
    joints = len(variances)
    resting, moving = (np.zeros((interactions, joints, joints)) for _ in range(2))
    any_joint = np.full(joints, ANY_JOINT / (joints * variances.mean()))
    for joint in range(joints):
        own = np.eye(joints)[joint] / variances[joint]
        shared = any_joint + OWN_JOINT * own
        kernel, everywhere = (unusual * shared) @ unusual.T * common[labels], (unusual * AT_REST * own) @ unusual.T
        rest = np.linalg.solve(kernel + everywhere + np.diag(doubtful), [one.resting[joint] for one in wrong])
        move = np.linalg.solve(kernel + PENALTY * np.eye(len(wrong)), [one.moving[joint] for one in wrong])
        resting[:, joint] = (common * rest) @ unusual * shared + rest @ unusual * AT_REST * own
        moving[:, joint] = (common * move) @ unusual * shared
    return resting, moving

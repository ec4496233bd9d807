# SPDX-License-Identifier: Apache-2.0
"""A person and Pepper: NuiSI, its second person turned into the joints of a Pepper as the authors' code does it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.recording import Demonstrations
from mild_core.learning.datasets.nuisi import NUISI
from mild_core.shapes import FloatArray, require_shape

SHOULDER_ROLL_RAD, ELBOW_ROLL_RAD = (-1.562, -0.0087), (0.0087, 1.562)
"""Pepper's limits as the mapping has them."""

LEAST_OUTWARDS_M = -0.0087
"""The mapping takes the elbow for this far outwards of the shoulder at least: an angle, there, used as a length."""


def published_angles(arm_m: FloatArray) -> FloatArray:
    """Joint angles of Pepper's right arm for a person's.

    This is the mapping that all published figures of "Pepper" are made with, and it is kept for their sake. It is
    inexact: it takes the elbow's yaw without its sign and leaves out the offset and the pitch of Pepper's elbow, which
    puts the upper arm 7 and the forearm 12 degrees off on average. Where a partner's arm is mapped while a robot moves,
    that is done exactly.

    Args:
        arm_m: (T, 3, 3) shoulder, elbow, hand [m]; x forward, y left, z up.

    Returns:
        (T, 4) shoulder pitch, shoulder roll, elbow yaw, elbow roll [rad].

    Source: L. Fritsche et al., "First-person tele-operation of a humanoid robot", Humanoids 2015, as
    github.com/souljaboy764/phd_utils applies it to NuiSI.
    """
    require_shape("arm_m", arm_m, (None, 3, 3))
    bones = np.diff(arm_m, axis=1)
    lengths = np.linalg.norm(bones, axis=2, keepdims=True)
    upper, fore = (bones / lengths).swapaxes(0, 1)
    elbow_roll = np.clip(_between(upper, fore), *ELBOW_ROLL_RAD)
    outwards = np.minimum(bones[:, 0, 1], LEAST_OUTWARDS_M) / lengths[:, 0, 0]
    shoulder_roll = np.clip(np.arcsin(outwards), *SHOULDER_ROLL_RAD)
    shoulder_pitch = np.arctan2(np.maximum(upper[:, 0], 0.0), upper[:, 2]) - np.pi / 2
    # Where the forearm would point if the elbow were not yawed: in the plane that the shoulder has turned.
    turned = shoulder_roll + elbow_roll
    level = np.cos(turned)
    unyawed = np.stack([level * np.cos(shoulder_pitch), np.sin(turned), -level * np.sin(shoulder_pitch)], axis=1)
    return np.stack([shoulder_pitch, shoulder_roll, _between(unyawed, fore), elbow_roll], axis=1)


def _between(one: FloatArray, other: FloatArray) -> FloatArray:
    """(T,) angles between unit vectors (T, 3), without sign."""
    angle: FloatArray = np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0))
    return angle


def read(path: Path) -> Demonstrations:
    """Read `traj_data.npz` of NuiSI and map the second person's arm frame by frame.

    Args:
        path: The file.

    Returns:
        The publishers' training and test trials; a file may leave one of them empty.

    Raises:
        DatasetError: See `nuisi.read`.
    """
    people = NUISI.read(path)
    return Demonstrations(tuple(map(_mapped, people.train)), tuple(map(_mapped, people.test)))


def _mapped(trial: Demonstration) -> Demonstration:
    return replace(trial, controlled=published_angles(trial.controlled), controlled_names=PEPPER_NUISI.controlled_names)


PEPPER_NUISI = replace(
    NUISI,
    name="pepper_nuisi",
    title="NuiSI: two people, the second one as a Pepper robot",
    touching=("handshake", "rocket", "parachute"),
    robot="pepper",
    controlled_names=("RShoulderPitch", "RShoulderRoll", "RElbowYaw", "RElbowRoll"),
    read=read,
)

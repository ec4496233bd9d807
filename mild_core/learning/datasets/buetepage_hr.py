# SPDX-License-Identifier: Apache-2.0
"""A person and an ABB YuMi: waving, shaking hands, and two fist bumps (Bütepage et al. 2020)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.recording import Demonstrations, Download, Recording
from mild_core.learning.data.safe_npz import numbers
from mild_core.learning.data.windows import protocols
from mild_core.learning.datasets.traj_data import one_hot, read_splits

OBSERVED_COLUMNS, CONTROLLED_COLUMNS = 9, 7
WRIST_COLUMN = 4
"""Axis 4 of the arm, the fifth in kinematic order: the one whose recorded angle is off by a turn in hand_wave."""


def read(path: Path) -> Demonstrations:
    """Read `traj_data.npz`.

    A frame has 16 columns: shoulder, elbow and hand of the person's right arm, x y z [m], then the seven joints of
    YuMi's right arm [rad] in kinematic order (axes 1, 2, 7, 3, 4, 5, 6). In hand_wave the fifth joint is recorded
    near -283 degrees and elsewhere between -22 and 133: the same pose a turn apart. A trial whose fifth joint lies
    below -180 degrees gets 2 pi added to it, so angles, errors and averages here are all in the unwrapped space.
    Frames that the publisher labels "not active" are kept and marked; the interaction of a trial is its other label.

    Args:
        path: The file.

    Returns:
        The publisher's training and test trials; a file may leave one of them empty.

    Raises:
        DatasetError: The file is not that, or a trial is malformed; names the trial.

    Source: github.com/souljaboy764/phd_utils, data_preproc/buetepage_hr.
    """
    return read_splits(path, _trial)


def _trial(thing: str, index: int, track: Any, labels: Any) -> Demonstration:
    """One trial, checked."""
    track = numbers(thing, "motion", track, OBSERVED_COLUMNS + CONTROLLED_COLUMNS)
    interaction, active = one_hot(thing, labels, len(track), BUETEPAGE_HR.interactions)
    controlled = track[:, OBSERVED_COLUMNS:].copy()
    if np.median(controlled[:, WRIST_COLUMN]) < -np.pi:
        controlled[:, WRIST_COLUMN] += 2 * np.pi
    return Demonstration(
        trial=index,
        interaction=interaction,
        rate_hz=BUETEPAGE_HR.rate_hz,
        observed_names=BUETEPAGE_HR.observed_names,
        observed_m=track[:, :OBSERVED_COLUMNS].reshape(len(track), -1, 3),
        controlled_names=BUETEPAGE_HR.controlled_names,
        controlled=controlled,
        active=active,
    )


BUETEPAGE_HR = Recording(
    name="buetepage_hr",
    title="Bütepage et al.: a person and a YuMi robot",
    file="buetepage_hr/traj_data.npz",
    rate_hz=40.0,
    interactions=("hand_wave", "handshake", "rocket", "parachute"),
    touching=("handshake", "rocket", "parachute"),
    observed_names=("shoulder", "elbow", "hand"),
    observed_side="right",
    robot="yumi",
    controlled_names=tuple(f"yumi_joint_{axis}_r" for axis in (1, 2, 7, 3, 4, 5, 6)),
    licence="the repository that publishes this form is GPL-3.0; the original recordings state no licence",
    spdx="GPL-3.0-only AND NOASSERTION",
    source="J. Bütepage, A. Ghadirzadeh, Ö. Öztimur Karadağ, M. Björkman, D. Kragic: Imitating by Generating, "
    "Frontiers in Robotics and AI 2020 (github.com/jbutepage/human_robot_interaction_data), as published in "
    "github.com/souljaboy764/phd_utils, data_preproc/buetepage_hr",
    read=read,
    protocols=protocols(window=40, keep_every=5),
    download=Download(
        "https://raw.githubusercontent.com/souljaboy764/phd_utils/"
        "b6a72a3319c3c01dff3c77b7bb930977b102caa0/"
        "data_preproc/buetepage_hr/traj_data.npz",
        sha256="08adeecdcae6ea83b141f4c1bd2c00bf980457d0688581e67611e70839fe2c80",
        size_bytes=1_314_465,
    ),
)

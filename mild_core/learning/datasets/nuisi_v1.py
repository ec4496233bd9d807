# SPDX-License-Identifier: Apache-2.0
"""The MILD paper's own six interactions of two people (NuiSI, first version; Table III)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.recording import Demonstrations, Download, Recording
from mild_core.learning.data.safe_npz import numbers
from mild_core.learning.data.windows import protocols
from mild_core.learning.datasets.traj_data import from_the_shoulder, numbered, read_splits

JOINTS = (
    *("head", "neck", "torso", "waist", "left_shoulder", "left_elbow", "left_hand"),
    *("right_shoulder", "right_elbow", "right_hand"),
)
"""Of one person, in the order of the columns."""


def read(path: Path) -> Demonstrations:
    """Read `traj_data.npz`.

    A frame has 60 columns: ten joints (`JOINTS`), x y z [m], of the first person and then of the second. The right
    arms are taken, each from its own shoulder in the first frame. About 9.2 frames a second; the publishers stretched
    the second person to the length of the first, so how late the partner came is lost. A joint that the tracker lost
    stands at one place in the file: in the published trials that befalls left arms only.

    Args:
        path: The file.

    Returns:
        Training and test trials; a file may leave one of them empty.

    Raises:
        DatasetError: The file is not that, or a trial is malformed; names the trial.

    Source: github.com/souljaboy764/nuisi_dataset, commit 360a147, `nuisiv1_dataset.npz`, names added.
    """
    return read_splits(path, _trial)


def _trial(thing: str, index: int, track: Any, label: Any) -> Demonstration:
    """One trial, checked."""
    people = numbers(thing, "motion", track, 2 * 3 * len(JOINTS)).reshape(len(track), 2, len(JOINTS), 3)
    arms = people[:, :, [JOINTS.index(f"right_{name}") for name in NUISI_V1.observed_names]]
    return Demonstration(
        trial=index,
        interaction=numbered(thing, label, NUISI_V1.interactions),
        rate_hz=NUISI_V1.rate_hz,
        observed_names=NUISI_V1.observed_names,
        observed_m=from_the_shoulder(arms[:, 0]),
        controlled_names=NUISI_V1.controlled_names,
        controlled=from_the_shoulder(arms[:, 1]),
        active=np.ones(len(track)),
    )


NUISI_V1 = Recording(
    name="nuisi_v1",
    title="NuiSI, first version: two people, the MILD paper's six interactions",
    file="nuisi_v1/traj_data.npz",
    rate_hz=9.2,
    interactions=("clapfist", "fistbump", "handshake", "highfive", "rocket", "wave"),
    touching=(),
    observed_names=("shoulder", "elbow", "hand"),
    observed_side="right",
    robot="",
    controlled_names=("shoulder", "elbow", "hand"),
    licence="AGPL-3.0",
    spdx="AGPL-3.0-only",
    source="V. Prasad, D. Koert, R. Stock-Homburg, J. Peters, G. Chalvatzaki: NuiSI dataset "
    "(github.com/souljaboy764/nuisi_dataset, commit 360a147)",
    read=read,
    protocols=protocols(window=5, keep_every=1),
    download=Download(
        "https://raw.githubusercontent.com/souljaboy764/nuisi_dataset/360a147/nuisiv1_dataset.npz",
        sha256="8bd4d7f5b46c04c8ba3e064fc4a4cdac2d5a12bf5b80bae6648acc99af71df98",
        size_bytes=1_117_750,
    ),
)

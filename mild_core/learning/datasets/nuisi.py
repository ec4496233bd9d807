# SPDX-License-Identifier: Apache-2.0
"""Two people tracked by two cameras: waving, shaking hands, and two fist bumps (NuiSI)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.recording import Demonstrations, Download, Recording
from mild_core.learning.data.safe_npz import numbers
from mild_core.learning.data.windows import protocols
from mild_core.learning.datasets.traj_data import from_the_shoulder, numbered, read_splits

ARM_COLUMNS = 9


def read(path: Path) -> Demonstrations:
    """Read `traj_data.npz`.

    A frame has 18 columns: right shoulder, elbow and wrist, x y z [m], of the first person and then of the second,
    each in that person's own body frame at the start (x forward, y left, z up). Here each arm's origin is its own
    shoulder in the first frame, which the body frame has 17 cm off. The first person is observed, the second is the
    partner. The tracker's wrist is called hand, as in the other recordings.

    Args:
        path: The file.

    Returns:
        The publishers' training and test trials; a file may leave one of them empty.

    Raises:
        DatasetError: The file is not that, or a trial is malformed; names the trial.

    Source: github.com/souljaboy764/phd_utils, data_preproc/nuisi.
    """
    return read_splits(path, _trial)


def _trial(thing: str, index: int, track: Any, label: Any) -> Demonstration:
    """One trial, checked."""
    track = numbers(thing, "motion", track, 2 * ARM_COLUMNS)
    return Demonstration(
        trial=index,
        interaction=numbered(thing, label, NUISI.interactions),
        rate_hz=NUISI.rate_hz,
        observed_names=NUISI.observed_names,
        observed_m=from_the_shoulder(track[:, :ARM_COLUMNS]),
        controlled_names=NUISI.controlled_names,
        controlled=from_the_shoulder(track[:, ARM_COLUMNS:]),
        active=np.ones(len(track)),
    )


NUISI = Recording(
    name="nuisi",
    title="NuiSI: two people",
    file="nuisi/traj_data.npz",
    rate_hz=30.0,
    interactions=("waving", "handshake", "rocket", "parachute"),
    touching=(),
    observed_names=("shoulder", "elbow", "hand"),
    observed_side="right",
    robot="",
    controlled_names=("shoulder", "elbow", "hand"),
    licence="AGPL-3.0 the recordings, GPL-3.0 the repository that publishes this form",
    spdx="AGPL-3.0-only AND GPL-3.0-only",
    source="V. Prasad, D. Koert, R. Stock-Homburg, J. Peters, G. Chalvatzaki: NuiSI dataset "
    "(github.com/souljaboy764/nuisi_dataset), as published in github.com/souljaboy764/phd_utils, data_preproc/nuisi",
    read=read,
    protocols=protocols(window=5, keep_every=1),
    download=Download(
        "https://raw.githubusercontent.com/souljaboy764/phd_utils/"
        "b6a72a3319c3c01dff3c77b7bb930977b102caa0/"
        "data_preproc/nuisi/traj_data.npz",
        sha256="ffc98d4b7006a02fc65791573d8a684cf0e80fa95032bfdd525dfdbf26a3a19b",
        size_bytes=1_689_309,
    ),
)

# SPDX-License-Identifier: Apache-2.0
"""Published recordings that models are learned from: one file each, all read into `Demonstration`."""

from __future__ import annotations

from pathlib import Path

from mild_core.errors import unknown_name
from mild_core.learning.data.recording import Recording, data_folder
from mild_core.learning.data.trials import MANIFEST, recording_of
from mild_core.learning.datasets.buetepage_hh import BUETEPAGE_HH
from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from mild_core.learning.datasets.nuisi import NUISI
from mild_core.learning.datasets.nuisi_v1 import NUISI_V1
from mild_core.learning.datasets.pepper_nuisi import PEPPER_NUISI

DATASETS: dict[str, Recording] = {
    recording.name: recording for recording in (BUETEPAGE_HR, BUETEPAGE_HH, NUISI, PEPPER_NUISI, NUISI_V1)
}


def recording_named(name: str, data: Path | None = None) -> Recording:
    """The recording of that name, or in that folder of trials.

    Args:
        name: In `DATASETS`, of what `mild data` made, or the path of a folder that `mild demonstrations` wrote.
        data: What the user gave as its file or folder; a folder of trials wins over any name.

    Raises:
        SetupError: There is none.
    """
    if data is not None and data.is_dir() and name != BUETEPAGE_HH.name:
        return recording_of(data)
    if name in DATASETS:
        return DATASETS[name]
    folder = Path(name).expanduser()
    if folder.is_dir() or len(folder.parts) > 1:
        return recording_of(folder)
    made = data_folder() / name
    if (made / MANIFEST).exists():
        return recording_of(made)
    raise unknown_name("dataset", name, (*DATASETS, "what mild data makes", "the path of a folder of trials"))

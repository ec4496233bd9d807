# SPDX-License-Identifier: Apache-2.0
"""Published recordings that models are learned from: one file each, all read into `Demonstration`."""

from __future__ import annotations

from mild_core.errors import unknown_name
from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from mild_core.learning.datasets.nuisi import NUISI
from mild_core.learning.datasets.nuisi_v1 import NUISI_V1
from mild_core.learning.datasets.pepper_nuisi import PEPPER_NUISI
from mild_core.learning.recording import Recording

DATASETS: dict[str, Recording] = {
    recording.name: recording for recording in (BUETEPAGE_HR, NUISI, PEPPER_NUISI, NUISI_V1)
}


def recording_named(name: str) -> Recording:
    """The recording of that name.

    Raises:
        SetupError: There is none.
    """
    if name not in DATASETS:
        raise unknown_name("dataset", name, DATASETS)
    return DATASETS[name]

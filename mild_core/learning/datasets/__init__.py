# SPDX-License-Identifier: Apache-2.0
"""Published recordings that models are learned from: one file each, all read into `Demonstration`."""

from __future__ import annotations

from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from mild_core.learning.recording import Recording

DATASETS: dict[str, Recording] = {"buetepage_hr": BUETEPAGE_HR}

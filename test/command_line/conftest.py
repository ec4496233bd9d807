# SPDX-License-Identifier: Apache-2.0
"""What several commands are tried on."""

import pytest

from mild_core.inference.model import save_model
from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from test.core.inference.random_model import manifest, paper_member, random_arrays


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A folder with a model of random weights for the YuMi recording."""
    described = manifest((paper_member(),), components=3, interactions=BUETEPAGE_HR.interactions)
    folder = tmp_path_factory.mktemp("models") / "made"
    save_model(folder, described, random_arrays(described), "# Model card: made\n")
    return folder

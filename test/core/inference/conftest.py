# SPDX-License-Identifier: Apache-2.0
"""Models that several tests look at; building one is quick, but compiling for it is not."""

from __future__ import annotations

import pytest

from mild_core.inference.model import MildModel, build_model, save_model
from test.core.inference.random_model import manifest, paper_member, random_arrays, recurrent_member


@pytest.fixture(scope="session")
def paper_model() -> MildModel:
    """One member of the paper's kind, small."""
    of = manifest((paper_member(hidden=(20, 12)),), components=4)
    return build_model(of, random_arrays(of))


@pytest.fixture(scope="session")
def full_model() -> MildModel:
    """Two members with everything that a member can have, two copies taking turns."""
    of = manifest((recurrent_member(), recurrent_member()), components=4, stride=2)
    return build_model(of, random_arrays(of, 1))


@pytest.fixture(scope="session")
def model_folder(tmp_path_factory):
    """A good folder; tests copy it before they break it."""
    folder = tmp_path_factory.mktemp("models") / "random"
    of = manifest((paper_member(hidden=(20, 12)),), components=4)
    save_model(folder, of, random_arrays(of), "# A model with random weights\n")
    return folder

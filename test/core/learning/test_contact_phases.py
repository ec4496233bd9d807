# SPDX-License-Identifier: Apache-2.0
"""Which interactions bring hands together, and when: found in trials of two people, each seen from the own shoulder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mild_core.inference.manifest import HumanPlacement
from mild_core.inference.manifest_reading import read_manifest
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.datasets import DATASETS
from mild_core.learning.training.contact_phases import contact_phases
from test.conftest import ROOT

JOINTS = ("shoulder", "elbow", "hand")
NOWHERE = HumanPlacement((1.0, 0.0, 0.7), np.pi)


def _trial(interaction: str, way_m: tuple[float, float, float], partner: bool = True) -> Demonstration:
    """An arm that goes from hanging to a place, waits there, and comes back, in quarters of the time."""
    share = np.interp(np.linspace(0.0, 4.0, 81), [0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 0.0, 1.0, 1.0, 0.0])
    hand = np.array([0.0, 0.0, -0.5]) + share[:, None] * np.array(way_m)
    arm = np.stack([0.0 * hand, 0.5 * hand, hand], axis=1)
    controlled = arm if partner else np.zeros((len(arm), 2))
    names = JOINTS if partner else ("first", "second")
    return Demonstration(0, interaction, 20.0, JOINTS, arm, names, controlled, np.ones(len(arm)))


@pytest.mark.parametrize(("aside_m", "meets"), [(0.18, True), (0.05, True), (-0.1, False), (-0.3, False)])
def test_hands_touch_where_people_opposite_each_other_bring_them_to_one_place(aside_m: float, meets: bool) -> None:
    """A right hand that stays on its own side, as one that waves, is far from the other's."""
    found = contact_phases([_trial("any", (0.5, aside_m, 0.5))], NOWHERE)
    assert set(found) == ({"any"} if meets else set())


def test_the_phase_is_the_share_of_the_motion_in_which_the_hand_is_held_out() -> None:
    first, last = contact_phases([_trial("shake", (0.5, 0.2, 0.5))], NOWHERE)["shake"]
    assert first == pytest.approx(1.0 / 3.0, abs=0.06)
    assert last == pytest.approx(2.0 / 3.0, abs=0.06)


def test_where_a_robot_was_there_hands_touch_in_the_interactions_that_have_places() -> None:
    trials = [_trial(name, (0.5, -0.3, 0.5), partner=False) for name in ("shake", "wave")]
    placement = HumanPlacement((1.0, 0.0, 0.7), np.pi, {"shake": (1.0, 0.0, 0.7)})
    assert set(contact_phases(trials, placement)) == {"shake"}


def test_every_shipped_model_says_in_which_interactions_hands_touch() -> None:
    for path in sorted((ROOT / "models").glob("*/manifest.json")):
        manifest = read_manifest(path.parent)
        waves = {name for name in manifest.interactions if "wav" in name}
        assert set(manifest.contact) == set(manifest.interactions) - waves, path.parent.name


@pytest.mark.parametrize("name", ["nuisi", "nuisi_v1"])
def test_recorded_people_touch_in_all_but_waves_as_the_shipped_models_say(mild_data: Path, name: str) -> None:
    recording = DATASETS[name]
    found = contact_phases(recording.read(mild_data / recording.file).train, NOWHERE)
    model = "nuisi_v1_partner_same" if name == "nuisi_v1" else "nuisi_partner_next"
    assert found == dict(read_manifest(ROOT / "models" / model).contact)

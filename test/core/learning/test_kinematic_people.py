# SPDX-License-Identifier: Apache-2.0
"""People of our own making: what they do, how a robot meets them, and that their models stand under our licence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mild_core.inference.gesture_recogniser import FOREARM, GESTURES, UPPER_ARM
from mild_core.inference.manifest_reading import read_manifest
from mild_core.learning.data.trials import recording_of, write_trials
from mild_core.learning.training.gestures import has_left_rest
from mild_core.learning.training.kinematic_people import LICENCE, TOUCHING, TRIALS_HZ, kinematic_trials, perform
from mild_core.learning.training.licences import both, licence_of, sources_of
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robots import ROBOTS

MODELS = Path(__file__).parents[3] / "models"
MOST_BYTES = 1_500_000


@pytest.mark.parametrize("interaction", GESTURES)
def test_an_arm_leaves_its_rest_comes_back_and_keeps_its_bones(interaction: str) -> None:
    for seed in range(5):
        arm = perform(interaction, np.random.default_rng(seed))
        lengths = np.linalg.norm(np.diff(arm, axis=1), axis=2)
        np.testing.assert_allclose(lengths, np.tile([UPPER_ARM, FOREARM], (len(arm), 1)), atol=1e-6)
        away = has_left_rest(arm)
        assert away.any()
        assert not away[0]
        assert np.linalg.norm(arm[-1, 2] - arm[-1, 0] - (arm[0, 2] - arm[0, 0])) < 0.3


@pytest.mark.parametrize("name", ["yumi", "pepper"])
def test_the_robot_meets_the_hand_inside_its_limits(name: str, tmp_path: Path) -> None:
    robot = ROBOTS[name]
    trials, made = kinematic_trials(name, robot, 1, seed=3)
    write_trials(tmp_path / "made", trials, made)
    recording = recording_of(tmp_path / "made")
    assert (recording.spdx, recording.interactions) == (LICENCE, GESTURES)
    place, chain = np.array(trials.robot_from_human.translation_m), chain_of(robot)  # type: ignore[union-attr]
    nearest_m = []
    for trial in recording.read(tmp_path / "made").train:
        assert (trial.controlled >= robot.lower_rad).all()
        assert (trial.controlled <= robot.upper_rad).all()
        assert (np.abs(np.diff(trial.controlled, axis=0)) * TRIALS_HZ <= robot.velocity_rad_s).all()
        hand = place + trial.observed_m[:, 2] * np.array([-1.0, -1.0, 1.0])
        tool = np.array([chain.tool(joints) for joints in trial.controlled])
        if trial.interaction in TOUCHING:
            nearest_m.append(float(np.linalg.norm(hand - tool, axis=1).min()))
    assert np.median(nearest_m) < 0.05
    assert max(nearest_m) < 0.1, "some hands are out of Pepper's reach"


def test_licences_are_put_together_once_each() -> None:
    assert both(["Apache-2.0"]) == "Apache-2.0"
    assert (
        both(["AGPL-3.0-only AND GPL-3.0-only", "", "GPL-3.0-only"]) == "AGPL-3.0-only AND GPL-3.0-only AND NOASSERTION"
    )
    assert both([]) == "NOASSERTION"


@pytest.mark.parametrize("folder", sorted(MODELS.iterdir()), ids=lambda folder: folder.name)
def test_every_shipped_model_names_the_licences_of_its_sources(folder: Path) -> None:
    manifest = read_manifest(folder)
    sources = sources_of(manifest)
    assert manifest.licence == licence_of(manifest) == both(sources.values())
    for name in manifest.training.get("gestures", "").split("; "):
        if " (" in name:
            assert name.split(" (")[0] in sources
    if "kinematic" in folder.name:
        assert manifest.licence == LICENCE
        assert sum(file.stat().st_size for file in folder.iterdir()) < MOST_BYTES
    elif manifest.training["dataset"] in ("nuisi", "pepper_nuisi", "nuisi_v1"):
        assert "AGPL-3.0-only" in manifest.licence

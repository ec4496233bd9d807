# SPDX-License-Identifier: Apache-2.0
"""An exported model answers at run time what torch answers, and knows its own people from strangers."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.inference.model import build_model, load_model, save_model
from mild_core.learning.data.windows import PROTOCOLS
from mild_core.learning.training.algorithm import train
from mild_core.learning.training.export import ModelFacts, export
from mild_core.learning.training.learned_model import finished
from mild_core.learning.training.model_predictor import ModelPredictor
from mild_core.learning.training.novelty import bone_lengths_m
from test.core.learning.made_trials import JOINTS, made_trial, made_trials
from test.core.learning.small_settings import SMALL, SMALL_PAPER

TRIALS = made_trials(each=3, frames=130)
SETTINGS = {"ours": replace(SMALL, members=2), "paper": SMALL_PAPER}


def trained_and_exported(settings, protocol="same"):
    trained = finished(train(TRIALS, PROTOCOLS[protocol], settings, 0))
    return trained, *export(trained, TRIALS, 0.01 * np.eye(3), ModelFacts("small", robot="yumi"))


@pytest.mark.parametrize("name", SETTINGS)
def test_the_run_time_answers_what_torch_answers(name):
    trained, manifest, arrays = trained_and_exported(SETTINGS[name])
    predictor = ModelPredictor(build_model(manifest, arrays), PROTOCOLS["same"])
    for trial in (TRIALS[0], TRIALS[4], made_trial(77, "push", 133)):
        # Both run in single precision, in another order of additions.
        np.testing.assert_allclose(predictor.predict(trial), trained.predict(trial), atol=2e-5)


def test_velocities_and_another_rate_reach_the_run_time_too():
    settings = replace(SMALL, stride=2, gradient_stride=2)
    trained, manifest, arrays = trained_and_exported(settings, "next")
    assert (manifest.rate_hz, manifest.window, manifest.lead_frames, manifest.stride) == (8.0, 5, 1, 2)
    predictor = ModelPredictor(build_model(manifest, arrays), PROTOCOLS["next"])
    np.testing.assert_allclose(predictor.predict(TRIALS[1]), trained.predict(TRIALS[1]), atol=2e-5)


def test_the_folder_is_read_back_whole(tmp_path):
    _, manifest, arrays = trained_and_exported(SMALL)
    save_model(tmp_path / "small", manifest, arrays, "# small\n")
    model = load_model(tmp_path / "small")
    assert model.manifest.interactions == ("reach", "push")
    assert model.manifest.controlled.joint_names == JOINTS
    assert model.manifest.protocol == "same"
    assert model.manifest.lead_frames == -39
    # The trials' arm.
    np.testing.assert_allclose(model.manifest.observed.bone_lengths_m, (0.18, 0.23), atol=1e-6)


def test_no_window_that_was_learned_from_is_stored():
    _, manifest, arrays = trained_and_exported(SMALL)
    sizes = {name: array.size for name, array in arrays.items()}
    frames = sum(trial.frames for trial in TRIALS)
    largest = max(sizes, key=lambda name: sizes[name])
    assert largest.endswith(("coordinates.weight", "territory.weight")), "the largest array is the basis of windows"
    centres = arrays["territory.centres"]
    assert len(centres) <= 2 * 64 < frames
    assert centres.shape[1] == 20 < manifest.window * manifest.frame_values


def test_a_learned_motion_is_known_and_a_strange_one_is_not():
    _, manifest, arrays = trained_and_exported(SMALL)
    predictor = ModelPredictor(build_model(manifest, arrays), PROTOCOLS["same"])
    known = predictor.answers(TRIALS[0], "reach").out_of_distribution
    strange = replace(TRIALS[0], observed_m=TRIALS[0].observed_m[:, :, [1, 0, 2]] + np.array([0.0, 0.4, 0.2]))
    unknown = predictor.answers(strange, "reach").out_of_distribution
    # By construction of the radii hardly any window that was learned from lies beyond them.
    assert (known > 1.0).mean() < 0.02
    # What is strange adds up over time.
    assert (unknown[20:] > 1.0).all()


def test_bone_lengths_are_medians():
    tracks = [trial.observed_m for trial in TRIALS]
    tracks.append(1.5 * TRIALS[0].observed_m[:10])
    np.testing.assert_allclose(bone_lengths_m(tracks), (0.18, 0.23), atol=1e-9)

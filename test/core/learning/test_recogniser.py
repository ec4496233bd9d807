# SPDX-License-Identifier: Apache-2.0
"""The recogniser network knows those it has learned, and nothing before the person moves."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mild_core.inference.model import build_model
from mild_core.learning.data.windows import PROTOCOLS
from mild_core.learning.training.algorithm import drawing_from, train
from mild_core.learning.training.corpus import corpus_of, cut_tracks
from mild_core.learning.training.export import ModelFacts, export, recognition_rates
from mild_core.learning.training.learned_model import finished
from mild_core.learning.training.presets import PAPER, SAME
from mild_core.learning.training.recogniser import STARTED_M, train_recogniser
from mild_core.learning.training.settings import Augmentation, RecogniserSettings
from test.core.learning.made_trials import made_trial, made_trials
from test.core.learning.small_settings import SMALL, TWO

SAME_SECOND = PROTOCOLS["same"]
QUICK = RecogniserSettings(question_coordinates=6, hidden=(16,), dropout=0.0, learning_rate=1e-2)


def aside(trial):
    """The same movement to the side instead of forward: the difference of `push` from `reach` here."""
    return replace(trial, observed_m=trial.observed_m[..., [1, 0, 2]]) if trial.interaction == "push" else trial


TRIALS = tuple(aside(trial) for trial in made_trials(each=4, frames=130))


def probabilities(recogniser, trial):
    """Windows at rest and windows after the hand has moved, (N, 2) each."""
    batch = cut_tracks(corpus_of([trial], SAME_SECOND, TWO), corpus_of([trial], SAME_SECOND, TWO).tracks, 0, 1)
    with torch.no_grad():
        found = torch.softmax(recogniser.logits(batch.question), -1)[0].numpy()
    hand = trial.observed_m[:, -1]
    moved = np.linalg.norm(hand - hand[0], axis=1) > STARTED_M
    start = int(moved.argmax())
    newest = np.arange(len(found)) + SAME_SECOND.window - 1
    return found[newest < start - 10], found[(newest > start + 20) & moved[newest]]


def test_it_classifies_new_trials_once_the_hand_has_moved():
    learned = tuple(aside(trial) for trial in made_trials(each=4, frames=300))  # long enough for windows at rest
    with drawing_from(0):
        recogniser = train_recogniser(corpus_of(learned, SAME_SECOND, TWO), QUICK, Augmentation(), 80)
    for label, name in enumerate(TWO):
        resting, moving = probabilities(recogniser, aside(made_trial(50, name, 310)))
        assert len(resting) > 0
        assert len(moving) > 10
        assert (moving[:, label] > 0.9).mean() > 0.9
        # A resting person shows nothing: one of two, give or take what a small network makes of noise.
        assert abs(resting - 0.5).max() < 0.2


def test_it_runs_as_it_was_learned_and_moves_no_other_weight():
    with_one = replace(SMALL, recogniser=QUICK)
    trained, without = (
        finished(train(TRIALS, SAME_SECOND, settings, 0))
        for settings in (with_one, replace(SMALL, recogniser=None, reservoir=None, start_pose=False))
    )
    for name, value in trained.members[0].networks.state_dict().items():
        assert torch.equal(value, without.members[0].networks.state_dict()[name])
    manifest, arrays = export(trained, TRIALS, 0.01 * np.eye(3), ModelFacts("small"))
    model, recogniser = build_model(manifest, arrays), trained.members[0].recogniser
    network = model.members[0].networks["recogniser"]
    assert manifest.members[0]["recogniser"].inputs == ("window",)
    track = torch.tensor(TRIALS[5].observed_m.reshape(len(TRIALS[5].observed_m), -1), dtype=torch.float32)
    for frame in (0, 60):
        window = track[frame : frame + 40].reshape(-1)
        with torch.no_grad():
            wanted = recogniser.logits(window).numpy()
        # Both run in single precision, in another order of additions.
        np.testing.assert_allclose(network.run(window.numpy(), network.first_memory())[0], wanted, atol=2e-5)
    assert (model.temper, model.forgetting) == tuple(recognition_rates(40.0, SAME))
    manifest, arrays = export(without, TRIALS, 0.01 * np.eye(3), ModelFacts("small"))
    assert "recogniser" not in manifest.members[0]
    assert "recognition" not in arrays


def test_evidence_counts_by_time_and_not_by_frames():
    temper, forgetting = recognition_rates(40.0, SAME)
    fast_temper, fast_forgetting = recognition_rates(80.0, SAME)
    assert 40.0 * temper == 80.0 * fast_temper
    assert np.isclose(forgetting**40, fast_forgetting**80)
    assert recognition_rates(2.0, SAME)[0] == 1.0
    quick = replace(SAME, evidence_per_s=2.0, evidence_kept_per_s=0.25)
    np.testing.assert_allclose(recognition_rates(40.0, quick), [0.05, 0.25**0.025])


@pytest.mark.parametrize("wrong", [{"evidence_per_s": 0.0}, {"evidence_kept_per_s": 0.0}, {"evidence_kept_per_s": 1.1}])
def test_evidence_that_never_counts_or_grows_is_refused(wrong):
    with pytest.raises(ValueError, match="evidence_per_s must be above 0"):
        replace(SAME, **wrong)


def test_the_papers_model_has_none():
    assert PAPER.recogniser is None
    assert SAME.recogniser is not None

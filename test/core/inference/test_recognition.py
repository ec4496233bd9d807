# SPDX-License-Identifier: Apache-2.0
"""Recognition as a small filter over interactions, and what is answered by it."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.inference.recognition import CLOSEST_CALL, one_hot_belief, recognise, uniform_belief
from mild_core.inference.stage import NEGLIGIBLE, Inference
from test.core.inference.random_model import INTERACTIONS
from test.core.inference.test_stage import CLOSE, run, windows


def test_one_frame_weighs_by_its_tempered_likelihood():
    log_likelihoods = np.array([-3.0, -1.0, -2.0])
    after = recognise(uniform_belief(3), log_likelihoods, 0.5, 1.0)
    expected = np.exp(0.5 * log_likelihoods)
    np.testing.assert_allclose(after.probabilities, expected / expected.sum(), atol=1e-12)
    assert (after.likeliest, after.probability) == (1, pytest.approx(after.probabilities[1]))


def test_evidence_adds_up_and_fades():
    now, frames = uniform_belief(2), 300
    for _ in range(frames):
        now = recognise(now, np.array([0.0, -1.0]), 0.1, 0.97)
    # The geometric series 0.1 (1 + 0.97 + ...) ends at 0.1 / 0.03 nats.
    assert now.evidence[0] - now.evidence[1] == pytest.approx(0.1 / 0.03, rel=1e-3)
    turned = 0
    while now.likeliest == 0:
        now, turned = recognise(now, np.array([-1.0, 0.0]), 0.1, 0.97), turned + 1
    # Half of the evidence is gone after ln 2 / -ln 0.97 frames, and as much has come from the other side.
    assert turned == pytest.approx(np.log(2.0) / -np.log(0.97), abs=1.0)


def test_one_bad_frame_decides_nothing_for_good():
    after = recognise(uniform_belief(2), np.array([0.0, -1e9]), 0.1, 0.97)
    assert after.evidence.min() == pytest.approx(-0.1 * CLOSEST_CALL)


def test_what_is_given_is_certain():
    conditioned = one_hot_belief(2, 4)
    np.testing.assert_array_equal(conditioned.probabilities, [0, 0, 1, 0])
    assert (conditioned.likeliest, conditioned.probability) == (2, 1.0)


def test_predictions_per_interaction_are_averaged_with_the_posterior(full_model):
    conditioned = [run(Inference(full_model, name), windows(30))[1] for name in INTERACTIONS]
    stage = Inference(full_model)
    state, unsure = stage.init(), 0
    for index, window in enumerate(windows(30)):
        state, (answer,) = stage.step(state, window, 0)
        shares = state.recognition.probabilities
        unsure += shares.max() < 0.9
        assert shares.min() > NEGLIGIBLE
        motions = np.array([answers[index].positions for answers in conditioned])
        mixed = np.tensordot(shares, motions, 1)
        np.testing.assert_allclose(answer.positions, mixed, atol=CLOSE)
        apart = motions - mixed
        within = np.tensordot(shares, [answers[index].covariance for answers in conditioned], 1)
        between = np.einsum("n,nwa,nwb->ab", shares, apart, apart) / len(mixed)
        np.testing.assert_allclose(answer.covariance, within + between, atol=CLOSE)
        likeliest = conditioned[int(shares.argmax())][index]
        np.testing.assert_array_equal(answer.belief, likeliest.belief)
        assert answer.phase == likeliest.phase
        assert answer.out_of_distribution == min(answers[index].out_of_distribution for answers in conditioned)
    assert unsure > 10

# SPDX-License-Identifier: Apache-2.0
"""Recognition as a small filter over interactions."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.inference.recognition import CLOSEST_CALL, given, recognise, undecided


def test_one_frame_weighs_by_its_tempered_likelihood():
    log_likelihoods = np.array([-3.0, -1.0, -2.0])
    after = recognise(undecided(3), log_likelihoods, 0.5, 1.0)
    expected = np.exp(0.5 * log_likelihoods)
    np.testing.assert_allclose(after.probabilities, expected / expected.sum(), atol=1e-12)
    assert (after.likeliest, after.probability) == (1, pytest.approx(after.probabilities[1]))


def test_evidence_adds_up_and_fades():
    now, frames = undecided(2), 300
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
    after = recognise(undecided(2), np.array([0.0, -1e9]), 0.1, 0.97)
    assert after.evidence.min() == pytest.approx(-0.1 * CLOSEST_CALL)


def test_what_is_given_is_certain():
    told = given(2, 4)
    np.testing.assert_array_equal(told.probabilities, [0, 0, 1, 0])
    assert (told.likeliest, told.probability) == (2, 1.0)

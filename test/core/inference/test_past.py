# SPDX-License-Identifier: Apache-2.0
"""Fading means remember where the arm has been, at any rate and over gaps, and the same in torch."""

import numpy as np
import pytest
import torch

from mild_core.inference.past import fade, kept_per_frame
from mild_core.learning.recogniser import faded

PAST_S = (0.5, 2.0)


def test_a_step_is_followed_by_a_share_of_1_minus_1_over_e_in_one_time_constant():
    kept = kept_per_frame(PAST_S, 100.0)
    past = fade(None, np.zeros(3), kept)
    for _ in range(50):
        past = fade(past, np.array([1.0, 2.0, 0.0]), kept)
    assert past.shape == (2, 3)
    np.testing.assert_allclose(past[0], (1 - np.exp(-1.0)) * np.array([1.0, 2.0, 0.0]))
    np.testing.assert_allclose(past[1], (1 - np.exp(-0.25)) * np.array([1.0, 2.0, 0.0]))


def test_missed_frames_count_as_the_newest_one():
    kept = kept_per_frame(PAST_S, 30.0)
    slow = steady = fade(None, np.zeros(2), kept)
    for _ in range(4):
        steady = fade(steady, np.ones(2), kept)
    np.testing.assert_allclose(fade(slow, np.ones(2), kept, passed=4), steady)


@pytest.mark.parametrize("past_s", [PAST_S, (), (0.3,)])
def test_torch_fades_whole_tracks_alike(past_s):
    track = np.random.default_rng(0).normal(size=(60, 9))
    kept, past, rows = kept_per_frame(past_s, 25.0), None, []
    for frame in track:
        past = fade(past, frame, kept)
        rows.append(past.ravel())
    found = faded(torch.tensor(track[None], dtype=torch.float32), past_s, 25.0)[0].numpy()
    # Single precision over sixty frames.
    np.testing.assert_allclose(found, np.array(rows), atol=1e-5)

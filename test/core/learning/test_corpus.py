# SPDX-License-Identifier: Apache-2.0
"""Tensors of windows are the windows that errors are measured on; bending changes what it says and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mild_core.learning.data.coordinates import plain_coordinates, principal_coordinates
from mild_core.learning.data.windows import PROTOCOLS, cut
from mild_core.learning.training.corpus import augment, corpus_of, cut_tracks, turn_and_move
from mild_core.learning.training.settings import Augmentation
from test.core.learning.made_trials import made_trials
from test.core.learning.small_settings import TWO

TRIALS = made_trials(each=2, frames=101)
STILL = Augmentation(copies=1, speed=0.0, unsteadiness=0.0, arm_scale=0.0, yaw_rad=0.0, offset_m=0.0)


@pytest.mark.parametrize("name", PROTOCOLS)
@pytest.mark.parametrize(("first", "stride"), [(0, 1), (3, 4)])
def test_windows_are_those_of_the_protocol(name, first, stride):
    protocol = PROTOCOLS[name]
    corpus = corpus_of(TRIALS, protocol, TWO)
    batch = cut_tracks(corpus, corpus.tracks, first, stride)
    assert batch.label.tolist() == [0, 0, 1, 1]
    for row, trial in enumerate(TRIALS):
        expected = cut(trial, protocol)
        count = int(batch.valid[row].sum())
        assert count == len(expected.observed[first::stride])
        assert (batch.valid[row, :count] == 1).all(), "what was not recorded comes last"
        for part, whole in ((batch.question, expected.observed), (batch.answer, expected.controlled)):
            wanted = whole[first::stride].reshape(count, -1)
            # Single precision of positions near one, times the rate for velocities.
            np.testing.assert_allclose(part[row, :count].numpy(), wanted, atol=2e-6)


def test_bending_by_nothing_changes_nothing():
    corpus = corpus_of(TRIALS, PROTOCOLS["same"], TWO)
    bent = augment(corpus.tracks, STILL)
    assert torch.equal(bent.alive, corpus.tracks.alive)
    np.testing.assert_allclose(bent.observed, corpus.tracks.observed, atol=1e-6)
    np.testing.assert_allclose(bent.controlled, corpus.tracks.controlled, atol=1e-6)


def test_bending_time_takes_both_agents_along():
    torch.manual_seed(0)
    corpus = corpus_of(TRIALS, PROTOCOLS["same"], TWO)
    frames = torch.arange(corpus.tracks.alive.shape[1], dtype=torch.float32)
    counting = replace(
        corpus.tracks,
        observed=frames[None, :, None].expand(4, -1, 9).clone(),
        controlled=2.0 * frames[None, :, None].expand(4, -1, 3),
    )
    bent = augment(counting, replace(STILL, copies=3, speed=0.2, unsteadiness=0.15))
    assert bent.observed.shape[0] == len(bent.label) == 12
    np.testing.assert_allclose(2.0 * bent.observed[..., 0], bent.controlled[..., 0], rtol=1e-5)
    steps = bent.observed[..., 0].diff(dim=1)[bent.alive[:, 1:]]
    assert steps.min() > 0.4
    assert steps.max() < 2.5
    assert steps.std() > 0.05
    last = corpus.tracks.alive.sum(dim=1).repeat(3) - 1
    assert (bent.observed[..., 0].max(dim=1).values <= last).all()


def test_bending_the_human_keeps_directions_between_joints_up_to_one_turn_and_one_length():
    torch.manual_seed(0)
    corpus = corpus_of(TRIALS, PROTOCOLS["same"], TWO)
    bent = augment(corpus.tracks, replace(STILL, arm_scale=0.1, yaw_rad=0.15))
    before = corpus.tracks.observed.unflatten(-1, (3, 3)).diff(dim=2)
    after = bent.observed.unflatten(-1, (3, 3)).diff(dim=2)
    ratio = after.norm(dim=-1) / before.norm(dim=-1)
    np.testing.assert_allclose(ratio, ratio[:, :1, :1].expand_as(ratio), rtol=1e-4)
    assert ((ratio > 0.9) & (ratio < 1.1)).all()
    np.testing.assert_allclose(after[..., 2], before[..., 2] * ratio, atol=1e-5)
    assert torch.equal(bent.controlled, augment(corpus.tracks, STILL).controlled)


def test_a_turn_is_about_the_vertical_with_the_length_and_then_the_move():
    rng = np.random.default_rng(0)
    positions, moved = rng.normal(size=(1, 5, 9)).astype(np.float32), rng.normal(size=(1, 9)).astype(np.float32)
    angle, scale = 0.4, 1.1
    about_z = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    expected = (scale * positions.reshape(5, 3, 3) @ about_z.T).reshape(1, 5, 9) + moved[:, None]
    turned = np.array([[scale * np.cos(angle), scale * np.sin(angle), scale]], dtype=np.float32)
    turn_and_move(positions, turned, moved)
    np.testing.assert_allclose(positions, expected, atol=1e-5)


def test_principal_coordinates_keep_what_they_span_and_weigh_errors_by_the_windows_variance():
    generator = torch.Generator().manual_seed(1)
    windows = torch.randn(200, 3, generator=generator) @ torch.randn(3, 12, generator=generator) + 2.0
    coordinates = principal_coordinates(windows, 3, 0.3)
    projected = coordinates.project(windows)
    np.testing.assert_allclose(coordinates.restore(projected), windows, atol=1e-4)
    variance = (windows - windows.mean(dim=0)).square().sum(dim=1).mean()
    expected = (windows - windows.roll(1, 0)).square().sum(dim=1) / variance
    found = ((projected - projected.roll(1, 0)) ** 2 * coordinates.errors).sum(dim=1)
    np.testing.assert_allclose(found, expected, rtol=1e-3)
    plain = plain_coordinates(windows)
    assert torch.equal(plain.restore(plain.project(windows)), windows)
    untouched = ((windows - windows.roll(1, 0)) ** 2 * plain.errors).sum(dim=1)
    np.testing.assert_allclose(untouched, expected, rtol=1e-4)

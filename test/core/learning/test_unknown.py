# SPDX-License-Identifier: Apache-2.0
"""Unseen motions are detected as unknown: exactly on synthetic scores, better than nearest neighbour on recordings."""

import numpy as np
import pytest

from mild_core.learning.data.folds import folds_of
from mild_core.learning.data.windows import PROTOCOLS, onset_window
from mild_core.learning.datasets import DATASETS
from mild_core.learning.evaluation.unknown import leave_one_out, separation
from mild_core.learning.training.novelty import clustered, settled_scores, territory_of
from test.core.learning.made_trials import made_trial, made_trials


def test_separation_of_scores_whose_order_is_known():
    known = [np.arange(100.0), np.arange(100.0)]
    assert separation(known, [np.full(50, 200.0)]) == separation(known, [np.full(5, 1e6)])
    apart = separation(known, [np.full(50, 200.0)])
    assert (apart.share, apart.area) == (1.0, 1.0)
    alike = separation(known, [np.arange(100.0)])
    assert alike.area == pytest.approx(0.5)
    assert alike.share == pytest.approx(0.05, abs=0.01)


def test_a_windows_number_counts_from_the_hands_first_five_centimetres():
    trial, protocol = made_trial(0, frames=200), PROTOCOLS["ahead"]
    hand = trial.observed_m[:, -1]
    frame = int((np.linalg.norm(hand - hand[:10].mean(axis=0), axis=1) > 0.05).argmax())
    assert 39 < frame < 100
    assert onset_window(trial, protocol) == frame - 39
    assert onset_window(trial, protocol, after_s=1.0) == frame + 40 - 39
    assert onset_window(trial, PROTOCOLS["next"]) == frame // 5 - 4


def test_a_territory_keeps_people_in_and_stores_no_window():
    trials, protocol = made_trials(each=4, frames=120), PROTOCOLS["same"]
    territory = territory_of(trials, protocol, ("reach", "push"), seed=0)
    again = territory_of(trials, protocol, ("reach", "push"), seed=0)
    np.testing.assert_array_equal(territory.centres, again.centres)
    assert sorted(set(territory.owners)) == [0.0, 1.0]
    assert len(territory.centres) <= sum(trial.frames for trial in trials) / 4 / 10
    for trial in trials:
        assert settled_scores(territory, trial, protocol).max() < 1.0


def test_recorded_interactions_left_out_are_detected_better_than_by_a_nearest_neighbour(mild_data):
    recording = DATASETS["buetepage_hr"]
    trials = recording.read(mild_data / recording.file).train
    chosen = [trial for fold in folds_of(trials)[:2] for trial in fold.held_out]
    found = leave_one_out(chosen, recording.protocols["next"], recording.interactions)
    for name, scores in found.items():
        assert scores["ours"].area > scores["nearest_neighbour"].area, name
    assert found["hand_wave"]["ours"].share > 0.8


def test_a_cluster_belongs_to_one_interaction():
    trials, protocol = made_trials(each=3), PROTOCOLS["same"]
    territory = clustered(trials, protocol, ("reach", "push"), seed=1)
    novelty = territory.init()
    assert novelty.shape == (2,)
    assert territory.reach == 1.0


def test_the_reach_is_more_than_people_left_out_need_and_strangeness_fades_by_the_second():
    trials, protocol, names = made_trials(each=4, frames=200), PROTOCOLS["same"], ("reach", "push")
    found = territory_of(trials, protocol, names, seed=0)
    left_out = np.concatenate(
        [
            settled_scores(clustered(fold.learned, protocol, names, 0), trial, protocol)
            for fold in folds_of(trials)
            for trial in fold.held_out
        ]
    )
    assert found.reach == pytest.approx(1.1 * np.quantile(left_out, 0.995))
    assert found.kept**40.0 == pytest.approx(0.6)  # a second of 40 frames
    mean = np.mean([one.observed_m.reshape(one.frames, -1).mean(axis=0) for one in trials], axis=0)
    assert np.linalg.norm(np.tile(mean, 40) @ found.weight + found.bias) < np.linalg.norm(found.bias)

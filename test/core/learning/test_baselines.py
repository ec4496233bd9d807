# SPDX-License-Identifier: Apache-2.0
"""Plain methods: each solves the case it is made for, and none looks at the answer or at the future."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.learning.baselines import BASELINES
from mild_core.learning.baselines.kernels import SearchGrid, fit_chosen, linear
from mild_core.learning.data.folds import folds_of
from mild_core.learning.data.windows import PROTOCOLS, cut
from mild_core.learning.evaluation.errors import errors_of_trial, summarise
from test.core.learning.made_trials import made_trials

TRIALS = made_trials(each=4)
PLAIN = ("action_mean", "time_indexed_mean", "ridge", "kernel_ridge", "nearest_neighbours")
RECURRENT = ("gru", "mixture_density", "mixture_density_given", "buetepage")


@pytest.fixture(autouse=True)
def short_training(monkeypatch):
    monkeypatch.setattr("mild_core.learning.baselines.recurrent.EPOCHS", 6)


def macro(name, protocol="next", trials=TRIALS, seed=0):
    fold = folds_of(trials)[0]
    predictor = BASELINES[name].fit(fold.learned, PROTOCOLS[protocol], seed)
    errors = [errors_of_trial(t, PROTOCOLS[protocol], predictor.predict(t)) for t in fold.held_out]
    return summarise(errors, ("reach", "push")).macro_mse


def test_action_mean_is_the_mean_over_all_frames_of_the_interaction():
    predictor = BASELINES["action_mean"].fit(TRIALS, PROTOCOLS["same"], 0)
    wanted = np.concatenate([t.controlled for t in TRIALS if t.interaction == "push"]).mean(axis=0)
    np.testing.assert_allclose(predictor.predict(TRIALS[-1])[7, 3], wanted, rtol=1e-12)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_time_indexed_mean_plays_the_mean_motion_at_the_time_of_the_answer(protocol):
    same_every_time = [replace(TRIALS[0], trial=index) for index in range(3)]
    predictor = BASELINES["time_indexed_mean"].fit(same_every_time, PROTOCOLS[protocol], 0)
    np.testing.assert_allclose(predictor.predict(TRIALS[0]), cut(TRIALS[0], PROTOCOLS[protocol]).controlled, atol=1e-12)


def test_ridge_in_the_dual_is_ridge_in_the_primal():
    machine = fit_chosen(TRIALS[:4], PROTOCOLS["next"], linear, SearchGrid((1.0,), (10.0,)))
    windows = [cut(t, PROTOCOLS["next"]) for t in TRIALS[:4]]
    features = np.concatenate([w.observed.reshape(len(w.observed), -1)[::3] for w in windows])
    answers = np.concatenate([w.controlled.reshape(len(w.controlled), -1)[::3] for w in windows])
    scaled = (features - features.mean(axis=0)) / features.std()
    offset = answers.mean(axis=0)
    weights = np.linalg.solve(scaled.T @ scaled + 10.0 * np.eye(scaled.shape[1]), scaled.T @ (answers - offset))
    # The two are one in exact arithmetic; the values are of size one.
    np.testing.assert_allclose(machine.answers(features), scaled @ weights + offset, atol=1e-9)


def test_looking_at_the_human_beats_not_looking():
    blind = macro("action_mean")
    assert macro("kernel_ridge") < 0.2 * blind
    assert macro("ridge") < 0.5 * blind
    assert macro("nearest_neighbours") < 0.2 * blind


@pytest.mark.parametrize("name", RECURRENT)
def test_a_recurrent_network_learns_to_look_at_the_human(name, monkeypatch):
    monkeypatch.setattr("mild_core.learning.baselines.recurrent.EPOCHS", 80)
    uses_label = BASELINES[name].uses_label
    # Without the label, "reach" and "push" look alike in the person: both predictions are then halfway.
    assert macro(name) < (0.6 if uses_label else 1.0) * macro("action_mean")


@pytest.mark.parametrize("name", [*PLAIN, *RECURRENT])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_prediction_has_the_shape_of_the_answer_and_never_looks_at_it(name, protocol):
    predictor = BASELINES[name].fit(TRIALS, PROTOCOLS[protocol], 0)
    trial = TRIALS[5]
    predicted = predictor.predict(trial)
    assert predicted.shape == cut(trial, PROTOCOLS[protocol]).controlled.shape
    blinded = replace(trial, controlled=np.zeros_like(trial.controlled), active=np.zeros_like(trial.active))
    np.testing.assert_array_equal(predictor.predict(blinded), predicted)
    other = replace(trial, interaction="reach" if trial.interaction == "push" else "push")
    assert np.array_equal(predictor.predict(other), predicted) == (not BASELINES[name].uses_label)


@pytest.mark.parametrize("name", [name for name, baseline in BASELINES.items() if name != "mild_paper"])
def test_a_partners_arm_is_predicted_as_well(name):
    people = [replace(t, controlled=t.observed_m, controlled_names=t.observed_names) for t in TRIALS]
    predicted = BASELINES[name].fit(people, PROTOCOLS["next"], 0).predict(people[0])
    assert predicted.shape == cut(people[0], PROTOCOLS["next"]).controlled.shape
    assert predicted.shape[2:] == (3, 3)


@pytest.mark.parametrize("name", [*PLAIN, *RECURRENT])
def test_a_prediction_never_looks_at_the_humans_future(name):
    protocol = PROTOCOLS["same"]
    predictor = BASELINES[name].fit(TRIALS, protocol, 0)
    trial, other = TRIALS[5], TRIALS[6]
    seen = 60
    changed = trial.observed_m.copy()
    changed[seen:] = other.observed_m[seen : len(changed)]
    windows = seen - protocol.window + 1
    before, after = predictor.predict(trial), predictor.predict(replace(trial, observed_m=changed))
    # Blocked matrix products may round rows differently when later rows change; nothing else may.
    np.testing.assert_allclose(after[:windows], before[:windows], atol=1e-5)


def test_the_same_seed_learns_the_same_network_and_leaves_the_callers_randomness_alone():
    import torch

    torch.manual_seed(7)
    first = BASELINES["gru"].fit(TRIALS, PROTOCOLS["next"], 3).predict(TRIALS[0])
    drawn = torch.rand(1)
    second = BASELINES["gru"].fit(TRIALS, PROTOCOLS["next"], 3).predict(TRIALS[0])
    other = BASELINES["gru"].fit(TRIALS, PROTOCOLS["next"], 4).predict(TRIALS[0])
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)
    torch.manual_seed(7)
    assert torch.equal(drawn, torch.rand(1))

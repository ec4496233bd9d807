# SPDX-License-Identifier: Apache-2.0
"""Plain methods: each solves the case it is made for, and none looks at the answer or at the future."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mild_core.learning.baselines import BASELINES
from mild_core.learning.baselines.buetepage import pairs_elsewhere, people_at_hand
from mild_core.learning.baselines.kernels import SearchGrid, fit_chosen, linear
from mild_core.learning.baselines.recurrent import input_layout_of
from mild_core.learning.baselines.shared_embedding import learn_people, people_of
from mild_core.learning.data.folds import folds_of
from mild_core.learning.data.recording import Demonstrations
from mild_core.learning.data.windows import PROTOCOLS, cut
from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from mild_core.learning.datasets.nuisi import NUISI
from mild_core.learning.evaluation.errors import errors_of_trial, summarise
from test.core.learning.made_trials import made_trials

TRIALS = made_trials(each=4)
PLAIN = ("action_mean", "time_indexed_mean", "ridge", "kernel_ridge", "nearest_neighbours")
RECURRENT = ("gru", "mixture_density", "mixture_density_given", "buetepage")


@pytest.fixture(autouse=True)
def short_training(monkeypatch):
    monkeypatch.setattr("mild_core.learning.baselines.recurrent.EPOCHS", 6)
    monkeypatch.setattr("mild_core.learning.baselines.shared_embedding.STEPS", 6)


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
    monkeypatch.setattr("mild_core.learning.baselines.shared_embedding.STEPS", 80)
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
    torch.manual_seed(7)
    first = BASELINES["gru"].fit(TRIALS, PROTOCOLS["next"], 3).predict(TRIALS[0])
    drawn = torch.rand(1)
    second = BASELINES["gru"].fit(TRIALS, PROTOCOLS["next"], 3).predict(TRIALS[0])
    other = BASELINES["gru"].fit(TRIALS, PROTOCOLS["next"], 4).predict(TRIALS[0])
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)
    torch.manual_seed(7)
    assert torch.equal(drawn, torch.rand(1))


def in_pairs(trials, **changes):
    """The same motions by two people who do alike."""
    return tuple(replace(t, controlled=t.observed_m, controlled_names=t.observed_names, **changes) for t in trials)


def recording_of_pairs(path, trials):
    """A recording of two people whose file is there."""
    path.write_bytes(b"")
    return replace(NUISI, file=str(path), read=lambda _: Demonstrations(tuple(trials), ()))


def test_pairs_of_other_people_come_at_the_rate_and_under_the_names_of_the_trials(tmp_path):
    trials = tuple(replace(t, interaction={"reach": "waving"}.get(t.interaction, t.interaction)) for t in TRIALS)
    others = in_pairs(made_trials(each=2, interactions=("wave", "shake"), frames=60), rate_hz=20.0)
    elsewhere = recording_of_pairs(tmp_path / "others.npz", others)
    missing = replace(elsewhere, file=str(tmp_path / "missing.npz"))
    found = pairs_elsewhere(trials, [elsewhere, missing, BUETEPAGE_HR])
    assert [pair.interaction for pair in found] == ["waving"] * 2
    assert {pair.rate_hz for pair in found} == {40.0}
    np.testing.assert_allclose(found[0].observed_m[::2], others[0].observed_m, atol=1e-12)
    np.testing.assert_allclose(found[0].controlled[1], others[0].controlled[:2].mean(axis=0), atol=1e-12)


def test_the_recording_that_the_trials_are_of_lends_no_pairs(tmp_path):
    pairs = in_pairs(TRIALS)
    own = recording_of_pairs(tmp_path / "own.npz", pairs)
    assert pairs_elsewhere(pairs[1:], [own]) == ()
    robots = tuple(replace(t, controlled_names=("a", "b", "c")) for t in TRIALS[1:])
    assert pairs_elsewhere(robots, [own]) == ()  # the second person turned into a robot: the same held-out people


def test_people_learn_with_their_partners_and_alone():
    alone, together = (input_layout_of(trials, PROTOCOLS["next"], True) for trials in (TRIALS, in_pairs(TRIALS)))
    assert people_at_hand(TRIALS, alone).partner.tolist() == list(range(len(TRIALS)))
    people = people_at_hand(in_pairs(TRIALS), together)
    assert people.partner.tolist() == [place ^ 1 for place in range(2 * len(TRIALS))]
    drawn = people.drawn()
    partners = drawn.frames[drawn.partner]
    assert torch.equal(partners, drawn.frames)  # they do alike here


def test_windows_of_people_end_with_their_frame():
    people = people_of([torch.arange(20.0)[:, None], torch.arange(8.0)[:, None]], [0, 1], 1, 4, 3)
    windows, recorded = people.windows(2)
    assert windows[0, 1].tolist() == [2.0, 3.0, 4.0, 5.0]
    assert recorded[0].tolist() == [False, True, True, True, True, True]
    assert recorded[1].tolist() == [False, True, False, False, False, False]


def test_training_draws_latents_and_a_prediction_takes_their_means(monkeypatch):
    monkeypatch.setattr("mild_core.learning.baselines.recurrent.NOISE", 0.0)
    learned = BASELINES["buetepage"].fit(TRIALS, PROTOCOLS["next"], 0)
    frames = learned.view.frames(TRIALS[0])[None]
    answers = [learned.network.answer(frames) for _ in range(2)]
    assert torch.equal(*answers)
    losses = [learned.network.loss(frames, answers[0].detach()).mean().item() for _ in range(2)]
    assert losses[0] != losses[1]
    frozen = [
        p.requires_grad for part in (learned.network.person, learned.network.controlled) for p in part.parameters()
    ]
    assert not any(frozen)


def test_two_people_who_do_the_same_thing_are_drawn_together(monkeypatch):
    """Without the second term of its loss nothing would tell the dynamics that these two do the same."""
    monkeypatch.setattr("mild_core.learning.baselines.shared_embedding.STEPS", 100)
    apart = torch.stack([torch.zeros(30, 2), torch.ones(30, 2)])
    distances = []
    for partner in ([0, 1], [1, 0]):
        torch.manual_seed(0)
        dynamics = learn_people(people_of(list(apart), partner, 2, 4, 1))
        doing = dynamics.posterior(apart)
        distances.append((doing.mean[0] - doing.mean[1]).square().mean().item())
    assert distances[1] < 0.5 * distances[0]

# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1: repeatable, without traces, with a prior that is fixed within an epoch and follows the latents."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from mild_core.errors import SetupError
from mild_core.learning.data.windows import PROTOCOLS, cut
from mild_core.learning.training import algorithm as training
from mild_core.learning.training.algorithm import train
from mild_core.learning.training.learned_model import finished
from mild_core.learning.training.presets import PRESETS
from mild_core.learning.training.settings import LossWeights
from test.core.learning.made_trials import made_trial, made_trials
from test.core.learning.small_settings import PLAIN, SMALL, SMALL_PAPER, TWO

TRIALS = made_trials(each=3, frames=130)


def reports_and_model(settings, seed=0, protocol="same"):
    epochs = train(TRIALS, PROTOCOLS[protocol], settings, seed)
    reports = []
    while True:
        try:
            reports.append(next(epochs))
        except StopIteration as end:
            return reports, end.value


@pytest.mark.parametrize("settings", [SMALL, SMALL_PAPER], ids=["ours", "paper"])
def test_equal_seeds_give_equal_models_and_others_do_not(settings):
    first, again, other = (finished(train(TRIALS, PROTOCOLS["same"], settings, seed)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.predict(TRIALS[0]), again.predict(TRIALS[0]))
    assert abs(first.predict(TRIALS[0]) - other.predict(TRIALS[0])).max() > 1e-3


def test_training_neither_reads_nor_moves_the_callers_random_numbers():
    torch.manual_seed(1)
    np.random.seed(1)  # noqa: NPY002  # the global generator is what must be left alone
    expected = (torch.rand(3), np.random.rand())  # noqa: NPY002
    torch.manual_seed(1)
    np.random.seed(1)  # noqa: NPY002
    one = finished(train(TRIALS, PROTOCOLS["same"], replace(SMALL, epochs=2), 0))
    assert torch.equal(torch.rand(3), expected[0])
    assert np.random.rand() == expected[1]  # noqa: NPY002
    torch.manual_seed(99)
    two = finished(train(TRIALS, PROTOCOLS["same"], replace(SMALL, epochs=2), 0))
    np.testing.assert_array_equal(one.predict(TRIALS[0]), two.predict(TRIALS[0]))


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_every_protocol_is_learned_and_errors_fall(protocol):
    stride = 1 if protocol == "next" else 8
    settings = replace(SMALL, epochs=25, stride=stride, gradient_stride=stride, dropout=0.0, batch_trials=1)
    reports, model = reports_and_model(settings, protocol=protocol)
    assert [report.epoch for report in reports] == list(range(25))
    # Shares of the windows' variance: 1 is what their mean would leave. 25 short epochs must clearly beat it.
    assert reports[-1].prediction < 0.5 < reports[0].prediction
    assert reports[-1].observed < reports[0].observed
    assert reports[-1].controlled < reports[0].controlled
    trial = TRIALS[4]
    true = cut(trial, PROTOCOLS[protocol]).controlled
    answer = model.predict(trial)
    assert answer.shape == true.shape
    spread = np.concatenate([cut(t, PROTOCOLS[protocol]).controlled.reshape(-1, 3) for t in TRIALS]).var(axis=0).mean()
    assert ((answer - true) ** 2).mean() < 0.5 * spread


def test_the_paper_learns_the_human_first_and_lends_its_hidden_layers_to_the_robot():
    reports, _ = reports_and_model(SMALL_PAPER)
    assert [report.controlled == 0.0 for report in reports] == [True, True, False, False, False, False]
    # A prediction is never part of the paper's objective.
    assert all(report.prediction == 0.0 for report in reports)
    networks = reports_and_model(replace(SMALL_PAPER, epochs=1, observed_share=0.0))[1].members[0].networks
    networks.start_controlled_from_observed()
    human, robot = networks.encoder.stack, networks.counterpart_encoder.stack
    assert torch.equal(human[1].weight, robot[1].weight)
    assert human[0].weight.shape != robot[0].weight.shape
    assert not torch.equal(human[2].weight, robot[2].weight)
    assert torch.equal(networks.counterpart_decoder.stack[1].weight, networks.decoder.stack[1].weight)


@pytest.mark.parametrize("epochs", [1, 2, 6])
def test_the_papers_robot_learns_however_few_epochs_there_are(epochs):
    reports, _ = reports_and_model(replace(SMALL_PAPER, epochs=epochs))
    assert [report.controlled > 0.0 for report in reports] == [epoch >= round(epochs / 3) for epoch in range(epochs)]
    for preset in PRESETS.values():
        assert all(replace(preset, epochs=few).observed_epochs < few for few in (1, 2, 10, 30, 40, 60))


def test_the_prior_moves_between_epochs_until_it_is_frozen(monkeypatch):
    seen = []
    original = training._pass

    def watched(learner, objective, corpus, observed_only):
        seen.append(learner.prior)
        return original(learner, objective, corpus, observed_only)

    monkeypatch.setattr(training, "_pass", watched)
    reports, model = reports_and_model(replace(SMALL, epochs=10))
    assert seen[0] is None, "the first epoch has N(0, I)"
    changed = [before is not after for before, after in pairwise(seen)]
    refitted = [not math.isnan(report.log_likelihood) for report in reports]
    assert refitted[:-1] == changed
    # Every second epoch, and the last one before half-way; then never again.
    assert refitted == [True, False, True, False, True, False, False, False, False, False]
    assert model.members[0].prior is seen[-1]


def test_members_differ_and_the_model_answers_with_their_mean():
    reports, model = reports_and_model(replace(SMALL, members=3, epochs=4))
    assert [report.member for report in reports] == [0] * 4 + [1] * 4 + [2] * 4
    alone = [replace(model, members=(member,)).predict(TRIALS[1]) for member in model.members]
    assert abs(alone[0] - alone[1]).max() > 1e-3
    np.testing.assert_allclose(model.predict(TRIALS[1]), np.mean(alone, axis=0), atol=1e-12)


def test_an_answer_never_depends_on_what_comes_later_or_on_what_the_robot_did():
    model = finished(train(TRIALS, PROTOCOLS["same"], replace(SMALL, epochs=3), 0))
    trial = TRIALS[0]
    changed = trial.observed_m.copy()
    changed[100:] += 0.3
    other = replace(trial, observed_m=changed, controlled=trial.controlled + 1.0)
    # Window n ends at frame n + 39.
    np.testing.assert_array_equal(model.predict(trial)[:61], model.predict(other)[:61])
    assert abs(model.predict(trial)[61:] - model.predict(other)[61:]).max() > 1e-3


def test_a_gradient_through_memory_or_belief_needs_equal_strides():
    with pytest.raises(ValueError, match="equal strides"):
        replace(SMALL, gradient_stride=4)
    with pytest.raises(ValueError, match="equal strides"):
        replace(SMALL, architecture=PLAIN, gradient_stride=4)
    quiet = LossWeights(prediction=0.0)
    assert replace(SMALL, architecture=PLAIN, weights=quiet, gradient_stride=4).gradient_stride == 4


def test_an_architecture_is_one_of_those_that_the_run_time_has():
    with pytest.raises(ValueError, match="encoder takes in"):
        replace(PLAIN, encoder=("context",))
    with pytest.raises(ValueError, match="where there is one"):
        replace(PLAIN, encoder=("context", "window"))
    with pytest.raises(ValueError, match="where there is one"):
        replace(PLAIN, residual=("context", "window", "label"))


def test_nothing_to_learn_from_is_refused():
    with pytest.raises(ValueError, match="no demonstration"):
        next(train((), PROTOCOLS["same"], SMALL, 0))
    with pytest.raises(ValueError, match="is not"):
        next(train([made_trial(0)], PROTOCOLS["same"], SMALL, 0, interactions=TWO[1:]))


def test_trials_of_fewer_windows_than_the_gradients_stride_are_learned_too():
    trials = [made_trial(0, "reach", 130), *(made_trial(seed, "push", 84) for seed in range(1, 4))]
    settings = replace(SMALL_PAPER, gradient_stride=200, batch_trials=1)
    reports = list(train(trials, PROTOCOLS["same"], settings, 0))
    assert all(np.isfinite([report.observed, report.divergence]).all() for report in reports)
    assert any(report.observed > 0.0 for report in reports)


def test_hidden_layers_are_carried_over_where_sizes_agree_and_nothing_else_is():
    import torch

    from mild_core.learning.training.transfer import transfer_layers
    from mild_core.learning.training.vae import MemberNetworks

    architecture = SMALL.architecture

    def made(seed, questions):
        torch.manual_seed(seed)
        return MemberNetworks(architecture, questions, 4, 2, 0.0)

    donor, heir, before = made(0, 6), made(1, 7), made(1, 7)
    chains = {name: getattr(donor, name) for name in ("context", "encoder", "residual", "decoder")}
    arrays = {f"{name}.{key}": a for name, chain in chains.items() if chain for key, a in chain.arrays().items()}
    taken = transfer_layers(heir, arrays)
    assert taken
    given, kept, found = (dict(networks.state_dict()) for networks in (donor, before, heir))
    changed = {name for name, value in found.items() if not torch.equal(value, kept[name])}
    assert changed
    for name in changed:
        assert torch.equal(found[name], given[name])
    # Inputs of another size (the window) and last layers stay as they were drawn.
    assert all(found[name].shape == given[name].shape for name in changed)
    places = {name.rsplit(".", 1)[0] for name in changed}
    for chain in ("context", "encoder", "residual", "decoder"):
        layers = getattr(heir, chain)
        if layers is not None and layers.specs[-1].kind == "dense":
            assert f"{chain}.stack.{len(layers.specs) - 1}" not in places
    assert transfer_layers(heir, {}) == ()
    with pytest.raises(SetupError, match="no hidden layer of it has the name and size"):
        next(train(TRIALS, PROTOCOLS["same"], SMALL, 0, start={"encoder.elsewhere.weight": np.zeros((3, 3))}))

# SPDX-License-Identifier: Apache-2.0
"""What is minimised: every term has its weight and its sign, and the divergence is that from the right Gaussian."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from mild_core.inference.gaussian import Gaussian
from mild_core.inference.priors import HSMM
from mild_core.learning.data.windows import PROTOCOLS
from mild_core.learning.training.algorithm import window_coordinates
from mild_core.learning.training.corpus import corpus_of, cut_tracks
from mild_core.learning.training.latent_prior import latent_prior
from mild_core.learning.training.objective import Objective, Terms
from mild_core.learning.training.settings import LossWeights
from mild_core.learning.training.vae import MemberNetworks, Posterior
from test.core.inference.oracles import kl_divergence
from test.core.learning.made_trials import made_trials
from test.core.learning.small_settings import SMALL, TWO

SAME = PROTOCOLS["same"]
TRIALS = made_trials(each=2, frames=130)


@pytest.mark.parametrize("name", [field.name for field in fields(Terms)])
def test_the_total_rises_with_each_term_by_its_weight(name):
    """Eq. 3 is a bound that is maximised: its negative is minimised, in which errors and divergence both count up."""
    weights = LossWeights(prediction=2.0, observed=3.0, controlled=5.0, divergence=7.0)
    terms = Terms(**{field.name: torch.tensor(0.5, requires_grad=True) for field in fields(Terms)})
    terms.total(weights).backward()
    assert float(getattr(terms, name).grad) == getattr(weights, name)


@pytest.fixture(name="parts", scope="module")
def _parts():
    """An objective, networks and a batch that does not begin with a trial's first window."""
    corpus = corpus_of(TRIALS, SAME, TWO)
    objective = Objective(SMALL, *window_coordinates(corpus, SMALL), len(TWO))
    torch.manual_seed(0)
    sizes = (objective.question.size, objective.answer.size, len(TWO))
    networks = MemberNetworks(SMALL.architecture, *sizes, SMALL.dropout)
    batch = objective.projected(cut_tracks(corpus, corpus.tracks, 24, SMALL.gradient_stride))
    return objective, networks.eval(), batch


def priors_of(latent, rng):
    """Of each interaction, one whose components lie far apart in both blocks."""
    made = {}
    for number, name in enumerate(TWO):
        walks = [np.cumsum(rng.normal(0.3, 1.0, (8, 2 * latent)), axis=0) + 5.0 * number for _ in range(2)]
        made[name] = HSMM.from_demonstrations(walks, 4, latent)
    return made


def posteriors(networks, objective, batch):
    known = objective.known(networks, batch)
    return networks.observe(known), networks.counterpart(batch.valid_of(batch.answer))


def as_gaussian(posterior: Posterior) -> Gaussian:
    return Gaussian(posterior.mean.double().numpy(), posterior.covariance.double().numpy())


@torch.no_grad()
def test_before_there_is_a_prior_the_divergence_is_that_from_the_unit_gaussian(parts):
    objective, networks, batch = parts
    both = [as_gaussian(one) for one in posteriors(networks, objective, batch)]
    size = both[0].mean.shape[-1]
    unit = Gaussian(np.zeros(size), np.eye(size))
    wanted = sum(kl_divergence(one, unit).mean() for one in both)
    found = objective.terms(networks, batch, None)
    assert float(found.divergence) == pytest.approx(wanted, rel=1e-4)
    assert float(found.prediction) > 0.0


@torch.no_grad()
def test_with_a_prior_each_window_is_compared_with_the_component_of_its_own_step_in_its_agent_s_block(parts):
    objective, networks, batch = parts
    human, robot = posteriors(networks, objective, batch)
    size = human.mean.shape[-1]
    priors = priors_of(size, np.random.default_rng(4))
    widening = (0.1 * torch.eye(size, dtype=torch.float64), 0.2 * torch.eye(size, dtype=torch.float64))
    prior = latent_prior(priors, widening, 200)
    wanted = 0.0
    for agent, (posterior, wider) in enumerate(zip((human, robot), widening, strict=True)):
        block = slice(0, size) if agent == 0 else slice(size, None)
        found, trials = as_gaussian(posterior), batch.places[0].tolist()
        distances = []
        for row, (trial, number) in enumerate(zip(trials, batch.places[1].tolist(), strict=True)):
            of = list(priors.values())[int(batch.label[trial])]
            frame = batch.first + number * SMALL.gradient_stride
            component = of.component_path(200)[frame // SMALL.stride]
            mean, covariance = of.components.mean[component], of.components.covariance[component]
            expected = Gaussian(mean[block], covariance[block, block] + wider.numpy())
            distances.append(float(kl_divergence(Gaussian(found.mean[row], found.covariance[row]), expected)))
        wanted += np.mean(distances)
    assert float(objective.terms(networks, batch, prior).divergence) == pytest.approx(wanted, rel=1e-3)
    alone = objective.terms(networks, batch, prior, observed_only=True)
    assert 0.0 < float(alone.divergence) < wanted
    assert float(alone.controlled) == float(alone.prediction) == 0.0


@torch.no_grad()
def test_an_error_is_the_mean_over_windows_of_the_weighed_squares(parts):
    objective, _, batch = parts
    wanted = batch.valid_of(batch.answer)
    predicted = wanted + 0.3
    found = objective._reconstruction(predicted, wanted, objective.answer)
    assert float(found) == pytest.approx(float((0.09 * objective.answer.errors).sum()), rel=1e-5)
    twice = replace(objective, answer=replace(objective.answer, errors=2.0 * objective.answer.errors))
    assert float(twice._reconstruction(predicted, wanted, twice.answer)) == pytest.approx(2.0 * float(found))

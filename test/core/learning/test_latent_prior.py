# SPDX-License-Identifier: Apache-2.0
"""What training computes of posteriors and priors in torch is what the run time computes in numpy."""

import numpy as np
import torch

from mild_core.inference.gaussian import Gaussian
from mild_core.inference.priors.hsmm import HSMM
from mild_core.learning.training.latent_prior import latent_prior
from mild_core.learning.training.vae import Posterior, drop, posterior_of
from test.core.inference.oracles import filtered, kl_divergence

RNG = np.random.default_rng(3)
Q, STEPS = 3, 30


def made_prior(shift):
    """A prior of random walks in which both agents move together."""
    walks = [np.cumsum(RNG.normal(size=(STEPS, 2 * Q)), axis=0) + shift for _ in range(4)]
    return HSMM.from_demonstrations(walks, 3, Q).fit(walks).prior


PRIORS = {"a": made_prior(0.0), "b": made_prior(4.0)}
WIDENING = (0.05 * torch.eye(Q), 0.1 * torch.eye(Q))
LATENT = latent_prior(PRIORS, WIDENING, STEPS)


def made_posterior(steps):
    return posterior_of(torch.tensor(RNG.normal(size=(steps, Q + Q * (Q + 1) // 2)), dtype=torch.float32), Q)


def test_the_factor_is_lower_triangular_row_by_row_with_a_positive_diagonal():
    outputs = torch.tensor([[1.0, 2.0, -0.5, 7.0, 0.25]])
    posterior = posterior_of(outputs, 2)
    assert posterior.mean.tolist() == [[1.0, 2.0]]
    # 2 |l| + 1e-4 on the diagonal; float32 keeps seven digits.
    np.testing.assert_allclose(posterior.factor[0], [[1.0001, 0.0], [7.0, 0.5001]], rtol=1e-6)
    factor = posterior.factor[0].numpy()
    np.testing.assert_allclose(posterior.covariance[0], factor @ factor.T, rtol=1e-6)


def test_samples_have_the_posteriors_moments():
    torch.manual_seed(0)
    posterior = Posterior(torch.tensor([[1.0, -2.0]]), torch.tensor([[[0.5, 0.0], [0.3, 0.2]]]))
    drawn = posterior.samples(40_000)[:, 0].numpy()
    # Four standard errors of a mean with deviation 0.5, and of a variance of 0.25, over 40 000 draws.
    np.testing.assert_allclose(drawn.mean(axis=0), [1.0, -2.0], atol=0.01)
    np.testing.assert_allclose(np.cov(drawn.T), posterior.covariance[0].numpy(), atol=0.008)


def test_conditioning_equals_the_run_time_filter():
    lengths = [STEPS, 12, 1]
    posterior, label = made_posterior(sum(lengths)), torch.tensor([1, 0, 1])
    belief, conditioned = LATENT.explain(posterior, label, lengths)
    ends = np.cumsum(lengths)
    for first, stop, prior in zip(ends - lengths, ends, (PRIORS["b"], PRIORS["a"], PRIORS["b"]), strict=True):
        row = slice(first, stop)
        mean, covariance = posterior.mean[row].double().numpy(), posterior.covariance[row].double().numpy()
        weights, expected = filtered(prior, mean, covariance)
        # Single precision here.
        np.testing.assert_allclose(belief[row], weights, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(conditioned[row], expected, rtol=1e-4, atol=1e-4)


def test_gradients_of_the_conditional_are_the_mixed_gains():
    posterior, label = made_posterior(STEPS), torch.tensor([0])
    mean = posterior.mean.clone().requires_grad_()
    belief, conditioned = LATENT.explain(Posterior(mean, posterior.factor), label, [STEPS])
    (belief[5] * conditioned[5, :, 1]).sum().backward()
    prior = PRIORS["a"]
    weights = filtered(prior, posterior.mean.double().numpy(), posterior.covariance.double().numpy())[0][5]
    covariance, widening = prior.components.covariance, posterior.covariance[5].double().numpy()
    gains = [c[Q:, :Q] @ np.linalg.inv(c[:Q, :Q] + widening) for c in covariance]
    expected = sum(w * gain[1] for w, gain in zip(weights, gains, strict=True))
    np.testing.assert_allclose(mean.grad[5].numpy(), expected, rtol=1e-4, atol=1e-5)
    # Only the frame itself: belief is taken as it is.
    assert mean.grad[:5].abs().max() == mean.grad[6:].abs().max() == 0.0


def test_divergence_is_that_of_gaussians_from_the_widened_block():
    posterior, label = made_posterior(2 * STEPS), torch.tensor([0, 1]).repeat_interleave(STEPS)
    component = torch.tensor(RNG.integers(3, size=2 * STEPS))
    found = LATENT.controlled.divergence(posterior, label, component).numpy()
    for number, prior in enumerate(PRIORS.values()):
        row = slice(number * STEPS, (number + 1) * STEPS)
        chosen = component[row].numpy()
        target = Gaussian(
            prior.components.mean[chosen, Q:], prior.components.covariance[chosen, Q:, Q:] + WIDENING[1].numpy()
        )
        given = Gaussian(posterior.mean[row].double().numpy(), posterior.covariance[row].double().numpy())
        # Single precision against double.
        np.testing.assert_allclose(found[row], kl_divergence(given, target), rtol=2e-3, atol=2e-3)
    assert (found > 0.0).all()


def test_dropout_keeps_the_mean_and_the_wanted_share():
    torch.manual_seed(0)
    dropped = drop(torch.ones(50, 40, 20), 0.3)
    share = (dropped == 0).float().mean().item()
    # A byte decides: 77 of 256. Four standard errors over 40 000 values are 0.01.
    assert abs(share - 77 / 256) < 0.01
    assert abs(dropped.mean().item() - 1.0) < 0.015
    assert drop(dropped, 0.0) is dropped

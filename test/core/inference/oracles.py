# SPDX-License-Identifier: Apache-2.0
"""Textbook forms of what the compiled kernels do, to hold those to: Gaussians by numpy, and a filter frame by frame.

Every function of Gaussians takes batches in the leading axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mild_core.inference.gaussian import LOG_TWO_PI, Gaussian
from mild_core.inference.priors.filtering import UNDERFLOW
from mild_core.inference.priors.prior import Prior
from mild_core.inference.priors.semi_markov_chain import run_filter
from mild_core.shapes import read_only


def log_density(gaussian: Gaussian, values: np.ndarray) -> np.ndarray:
    """(...): log N(values; mean, covariance) of `values` (..., Z), broadcast against the batch."""
    factor = np.linalg.cholesky(gaussian.covariance)
    whitened = np.linalg.solve(factor, (values - gaussian.mean)[..., None])[..., 0]
    half_log_determinant = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(-1)
    return -0.5 * (gaussian.mean.shape[-1] * LOG_TWO_PI + (whitened**2).sum(-1)) - half_log_determinant


def condition(gaussian: Gaussian, observed: np.ndarray, observed_covariance: np.ndarray | float = 0.0) -> Gaussian:
    """The remaining dimensions given the first Q, `observed` (..., Q), whose own covariance widens their block.

    Source: eq. 8 of MILD with the sign corrected: (z - mean), where the paper prints (mean - z).
    """
    split = observed.shape[-1]
    cross_block = gaussian.covariance[..., split:, :split]
    observed_block = gaussian.covariance[..., :split, :split] + observed_covariance
    gain = np.swapaxes(np.linalg.solve(observed_block, np.swapaxes(cross_block, -1, -2)), -1, -2)
    difference = observed - gaussian.mean[..., :split]
    mean = gaussian.mean[..., split:] + (gain @ difference[..., None])[..., 0]
    covariance = gaussian.covariance[..., split:, split:] - gain @ np.swapaxes(cross_block, -1, -2)
    return Gaussian(mean, np.broadcast_to(covariance, (*mean.shape, mean.shape[-1])))


def kl_divergence(first: Gaussian, second: Gaussian) -> np.ndarray:
    """(...): KL(first || second) in nats: the regulariser of eq. 3 of MILD in closed form."""
    difference = second.mean - first.mean
    distance = (difference * np.linalg.solve(second.covariance, difference[..., None])[..., 0]).sum(-1)
    trace = np.trace(np.linalg.solve(second.covariance, first.covariance), axis1=-2, axis2=-1)
    log_determinants = np.linalg.slogdet(second.covariance)[1] - np.linalg.slogdet(first.covariance)[1]
    return 0.5 * (trace + distance - first.mean.shape[-1] + log_determinants)


def mixture_moments(weights: np.ndarray, components: Gaussian) -> Gaussian:
    """Mean and covariance of a mixture with `weights` (..., K) of components (..., K).

    Source: the law of total variance, V = sum h (V_j + m_j m_j^T) - m m^T, written without the cancellation.
    """
    mean = (weights[..., None] * components.mean).sum(-2)
    spread = components.mean - mean[..., None, :]
    within = components.covariance + spread[..., :, None] * spread[..., None, :]
    return Gaussian(mean, (weights[..., None, None] * within).sum(-3))


@dataclass(frozen=True, eq=False)
class Belief:
    """What is believed about a chain after the frames so far.

    Attributes:
        weights: (K,) over components, h of the paper. Before the first frame: the start probabilities.
        memory: (K, D) over components and remaining time; its rows sum to `weights`. Zero before the first frame.
        started: Whether a frame has been seen.
        log_likelihood: log p(newest frame | frames before), 0 before the first.
        known: False when all densities of the newest frame underflow. The belief then moved on by time alone.
    """

    weights: np.ndarray
    memory: np.ndarray
    started: bool
    log_likelihood: float
    known: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", read_only(self.weights))
        object.__setattr__(self, "memory", read_only(self.memory))


def initial_belief(prior: Prior) -> Belief:
    """The belief before the first frame."""
    return Belief(prior.chain.initial, np.zeros((prior.chain.components, prior.chain.longest)), False, 0.0, True)


def update(prior: Prior, belief: Belief, observed: np.ndarray, covariance: np.ndarray | None = None) -> Belief:
    """The belief after one more frame, `observed` (Q,) with the encoder's covariance (Q, Q); None: exact.

    Source: eq. 6 of MILD with explicit durations.
    """
    memory = belief.memory.copy() if belief.started else None
    after = run_filter(prior.chain, prior.explain(observed, covariance).log_emissions[None], memory)
    log_likelihood = float(after.log_likelihoods[0])
    return Belief(after.weights[0], after.memory, True, log_likelihood, log_likelihood > UNDERFLOW)


def mixed(prior: Prior, belief: Belief, observed: np.ndarray, covariance: np.ndarray | None = None) -> Gaussian:
    """The controlled latent: each component conditioned on the observed one, mixed by the belief.

    Source: eqs. 7 and 8 of MILD, corrected, with the moments of the mixture.
    """
    return mixture_moments(belief.weights, prior.explain(observed, covariance).conditioned)


def filtered(prior: Prior, observed: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A recording (T, Q) frame by frame: the belief (T, K), and what each component expects (T, K, C)."""
    belief, weights, means = initial_belief(prior), [], []
    for frame, covariance in zip(observed, covariances, strict=True):
        belief = update(prior, belief, frame, covariance)
        weights.append(belief.weights)
        means.append(prior.explain(frame, covariance).conditioned.mean)
    return np.array(weights), np.array(means)

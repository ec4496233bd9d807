# SPDX-License-Identifier: Apache-2.0
"""The contract that every prior keeps, the ladder between them, and learning that does not lose likelihood."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.inference.gaussian import Gaussian
from mild_core.inference.priors import GMM, HSMM, PRIORS
from mild_core.inference.priors.prior import FitSettings
from mild_core.inference.priors.semi_markov_chain import SemiMarkovChain
from test.core.inference.oracles import condition, initial_belief, log_density, mixed, mixture_moments, update

PLAIN = FitSettings(
    iterations=25, tolerance=0.0, covariance_fraction=0.0, duration_floor=0.0, duration_spread=0.0, pseudo_count=0.0
)
"""Nothing but maximum likelihood."""

SIZE, OBSERVED = 6, 3
EVERY_PRIOR = pytest.mark.parametrize("kind", sorted(PRIORS))
EXACT = 1e-10  # Two roads through a dozen operations on well-conditioned matrices.


def demonstrations(seed: int = 0, count: int = 6, frames: int = 90) -> list[np.ndarray]:
    """Smooth joint latents with jittered timing: three poses, each held and left, and both agents bound together."""
    rng = np.random.default_rng(99)
    poses = rng.normal(0.0, 2.0, (4, OBSERVED))
    mixing = rng.normal(0.0, 0.7, (OBSERVED, SIZE - OBSERVED))
    rng = np.random.default_rng(seed)
    result = []
    for _ in range(count):
        length = frames + int(rng.integers(-10, 11))
        knots = np.sort(rng.uniform(0.1, 0.9, 3)) * length
        blend = 1.0 / (1.0 + np.exp(-(np.arange(length)[:, None] - knots) / 3.0))
        observed = poses[0] + blend @ np.diff(poses, axis=0) + rng.normal(0.0, 0.15, (length, OBSERVED))
        controlled = observed @ mixing + rng.normal(0.0, 0.1, (length, SIZE - OBSERVED))
        result.append(np.concatenate([observed, controlled], axis=1))
    return result


def fitted(kind: str, settings: FitSettings | None = None, components: int = 4):
    latents = demonstrations()
    return PRIORS[kind].from_demonstrations(latents, components, OBSERVED).fit(latents, settings).prior


@EVERY_PRIOR
def test_belief_is_a_distribution_and_the_state_is_a_value(kind):
    prior = fitted(kind)
    belief = initial_belief(prior)
    observed = demonstrations(1)[0][:, :OBSERVED]
    for frame in observed:
        before = belief.weights.copy(), belief.memory.copy()
        after = update(prior, belief, frame, 0.01 * np.eye(OBSERVED))
        again = update(prior, belief, frame, 0.01 * np.eye(OBSERVED))
        np.testing.assert_array_equal(after.weights, again.weights)
        np.testing.assert_array_equal(belief.weights, before[0])
        np.testing.assert_array_equal(belief.memory, before[1])
        belief = after
        assert belief.known
        assert belief.weights.min() >= 0.0
        # Renormalised at every frame, so that nothing accumulates.
        assert belief.weights.sum() == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(belief.memory.sum(axis=1), belief.weights, atol=1e-12)
    with pytest.raises(ValueError, match="read-only"):
        belief.weights[0] = 0.5


@EVERY_PRIOR
def test_first_frame_weighs_the_start_by_the_widened_observed_block(kind):
    prior = fitted(kind)
    frame, noise = demonstrations(3)[0][0, :OBSERVED], 0.05 * np.eye(OBSERVED)
    block = prior.components.covariance[:, :OBSERVED, :OBSERVED] + noise
    joint = prior.chain.initial * np.exp(log_density(Gaussian(prior.components.mean[:, :OBSERVED], block), frame))
    belief = update(prior, initial_belief(prior), frame, noise)
    np.testing.assert_allclose(belief.weights, joint / joint.sum(), atol=EXACT)
    assert belief.log_likelihood == pytest.approx(np.log(joint.sum()), abs=EXACT)


@EVERY_PRIOR
def test_covariances_are_widened_by_a_share_of_each_dimension_s_own_variance(kind):
    """In other units the same demonstrations make the same prior, in these units."""
    latents, units = demonstrations(), np.array([1.0, 10.0, 0.1, 3.0, 1.0, 100.0])
    settings = FitSettings(iterations=3, tolerance=-np.inf)
    plain = PRIORS[kind].from_demonstrations(latents, 4, OBSERVED, settings).fit(latents, settings).prior
    scaled = [z * units for z in latents]
    other = PRIORS[kind].from_demonstrations(scaled, 4, OBSERVED, settings).fit(scaled, settings).prior
    np.testing.assert_allclose(other.components.mean, plain.components.mean * units, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(
        other.components.covariance, plain.components.covariance * np.outer(units, units), rtol=1e-5, atol=1e-9
    )
    narrow = PRIORS[kind].from_demonstrations(latents, 4, OBSERVED, FitSettings(covariance_fraction=0.0))
    wide = PRIORS[kind].from_demonstrations(latents, 4, OBSERVED, FitSettings(covariance_fraction=0.5))
    variance = np.concatenate(latents).var(axis=0)
    grown = wide.components.covariance - narrow.components.covariance
    np.testing.assert_allclose(grown, np.broadcast_to(0.5 * np.diag(variance), grown.shape), atol=1e-9)


@EVERY_PRIOR
def test_a_component_explains_a_frame_by_its_widened_observed_block(kind):
    prior = fitted(kind)
    frame, noise = demonstrations(5)[0][40, :OBSERVED], np.diag([0.05, 0.2, 0.4])
    found = prior.explain(frame, noise)
    block = prior.components.covariance[:, :OBSERVED, :OBSERVED] + noise
    apart = frame - prior.components.mean[:, :OBSERVED]
    mahalanobis = np.sqrt(np.einsum("ka,kab,kb->k", apart, np.linalg.inv(block), apart))
    np.testing.assert_allclose(found.distances, mahalanobis, atol=EXACT)
    densities = log_density(Gaussian(prior.components.mean[:, :OBSERVED], block), frame)
    np.testing.assert_allclose(found.log_emissions, densities, atol=EXACT)


@EVERY_PRIOR
def test_condition_mixes_the_conditioned_components(kind):
    prior = fitted(kind)
    frame, noise = demonstrations(4)[0][30, :OBSERVED], 0.05 * np.eye(OBSERVED)
    belief = update(prior, initial_belief(prior), frame, noise)
    expected = mixture_moments(belief.weights, condition(prior.components, frame, noise))
    found = mixed(prior, belief, frame, noise)
    np.testing.assert_allclose(found.mean, expected.mean, atol=EXACT)
    np.testing.assert_allclose(found.covariance, expected.covariance, atol=EXACT)


@EVERY_PRIOR
def test_likelihood_never_falls_over_plain_expectation_maximisation(kind):
    latents = demonstrations()
    prior = PRIORS[kind].from_demonstrations(latents, 4, OBSERVED)
    history = np.array(prior.fit(latents, PLAIN).log_likelihoods)
    assert len(history) > 5
    # Nats in some thousands, each a sum over 500 frames in double precision.
    assert np.diff(history).min() > -1e-7
    assert history[-1] > history[0] + 1.0


@EVERY_PRIOR
def test_fit_returns_a_new_prior_and_starts_from_the_old_one(kind):
    latents = demonstrations()
    first = PRIORS[kind].from_demonstrations(latents, 4, OBSERVED)
    arrays = {name: array.copy() for name, array in first.to_arrays().items()}
    second = first.fit(latents, FitSettings(iterations=500, tolerance=1e-6)).prior
    for name, array in first.to_arrays().items():
        np.testing.assert_array_equal(array, arrays[name])
    third = second.fit([z + 0.01 for z in latents]).prior
    # Warm start: a nudge of all latents nudges every component and swaps none.
    assert abs(third.components.mean - second.components.mean - 0.01).max() < 0.2


@EVERY_PRIOR
def test_arrays_make_the_same_prior_again(kind):
    prior = fitted(kind)
    again = PRIORS[kind].from_arrays(prior.to_arrays(), OBSERVED)
    for name, array in prior.to_arrays().items():
        np.testing.assert_array_equal(array, again.to_arrays()[name])


@EVERY_PRIOR
def test_phases_rise_with_the_order_of_the_components(kind):
    prior = fitted(kind)
    assert prior.phases.min() > 0.0
    assert prior.phases.max() < 1.0
    if kind != "gmm":
        assert (np.diff(prior.phases) > 0.0).all()
        path = prior.component_path(90)
        assert path[0] == 0
        assert path[60:] != path[:30]
    if kind == "hsmm":  # Geometric durations blur an HMM's marginals so far that a short component never leads.
        assert list(dict.fromkeys(path)) == [0, 1, 2, 3]


@EVERY_PRIOR
def test_a_frame_far_from_everything_is_unknown_and_does_not_reset_the_belief(kind):
    prior = fitted(kind)
    belief = initial_belief(prior)
    for frame in demonstrations(1)[0][:60, :OBSERVED]:
        belief = update(prior, belief, frame)
    after = update(prior, belief, np.full(OBSERVED, 1e4))
    assert not after.known
    assert after.log_likelihood < -700.0
    if kind != "gmm":  # A mixture remembers nothing to begin with.
        assert after.weights.argmax() == belief.weights.argmax()
        assert abs(after.weights - initial_belief(prior).weights).max() > 0.3
    assert update(prior, after, demonstrations(1)[0][60, :OBSERVED]).known


@EVERY_PRIOR
def test_one_component_is_linear_regression(kind):
    latents = demonstrations()
    prior = PRIORS[kind].from_demonstrations(latents, 1, OBSERVED).fit(latents, PLAIN).prior
    everything = np.concatenate(latents)
    inputs = np.concatenate([everything[:, :OBSERVED], np.ones((len(everything), 1))], axis=1)
    solution = np.linalg.lstsq(inputs, everything[:, OBSERVED:], rcond=None)[0]
    belief = initial_belief(prior)
    for row in everything[:150:10]:
        belief = update(prior, belief, row[:OBSERVED])
        expected = np.append(row[:OBSERVED], 1.0) @ solution
        # Least squares and the conditional of sample moments agree up to the conditioning of the inputs.
        np.testing.assert_allclose(mixed(prior, belief, row[:OBSERVED]).mean, expected, atol=1e-8)


@EVERY_PRIOR
def test_belief_lives_on_after_the_longest_demonstration(kind):
    prior = fitted(kind)
    frame, belief = demonstrations(1)[0][-1, :OBSERVED], initial_belief(prior)
    for _ in range(1000):
        belief = update(prior, belief, frame)
    assert belief.known
    assert np.isfinite(belief.weights).all()


def test_durations_of_segments_are_found_and_never_run_across_demonstrations():
    """Three components of known lengths: the fitted durations are theirs, though every demonstration is cut short."""
    rng = np.random.default_rng(8)
    means, lengths = 4.0 * np.eye(3), np.array([10, 18, 40])
    latents = []
    for _ in range(12):
        path = np.concatenate([np.full(n + rng.integers(-2, 3), j) for j, n in enumerate(lengths)])[:55]
        latents.append(means[path] + rng.normal(0.0, 0.3, (len(path), 3)))
    prior = HSMM.from_demonstrations(latents, 3, 2).fit(latents).prior
    average = prior.chain.durations @ np.arange(1, prior.chain.longest + 1)
    # One per cent of the mass is spread evenly over 1..D by the floor, and the sample of twelve is off by 0.4.
    np.testing.assert_allclose(average[:2], lengths[:2], atol=1.0)
    # The third is always cut by the end: all that is known is that it lasts at least as long as was seen.
    assert average[2] > 55 - 28 - 2
    assert prior.chain.transitions[0, 1] > 0.9
    assert prior.chain.transitions[2, 0] > 0.5


def test_chains_of_another_kind_are_refused():
    gaussians = Gaussian(np.zeros((2, 2)), np.tile(np.eye(2), (2, 1, 1)))
    half, one = np.full((2, 2), 0.5), np.ones((2, 1))
    with pytest.raises(ValueError, match="zero diagonal"):
        HSMM(gaussians, SemiMarkovChain(half[0], half, half), np.zeros(2), 1)
    with pytest.raises(ValueError, match="one frame"):
        PRIORS["hmm"](gaussians, SemiMarkovChain(half[0], half, half), np.zeros(2), 1)
    with pytest.raises(ValueError, match="every row"):
        GMM(gaussians, SemiMarkovChain(half[0], np.eye(2), one), np.zeros(2), 1)
    with pytest.raises(ValueError, match="observed_size"):
        GMM(gaussians, SemiMarkovChain(half[0], half, one), np.zeros(2), 3)
    with pytest.raises(ValueError, match="cut into"):
        GMM.from_demonstrations([np.zeros((3, 2))], 4, 1)

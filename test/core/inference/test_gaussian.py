# SPDX-License-Identifier: Apache-2.0
"""Gaussians against sampling-free oracles: direct formulas, block identities, regression."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.inference.gaussian import Gaussian
from test.core.inference.oracles import condition, kl_divergence, log_density, mixture_moments

EXACT = 1e-10  # A dozen operations on well-conditioned 5 x 5 matrices.


def random_gaussian(seed: int, size: int = 5, batch: tuple[int, ...] = ()) -> Gaussian:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(*batch, size, size))
    return Gaussian(rng.normal(size=(*batch, size)), root @ np.swapaxes(root, -1, -2) + 0.5 * np.eye(size))


def test_log_density_of_a_batch_is_the_formula_for_each():
    gaussian = random_gaussian(0, batch=(3,))
    values = np.random.default_rng(1).normal(size=(4, 3, 5))
    found = log_density(gaussian, values)
    for i in range(4):
        for j in range(3):
            d = values[i, j] - gaussian.mean[j]
            determinant = np.linalg.det(2.0 * np.pi * gaussian.covariance[j])
            expected = -0.5 * d @ np.linalg.inv(gaussian.covariance[j]) @ d - 0.5 * np.log(determinant)
            assert found[i, j] == pytest.approx(expected, abs=EXACT)


def test_joint_density_is_marginal_times_conditional():
    gaussian, noise = random_gaussian(2), random_gaussian(3, size=2).covariance
    rng = np.random.default_rng(4)
    first, second = rng.normal(size=2), rng.normal(size=3)
    padded = np.zeros((5, 5))
    padded[:2, :2] = noise
    joint = Gaussian(gaussian.mean, gaussian.covariance + padded)
    marginal = Gaussian(joint.mean[:2], joint.covariance[:2, :2])
    product = log_density(marginal, first) + log_density(condition(gaussian, first, noise), second)
    assert log_density(joint, np.concatenate([first, second])) == pytest.approx(product, abs=EXACT)


def test_printed_equation_8_is_no_conditional():
    """With (mean - z) the product of marginal and conditional is not the joint density."""
    gaussian = random_gaussian(5)
    rng = np.random.default_rng(6)
    first, second = rng.normal(size=2), rng.normal(size=3)
    marginal = Gaussian(gaussian.mean[:2], gaussian.covariance[:2, :2])
    right = condition(gaussian, first)
    printed = Gaussian(2.0 * gaussian.mean[2:] - right.mean, right.covariance)
    joint = log_density(gaussian, np.concatenate([first, second])) - log_density(marginal, first)
    assert joint == pytest.approx(log_density(right, second), abs=EXACT)
    assert abs(joint - log_density(printed, second)) > 0.1


def test_divergence_is_the_expected_log_ratio():
    first, second = random_gaussian(7, size=2), random_gaussian(8, size=2)
    nodes, weights = np.polynomial.hermite_e.hermegauss(8)
    grid = np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
    masses = np.outer(weights, weights).ravel() / weights.sum() ** 2
    values = first.mean + grid @ np.linalg.cholesky(first.covariance).T
    expected = masses @ (log_density(first, values) - log_density(second, values))
    # The log ratio is quadratic, so the quadrature is exact.
    assert kl_divergence(first, second) == pytest.approx(expected, abs=EXACT)
    assert kl_divergence(first, first) == pytest.approx(0.0, abs=EXACT)


def test_mixture_moments_are_those_of_the_mixture():
    components = random_gaussian(9, size=3, batch=(4,))
    weights = np.random.default_rng(10).dirichlet(np.ones(4))
    found = mixture_moments(weights, components)
    mean = weights @ components.mean
    second = sum(
        w * (c + np.outer(m, m)) for w, m, c in zip(weights, components.mean, components.covariance, strict=True)
    )
    np.testing.assert_allclose(found.mean, mean, atol=EXACT)
    np.testing.assert_allclose(found.covariance, second - np.outer(mean, mean), atol=EXACT)


def test_shapes_that_do_not_belong_together_are_refused():
    with pytest.raises(ValueError, match="do not belong together"):
        Gaussian(np.zeros(3), np.eye(2))
    with pytest.raises(ValueError, match="read-only"):
        random_gaussian(0).mean[0] = 1.0

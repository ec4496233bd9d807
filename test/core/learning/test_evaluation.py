# SPDX-License-Identifier: Apache-2.0
"""Errors are the averages that they say they are, over windows, interactions and trials."""

import math

import numpy as np
import pytest

from mild_core.learning.data.windows import PROTOCOLS, cut
from mild_core.learning.evaluation.errors import TrialErrors, errors_of_trial, summarise
from test.core.learning.made_trials import made_trial

SAME = PROTOCOLS["same"]


def trial_errors(trial, interaction, squared):
    squared = np.asarray(squared, dtype=float)
    return TrialErrors(trial, interaction, squared, np.sqrt(squared), squared.mean() * np.eye(2))


def test_the_error_of_a_window_is_averaged_over_joints_and_frames():
    trial = made_trial(0)
    true = cut(trial, SAME).controlled
    errors = errors_of_trial(trial, SAME, true + np.array([0.1, -0.2, 0.0]))
    np.testing.assert_allclose(errors.squared, (0.01 + 0.04) / 3, rtol=1e-9)
    np.testing.assert_allclose(errors.absolute, 0.3 / 3, rtol=1e-9)
    np.testing.assert_allclose(errors.covariance, np.outer([0.1, -0.2, 0], [0.1, -0.2, 0]), atol=1e-12)
    assert len(errors.squared) == 90 - 40 + 1


def test_two_people_are_scored_by_the_squared_distance_of_their_joints():
    trial = made_trial(0)
    person = trial.observed_m
    trial = type(trial)(1, "reach", 40.0, trial.observed_names, person, trial.observed_names, person, trial.active)
    errors = errors_of_trial(trial, SAME, cut(trial, SAME).controlled + np.array([0.03, 0.04, 0.0]))
    np.testing.assert_allclose(errors.squared, 0.05**2, rtol=1e-9)
    np.testing.assert_allclose(errors.absolute, 0.05, rtol=1e-9)


@pytest.mark.parametrize("spoil", [lambda p: p[:-1], lambda p: p[:, :, :2], lambda p: p * np.nan])
def test_a_prediction_of_another_shape_or_not_finite_is_never_scored(spoil):
    trial = made_trial(0)
    with pytest.raises(ValueError, match=r"shape|not finite"):
        errors_of_trial(trial, SAME, spoil(cut(trial, SAME).controlled))


def test_macro_is_over_interactions_and_pooled_is_over_windows():
    errors = summarise(
        [trial_errors(0, "a", [1.0, 3.0]), trial_errors(1, "a", [2.0]), trial_errors(2, "b", [8.0])], ("a", "b", "c")
    )
    assert errors.interactions["a"].mse == pytest.approx(2.0)
    assert errors.interactions["a"].mse_std == pytest.approx(math.sqrt(2 / 3))
    assert (errors.interactions["a"].windows, errors.interactions["a"].trials) == (3, 2)
    assert errors.interactions["b"].mse_std == 0.0
    assert errors.interactions["c"].mse is None
    assert errors.macro_mse == pytest.approx(5.0)
    assert errors.pooled_rmse == pytest.approx(math.sqrt(14 / 4))
    assert errors.pooled_rmse == pytest.approx(math.sqrt(14 / 4))
    assert errors.mean_absolute == pytest.approx(sum(math.sqrt(v) for v in (1, 3, 2, 8)) / 4)
    assert (errors.windows, errors.trials) == (4, 3)
    np.testing.assert_allclose(errors.covariance, 14 / 4 * np.eye(2))


def test_no_trials_are_no_errors_rather_than_zero():
    errors = summarise([], ("a",))
    assert errors.macro_mse is errors.macro_interval is errors.pooled_rmse is errors.mean_absolute is None
    assert errors.interactions["a"].windows == errors.windows == errors.trials == 0


def test_the_interval_draws_trials_not_windows():
    rng = np.random.default_rng(0)
    levels = rng.normal(1.0, 0.2, size=20)
    # All windows of a trial are alike: with many of them an interval over windows would be too narrow by far.
    trials = [trial_errors(index, "a", np.full(500, level)) for index, level in enumerate(levels)]
    low, high = summarise(trials, ("a",)).macro_interval
    wanted = 1.96 * levels.std() / math.sqrt(20)
    assert low < levels.mean() < high
    # The half width of the normal approximation; 15 % covers the bootstrap's own noise with 2000 draws.
    assert (high - low) / 2 == pytest.approx(wanted, rel=0.15)
    assert summarise(trials, ("a",)).macro_interval == (low, high)


def test_an_interval_is_that_of_the_macro_error_over_all_interactions():
    trials = [trial_errors(index, "ab"[index % 2], np.full(9, 1.0 + index % 2)) for index in range(8)]
    errors = summarise(trials, ("a", "b"))
    assert errors.macro_interval == pytest.approx((errors.macro_mse, errors.macro_mse)) == (1.5, 1.5)

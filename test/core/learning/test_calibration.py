# SPDX-License-Identifier: Apache-2.0
"""Regions hold what they should: of errors drawn from a covariance that was published too wide or too narrow."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from mild_core.learning.uncertainty_calibration import AIM, LEVELS, REGION, CalibrationSample, calibrate

NINETY = LEVELS.index(REGION)


def drawn(fold, interaction, factor, rng, windows=120):
    """Errors of N(0, factor V) where V is what is spread, four frames to a window."""
    root = np.array([[1.0, 0.0, 0.0], [0.5, 0.7, 0.0], [-0.3, 0.2, 0.4]])
    errors = np.sqrt(factor) * rng.normal(size=(windows, 4, 3)) @ root.T
    return CalibrationSample(fold, interaction, errors, np.broadcast_to(root @ root.T, (windows, 3, 3)))


@pytest.fixture(scope="module")
def calibration():
    rng = np.random.default_rng(0)
    return calibrate(
        [drawn(trial % 4, name, factor, rng) for name, factor in (("wide", 0.2), ("narrow", 8.0)) for trial in range(8)]
    )


@pytest.mark.parametrize("interaction", ["wide", "narrow"])
def test_after_scaling_every_region_holds_its_share_in_trials_left_out(calibration, interaction):
    found = calibration.after[interaction]
    for kind in (found.joint, found.marginal):
        # The 90 % region is set to hold AIM; 480 frames in each of 8 trials leave half a per cent of chance.
        assert kind[NINETY] == pytest.approx(AIM, abs=0.025)
        assert (np.diff(kind) > 0).all()
        np.testing.assert_allclose(kind[:-2], np.array(LEVELS)[:-2], atol=0.08)


def test_without_a_scale_the_same_regions_hold_too_much(calibration):
    # What is spread and what is left over both enter: errors a fifth as large as the first are far inside.
    assert calibration.before["wide"].joint[NINETY] > 0.99
    assert calibration.scale["wide"] < 0.5 < calibration.scale["narrow"]


def test_the_published_scale_makes_the_region_hold_its_aim_of_all_trials():
    rng = np.random.default_rng(1)
    doubts = [drawn(trial % 4, "wave", 3.0, rng) for trial in range(8)]
    errors = np.concatenate([doubt.errors.reshape(-1, 3) for doubt in doubts])
    covariance = doubts[0].spread[0] + errors.T @ errors / len(errors)
    squares = np.einsum("na,ab,nb->n", errors, np.linalg.inv(covariance), errors)
    scale = calibrate(doubts).scale["wave"]
    assert np.mean(squares / scale <= chi2.ppf(REGION, 3)) == pytest.approx(AIM, abs=2 / len(squares))


def test_a_fold_is_judged_by_what_was_learned_from_the_others_alone():
    """One fold of four errs ten times as much: to the others it is no help, and they are none to it."""
    rng = np.random.default_rng(2)
    doubts = [drawn(trial % 4, "wave", 1.0, rng) for trial in range(8)]
    doubts = [replace(one, errors=10.0 * one.errors) if one.fold == 1 else one for one in doubts]
    found = calibrate(doubts)
    # What its two trials hold lies far outside of the others' regions, and theirs far inside of what it widens.
    assert found.after["wave"].joint[NINETY] == pytest.approx(0.75, abs=0.02)
    assert found.before["wave"].joint[NINETY] == pytest.approx(0.75, abs=0.04)

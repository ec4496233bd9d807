# SPDX-License-Identifier: Apache-2.0
"""Regions hold what they should: of errors drawn from a covariance that was published too wide or too narrow."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from mild_core.learning.evaluation.uncertainty_calibration import (
    AIMS,
    HALF,
    LEVELS,
    REGION,
    CalibrationSample,
    calibrate,
)

NINETY, FIFTY = LEVELS.index(REGION), LEVELS.index(HALF)


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
        # 480 frames in each of 8 trials leave half a per cent of chance.
        assert kind[NINETY] == pytest.approx(REGION, abs=0.025)
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
    assert np.mean(squares / scale <= chi2.ppf(REGION, 3)) == pytest.approx(AIMS[1], abs=2 / len(squares))


def heavy(fold, rng, freedom=3.0, windows=120):
    """Errors of a Student t about what is spread: most are small and some are large."""
    one = drawn(fold, "wave", 1.0, rng, windows)
    return replace(one, errors=one.errors / np.sqrt(rng.chisquare(freedom, size=(windows, 4, 1)) / freedom))


def test_both_regions_hold_their_shares_of_errors_that_are_no_gaussian() -> None:
    """One number for the size of a covariance cannot hold both: half of the errors lie far nearer."""
    rng = np.random.default_rng(4)
    found = calibrate([heavy(trial % 4, rng) for trial in range(8)])
    for kind in (found.after["wave"].joint, found.after["wave"].marginal):
        np.testing.assert_allclose(kind, LEVELS, atol=0.03)
    assert found.before["wave"].joint[FIFTY] > 0.6
    assert found.freedom["wave"] == pytest.approx(3.0, abs=0.7)


def test_errors_of_a_gaussian_have_many_degrees_of_freedom(calibration) -> None:
    assert min(calibration.freedom.values()) > 5.0


def test_trials_count_alike_however_long_they_are() -> None:
    """Three short trials that err ten times as much say where 90 % lie, not the long one."""
    rng = np.random.default_rng(5)
    doubts = [drawn(trial % 4, "wave", 100.0, rng, 60) for trial in range(1, 4)] + [drawn(0, "wave", 1.0, rng, 3000)]
    errors = np.concatenate([doubt.errors.reshape(-1, 3) for doubt in doubts])
    covariance = doubts[0].spread[0] + errors.T @ errors / len(errors)
    held = [np.einsum("nwa,ab,nwb->nw", d.errors, np.linalg.inv(covariance), d.errors).ravel() for d in doubts]
    bound = calibrate(doubts).scale["wave"] * chi2.ppf(REGION, 3)
    assert np.mean([np.mean(one <= bound) for one in held]) == pytest.approx(AIMS[1], abs=0.01)


def test_a_fold_is_judged_by_what_was_learned_from_the_others_alone():
    """One fold of four errs ten times as much: to the others it is no help, and they are none to it."""
    rng = np.random.default_rng(2)
    doubts = [drawn(trial % 4, "wave", 1.0, rng) for trial in range(8)]
    doubts = [replace(one, errors=10.0 * one.errors) if one.fold == 1 else one for one in doubts]
    found = calibrate(doubts)
    # What its two trials hold lies far outside of the others' regions, and theirs far inside of what it widens.
    assert found.after["wave"].joint[NINETY] == pytest.approx(0.75, abs=0.02)
    assert found.before["wave"].joint[NINETY] == pytest.approx(0.75, abs=0.04)

# SPDX-License-Identifier: Apache-2.0
"""A motion that is known in advance is followed closely, and never at the price of a limit."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Retargeting, RetargetingSettings
from mild_core.shapes import FloatArray
from test.core.retargeting.limits import check_limits
from test.core.retargeting.perfect import Followed, follow, interpolated

NO_LOOK_AHEAD = RetargetingSettings(look_ahead_s=0.0)


def swing(time_s: float, amplitude_rad: float, rate_rad_s: float) -> FloatArray:
    """Every joint swings about home, each a little later than the one before, growing from rest over two seconds."""
    share = min(time_s / 2.0, 1.0)
    envelope = share**3 * (10 - 15 * share + 6 * share**2)
    swung: FloatArray = YUMI.home_rad + amplitude_rad * envelope * np.sin(rate_rad_s * time_s + 0.3 * np.arange(7))
    return swung


@pytest.fixture(scope="module")
def trials(mild_data: Path) -> tuple[Demonstration, ...]:
    return BUETEPAGE_HR.read(mild_data / BUETEPAGE_HR.file).train


@pytest.fixture(scope="module")
def followed(trials: tuple[Demonstration, ...]) -> list[Followed]:
    """Every second trial, looking ahead."""
    return [_followed(trial, RetargetingSettings()) for trial in trials[::2]]


def _followed(trial: Demonstration, settings: RetargetingSettings) -> Followed:
    motion = interpolated(trial.controlled, trial.rate_hz)
    return follow(Retargeting(YUMI, settings), motion, (len(trial.controlled) - 1) / trial.rate_hz)


def test_a_motion_inside_the_limits_is_followed_to_half_a_degree() -> None:
    # Half a radian at 2.5 rad/s: up to 72 degrees/s, a brisk wave; half a degree is 5 mm at the hand.
    motion = partial(swing, amplitude_rad=0.5, rate_rad_s=2.5)
    followed = follow(Retargeting(YUMI), motion, 8.0)
    assert followed.error_deg() < 0.5
    assert followed.error_deg() < 0.4 * follow(Retargeting(YUMI, NO_LOOK_AHEAD), motion, 8.0).error_deg()
    check_limits(YUMI, followed.commands)


@pytest.mark.parametrize("rate_hz", [1000, 250, 100, 37, 5])
@pytest.mark.parametrize("rate_rad_s", [4.0, 12.0, 40.0])
def test_a_motion_that_breaks_limits_is_followed_inside_them(rate_rad_s: float, rate_hz: int) -> None:
    # 1.2 rad at 4, 12 and 40 rad/s: 275, 825 and 2750 degrees/s, and beyond the position limits on the way.
    motion = partial(swing, amplitude_rad=1.2, rate_rad_s=rate_rad_s)
    followed = follow(Retargeting(YUMI), motion, 3.0, tick_ns=1_000_000_000 // rate_hz)
    check_limits(YUMI, followed.commands)
    assert followed.commands[-1].mode == "following"
    assert np.ptp(followed.positions_rad, axis=0).min() > 0.2  # it does move


@pytest.mark.slow
def test_recorded_motions_are_followed_inside_limits_that_they_break(
    trials: tuple[Demonstration, ...], followed: list[Followed]
) -> None:
    speeds = np.concatenate([np.abs(np.diff(trial.controlled, axis=0)) * trial.rate_hz for trial in trials])
    # The recording itself: about 1.2 % of its steps are faster than the first four axes can turn.
    assert 0.01 < np.mean(np.any(speeds > np.pi, axis=1)) < 0.015
    for one in followed:
        check_limits(YUMI, one.commands)
    # Measured: 0.289 degrees over all trials, with the largest single error where the recording is too fast. A tenth
    # of slack.
    assert np.sqrt(np.mean(np.square([one.error_deg() for one in followed]))) < 0.32


@pytest.mark.slow
def test_looking_ahead_makes_up_for_most_of_the_lag(
    trials: tuple[Demonstration, ...], followed: list[Followed]
) -> None:
    without = [_followed(trial, NO_LOOK_AHEAD).error_deg() for trial in trials[::8]]
    # Over all trials 0.289 against 0.870 degrees.
    assert np.mean([one.error_deg() for one in followed[::4]]) < 0.5 * np.mean(without)


def test_the_way_onto_a_distant_motion_is_slow() -> None:
    start = replace(YUMI, home_rad=YUMI.home_rad + np.array([0.4, 0.4, 0.4, 0.4, 0.4, 0.4, 0.4]))
    settings = RetargetingSettings(ramp_velocity_rad_s=0.5)
    motion = interpolated(np.array([YUMI.home_rad, YUMI.home_rad + 1.0]), 1000.0)  # a jump of a radian
    followed = follow(Retargeting(start, settings), motion, 5.0)
    # The commands begin where the robot is, and the jump is ramped: the peak that was asked for, and a tenth for lag.
    np.testing.assert_array_equal(followed.positions_rad[0], motion(0.0))
    assert np.abs(followed.velocities_rad_s).max() < 0.55
    np.testing.assert_allclose(followed.positions_rad[-1], followed.wanted_rad[-1], atol=1e-6)
    check_limits(YUMI, followed.commands)

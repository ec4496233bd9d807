# SPDX-License-Identifier: Apache-2.0
"""The grid of the model's rate and the estimate of the tracker's."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.perception.arm import with_bone_lengths
from mild_core.perception.resampling import SNAP, FrameRateEstimator, Grid, resample

PERIOD_NS = 25_000_000


def ramp(stamp_ns: int) -> np.ndarray:
    """A point that moves at 1 m/s."""
    return np.full((1, 3), stamp_ns * 1e-9)


@pytest.mark.parametrize(
    ("stamp_ms", "filled_ms"),
    [
        (20.8, []),  # early by more than a fifth of the tracker's period: it waits
        (20.9, [20.9]),  # by less: it is taken for the grid point, with its own stamp
        (25.0, [25.0]),
        (29.0, [25.0]),
        (45.1, [25.0, 45.1]),
        (101.0, [25.0, 50.0, 75.0, 100.0]),
    ],
)
def test_grid_points_up_to_a_frame_are_filled(stamp_ms: float, filled_ms: list[float]) -> None:
    stamp_ns = round(stamp_ms * 1e6)
    grid, stamps, points = resample(Grid(0, 1, 0, ramp(0)), stamp_ns, ramp(stamp_ns), 40.0)
    assert stamps == [round(ms * 1e6) for ms in filled_ms]
    # A float64 of nanoseconds times 1e-9 has 1e-16 of rounding.
    np.testing.assert_allclose(points[:, 0, 0], np.array(filled_ms) * 1e-3, atol=1e-15)
    assert grid.next_index == len(filled_ms) + 1
    assert grid.sample_ns == stamp_ns


def test_each_grid_point_comes_once_whatever_the_stamps() -> None:
    generator = np.random.default_rng(1)
    stamps = np.cumsum(generator.integers(1, 40_000_000, 5000))
    grid, made = Grid(0, 1, 0, ramp(0)), []
    for stamp_ns in stamps.tolist():
        grid, filled, points = resample(grid, stamp_ns, ramp(stamp_ns), 40.0)
        made += filled
        np.testing.assert_allclose(points[:, 0, 0], np.array(filled) * 1e-9, atol=1e-12)
    late_ns = np.arange(1, len(made) + 1) * PERIOD_NS - np.array(made)
    assert late_ns.min() >= -1
    assert late_ns.max() <= SNAP * PERIOD_NS + 1
    assert grid.next_index == len(made) + 1


def test_a_rate_without_whole_nanoseconds_does_not_drift() -> None:
    hour_ns = 3600 * 1_000_000_000
    _, stamps, _ = resample(Grid(0, 1, 0, ramp(0)), hour_ns, ramp(hour_ns), 30.0)
    assert len(stamps) == 30 * 3600
    assert stamps[-1] == hour_ns
    assert stamps[29] == 1_000_000_000


@pytest.mark.parametrize("rate_hz", [5.0, 15.0, 40.0, 250.0])
def test_losses_are_counted_from_the_stamps_despite_jitter(rate_hz: float) -> None:
    generator = np.random.default_rng(2)
    index = np.flatnonzero(generator.random(1000) > 0.1)
    stamps = np.round((index + generator.uniform(-0.1, 0.1, len(index))) * 1e9 / rate_hz).astype(int).tolist()
    cadence, missed = FrameRateEstimator(stamps[0]), 0
    for stamp_ns in stamps[1:]:
        cadence, lost = cadence.after(stamp_ns)
        missed += lost
    assert missed == pytest.approx(index[-1] - index[0] + 1 - len(index), rel=0.02)
    assert cadence.interval_ns == pytest.approx(1e9 / rate_hz, rel=0.1)


def test_messages_that_came_without_the_person_are_not_missed() -> None:
    cadence, _ = FrameRateEstimator(0).after(PERIOD_NS)
    cadence, missed = FrameRateEstimator(cadence.stamp_ns, cadence.interval_ns, absent=2).after(4 * PERIOD_NS)
    assert missed == 0
    assert cadence.absent == 0


def test_a_tracker_that_slows_down_is_followed() -> None:
    cadence, stamp_ns = FrameRateEstimator(0, float(PERIOD_NS)), 0
    for _ in range(30):
        stamp_ns += 3 * PERIOD_NS
        cadence, missed = cadence.after(stamp_ns)
    assert missed == 0
    assert cadence.interval_ns == pytest.approx(3 * PERIOD_NS, rel=0.01)


@pytest.mark.parametrize(
    ("interval_ms", "estimated_ms", "missed"),
    [
        (50.0, 90.0, 0),  # at most a tenth shorter at once
        (96.0, 96.0, 0),
        (104.0, 104.0, 0),
        (140.0, 105.0, 0),  # at most a twentieth longer at once: losses lengthen intervals
        (160.0, 105.0, 1),
        (300.0, 105.0, 2),
        (3.0, 90.0, 0),  # two messages in a burst are not less than none missed
        (1.0, 0.0, 0),  # of a flood: the tracker's rate has to be estimated again
    ],
)
def test_one_interval_changes_the_estimate_a_little(interval_ms: float, estimated_ms: float, missed: int) -> None:
    cadence, lost = FrameRateEstimator(0, 100e6).after(round(interval_ms * 1e6))
    assert (cadence.interval_ns / 1e6, lost) == (pytest.approx(estimated_ms), missed)


@pytest.mark.parametrize(("interval_ms", "gap"), [(101.0, False), (149.0, False), (151.0, True), (200.0, True)])
def test_a_span_in_which_a_frame_should_have_been_is_a_gap(interval_ms: float, gap: bool) -> None:
    assert FrameRateEstimator(0, 100e6).is_gap(round(interval_ms * 1e6)) == gap
    assert not FrameRateEstimator(0).is_gap(round(interval_ms * 1e6))  # after two frames the rate is unknown


def test_grid_points_lie_on_the_nearest_nanosecond() -> None:
    _, stamps, _ = resample(Grid(5, 1, 5, ramp(5)), 200_000_005, ramp(200_000_005), 30.0)
    assert stamps == [5 + round(index * 1e9 / 30.0) for index in range(1, 7)]
    assert stamps[1] == 66_666_672


def test_bones_get_their_lengths_and_keep_their_directions() -> None:
    arms = np.random.default_rng(4).normal(size=(50, 4, 3))
    lengths = (0.18, 0.2, 0.05)
    scaled = with_bone_lengths(arms, lengths)
    bones, before = np.diff(scaled, axis=1), np.diff(arms, axis=1)
    np.testing.assert_allclose(np.linalg.norm(bones, axis=-1), np.tile(lengths, (50, 1)), atol=1e-12)
    np.testing.assert_allclose(np.cross(bones, before), 0.0, atol=1e-12)
    assert (np.einsum("tjk,tjk->tj", bones, before) > 0.0).all()
    np.testing.assert_array_equal(scaled[:, 0], arms[:, 0])
    np.testing.assert_allclose(with_bone_lengths(scaled, lengths), scaled, atol=1e-12)


def test_a_bone_without_a_direction_stays_finite() -> None:
    assert np.isfinite(with_bone_lengths(np.zeros((1, 3, 3)), (0.18, 0.234))).all()


def test_of_a_flood_nothing_is_missed_and_after_it_the_trackers_own_rate_counts() -> None:
    """Messages of a flood come in bursts; what lies between them is no information."""
    bursts = [number * 7_000_000 + within * 300_000 for number in range(200) for within in range(4)]
    after = [bursts[-1] + 33_000_000 * number for number in range(1, 60)]
    cadence, missed = FrameRateEstimator(bursts[0]), 0
    for stamp_ns in bursts[1:] + after:
        cadence, more = cadence.after(stamp_ns)
        missed += more
    assert missed == 0
    assert cadence.interval_ns == pytest.approx(33_000_000)

# SPDX-License-Identifier: Apache-2.0
"""The neutral second by itself: axes of a trunk that leans, means over all of it, and who has stood still."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.errors import DataError
from mild_core.perception.neutral import NeutralFrame, calibrate, torso_axes, unsteadiness, with_newest

LEFT, RIGHT, PELVIS = np.array([0.0, 0.2, 0.5]), np.array([0.0, -0.2, 0.5]), np.zeros(3)
MS = 1_000_000


def turned(yaw_rad: float, pitch_rad: float, roll_rad: float) -> np.ndarray:
    """(3, 3) rotation whose columns are forward, left and up of a person who turns, then leans."""
    (cy, cp, cr), (sy, sp, sr) = np.cos([yaw_rad, pitch_rad, roll_rad]), np.sin([yaw_rad, pitch_rad, roll_rad])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return about_z @ about_y @ about_x


def frame(stamp_ms: float, shoulder_m: np.ndarray, trunk_m: np.ndarray | None = None, lengths=(0.3, 0.25)):
    return NeutralFrame(round(stamp_ms * MS), shoulder_m, trunk_m, np.zeros(3), lengths)


@pytest.mark.parametrize("angles", [(0, 0, 0), (2.0, 0, 0), (0.4, 0.3, 0), (-1.0, -0.2, 0.25)])
def test_the_axes_turn_with_the_trunk(angles: tuple[float, float, float]) -> None:
    body = turned(*angles)
    axes = torso_axes(body @ LEFT, body @ RIGHT, body @ PELVIS)
    np.testing.assert_allclose(axes, body.T, atol=1e-12)


def test_a_shoulder_that_is_raised_gives_a_rotation_whose_up_is_the_trunk() -> None:
    left = LEFT + np.array([0.05, 0.0, 0.12])
    axes = torso_axes(left, RIGHT, PELVIS)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    up = (left + RIGHT) / 2.0 - PELVIS
    np.testing.assert_allclose(axes[2], up / np.linalg.norm(up), atol=1e-12)
    assert axes[1] @ (left - RIGHT) > 0.9 * np.linalg.norm(left - RIGHT)


@pytest.mark.parametrize("flat", [(LEFT, LEFT + 0.01, PELVIS), (LEFT, RIGHT, np.array([0.0, 0.0, 0.45]))])
def test_shoulders_without_width_or_height_span_no_axes(flat: tuple[np.ndarray, ...]) -> None:
    with pytest.raises(DataError, match="flat_torso"):
        torso_axes(*flat)


def test_shoulder_axes_and_bones_are_means_over_all_frames() -> None:
    rng = np.random.default_rng(2)
    trunk = np.stack([LEFT, RIGHT, PELVIS]) + np.array([1.0, 0.0, 0.0])
    frames = tuple(
        frame(10 * index, RIGHT + 0.02 * rng.normal(size=3), trunk + 0.02 * rng.normal(size=(3, 3)), lengths)
        for index, lengths in enumerate(rng.uniform(0.2, 0.3, (30, 2)).tolist())
    )
    found = calibrate(frames, "camera", "right", True, "unknown")
    np.testing.assert_allclose(found.shoulder_m, np.mean([one.shoulder_m for one in frames], axis=0), atol=1e-12)
    np.testing.assert_allclose(found.bone_lengths_m, np.mean([one.bone_lengths_m for one in frames], axis=0))
    means = np.mean([one.trunk_m for one in frames], axis=0)
    np.testing.assert_allclose(found.arm_from_source, torso_axes(*means), atol=1e-12)
    assert (found.stamp_ns, found.frame_id, found.side) == (frames[-1].stamp_ns, "camera", "right")


def test_axes_that_are_given_stay_as_they_are() -> None:
    found = calibrate((frame(0, RIGHT), frame(10, RIGHT)), "camera", "left", False, "unknown")
    np.testing.assert_array_equal(found.arm_from_source, np.eye(3))


@pytest.mark.parametrize("which", ["shoulder", "left shoulder", "pelvis"])
def test_a_person_who_moves_anything_once_has_not_stood_still(which: str) -> None:
    still, trunk = [RIGHT.copy() for _ in range(10)], [np.stack([LEFT, RIGHT, PELVIS]) for _ in range(10)]
    moved = np.array([0.0, 0.06, 0.08])  # 10 cm in one frame of ten: 9 cm from the mean
    if which == "shoulder":
        still[4] = still[4] + moved
    else:
        trunk[4][0 if which == "left shoulder" else 2] += moved
    frames = tuple(frame(10 * index, *both) for index, both in enumerate(zip(still, trunk, strict=True)))
    assert unsteadiness(frames)[0] == pytest.approx(0.09)
    assert unsteadiness(frames[:4]) == pytest.approx((0.0, 0.0))


@pytest.mark.parametrize("rate_hz", [5.0, 15.0, 30.0, 60.0])
def test_jitter_is_no_motion_and_a_motion_no_jitter(rate_hz: float) -> None:
    rng, times_s = np.random.default_rng(1), np.arange(0.0, 1.01, 1.0 / rate_hz)
    trunk = np.stack([LEFT, RIGHT, PELVIS])

    def of(places: np.ndarray, jitter_m: float) -> tuple[float, float]:
        noisy = [place + jitter_m * rng.normal(size=(3, 3)) for place in places]
        return unsteadiness(tuple(frame(1e3 * t, one[1], one) for t, one in zip(times_s, noisy, strict=True)))

    standing = [of([trunk] * len(times_s), 0.025) for _ in range(20)]
    assert np.median(standing, axis=0)[0] < 0.04
    assert np.median(standing, axis=0)[1] == pytest.approx(0.025, rel=0.3)
    walking = trunk + times_s[:, None, None] * np.array([0.3, 0.0, 0.0])  # 15 cm to either side of the mean
    assert min(of(walking, 0.01)[0] for _ in range(20)) > 0.1
    swinging = trunk + 0.2 * np.sin(4.0 * times_s)[:, None, None] * np.array([0.0, 1.0, 0.0])
    assert min(of(swinging, 0.01)[0] for _ in range(20)) > 0.05


def test_the_neutral_second_keeps_just_enough_frames_and_restarts_after_a_gap() -> None:
    frames: tuple[NeutralFrame, ...] = ()
    for stamp_ms in range(0, 1500, 100):
        frames = with_newest(frames, frame(stamp_ms, RIGHT), 1.0, 0.5)
        spans = [(frames[-1].stamp_ns - one.stamp_ns) / MS for one in frames]
        assert spans[0] == min(stamp_ms, 1000)
        assert spans == sorted(spans, reverse=True)
    assert len(with_newest(frames, frame(1400 + 500, RIGHT), 1.0, 0.5)) > 1
    assert len(with_newest(frames, frame(1400 + 501, RIGHT), 1.0, 0.5)) == 1

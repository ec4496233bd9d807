# SPDX-License-Identifier: Apache-2.0
"""The kinematic human: plausible to look at, and a recording goes through it and perception unchanged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mild_core.perception.skeletons import SOURCES
from mild_core.perception.stage import Perception, PerceptionSettings
from mild_core.shapes import FloatArray
from mild_core.signals import FeatureWindow
from mild_ros.messages.marker_array import people_to_marker_array
from mild_ros.messages.skeletons import people_from_msg
from mild_ros.simulation.person import (
    ADULT,
    BODY_JOINTS,
    SHOULDER_HEIGHT_M,
    ArmLengths,
    Camera,
    bodies,
    kneeling,
    looking_at,
    skeleton_frames,
    with_fist,
    with_neutral_second,
)
from mild_ros.viewing.placing import floor_height, stood_on
from test.core.perception.scene import TINY_M, at_rate, swing

AZURE = SOURCES["azure_kinect"]
RATE_HZ = 40.0
START_NS = 1_700_000_000_000_000_000


def through_a_tracker(arm_m: FloatArray, bone_lengths_m: tuple[float, float], camera: Camera) -> list[FeatureWindow]:
    """Windows of an arm track: whole body, MarkerArray, adapter, perception, at 40 Hz."""
    perception = Perception(
        PerceptionSettings(
            joint_names=("shoulder", "elbow", "hand"),
            bone_lengths_m=bone_lengths_m,
            rate_hz=RATE_HZ,
            window=40,
            source_axes=AZURE.axes,
        )
    )
    state, windows = perception.init(), []
    for frame in skeleton_frames(bodies(with_neutral_second(arm_m, RATE_HZ)), RATE_HZ, START_NS, camera, sway_m=TINY_M):
        message = people_to_marker_array([frame], AZURE)
        state, made = perception.step(state, people_from_msg(message, AZURE, 0), frame.stamp_ns)
        windows += made
    assert dict(state.counts) == {
        "calibrating": 40,
        "calibrated": 1,
        "accepted": len(arm_m),
        "windows": len(arm_m),
    }
    return windows


def features_of(arm_m: FloatArray, window: int = 40) -> FloatArray:
    """(T, W, D) what learning cuts from a recording, padded by its first frame before it has W of them."""
    rows = with_neutral_second(arm_m, window - 1).reshape(-1, 9)
    return np.stack([rows[index : index + window] for index in range(len(arm_m))])


def bone_lengths_of(arm_m: FloatArray) -> tuple[float, float]:
    upper, fore = np.linalg.norm(np.diff(arm_m[0], axis=0), axis=1).tolist()
    return upper, fore


def test_a_synthetic_arm_comes_back_exactly() -> None:
    arm_m = swing(at_rate(RATE_HZ, 5.0))
    arm_m -= arm_m[0, 0]
    windows = through_a_tracker(arm_m, bone_lengths_of(arm_m), Camera())
    assert windows[0].stamp_ns == START_NS + 1_000_000_000
    shown = np.stack([window.features for window in windows])
    # There and back in float64 at metres; the tracker's doubles are not rounded.
    np.testing.assert_allclose(shown, features_of(arm_m), atol=3 * TINY_M)


@pytest.mark.parametrize("place", [(2.2, 0.7, 0.15), (1.5, -1.8, 0.9)])
def test_recorded_arms_come_back_within_a_millimetre(mild_data: Path, place: tuple[float, float, float]) -> None:
    from mild_core.learning.datasets.buetepage_hr import read

    camera = Camera("camera", looking_at(place, (0.0, 0.2, -0.4)))
    trials = read(mild_data / "buetepage_hr" / "traj_data.npz").train
    assert len(trials) == 32
    for trial in trials[:: 4 if place[0] > 2.0 else 11]:
        arm_m = np.asarray(trial.observed_m)
        windows = through_a_tracker(arm_m, (0.18, 0.234), camera)
        shown = np.stack([window.features for window in windows])
        assert np.abs(shown - features_of(arm_m)).max() < 0.001  # the manifest's lengths are rounded to 1 mm


def part(body_m: FloatArray, name: str) -> FloatArray:
    return body_m[:, BODY_JOINTS.index(name)]


def test_the_person_stands_upright_on_the_floor_and_faces_forward() -> None:
    body = bodies(swing(at_rate(RATE_HZ, 5.0)))
    assert body.shape == (200, 32, 3)
    assert -SHOULDER_HEIGHT_M <= part(body, "left_foot")[0, 2] < -SHOULDER_HEIGHT_M + 0.05
    heights = [part(body, name)[0, 2] for name in ("left_foot", "left_knee", "pelvis", "chest", "neck", "head")]
    assert heights == sorted(heights)
    assert 1.6 < part(body, "left_eye")[0, 2] + SHOULDER_HEIGHT_M < 1.7  # eyes of an adult of 1.75 m
    assert part(body, "nose")[0, 0] > part(body, "head")[0, 0] + 0.08
    assert part(body, "left_shoulder")[0, 1] > part(body, "right_shoulder")[0, 1] + 0.3
    assert not np.ptp(body[:, [BODY_JOINTS.index(f"{side}_ankle") for side in ("left", "right")]], axis=0).any()


def test_the_arm_has_an_adults_bones_and_the_trunk_follows_the_shoulder_a_little() -> None:
    body = bodies(swing(at_rate(RATE_HZ, 5.0)))
    bones = {"elbow": ("shoulder", ADULT.upper_m), "hand": ("elbow", ADULT.fore_m)}
    for end, (start, length_m) in bones.items():
        lengths = np.linalg.norm(part(body, f"right_{end}") - part(body, f"right_{start}"), axis=1)
        np.testing.assert_allclose(lengths, length_m, atol=1e-12)
    ways = {name: np.ptp(part(body, name), axis=0).max() for name in ("right_shoulder", "neck", "chest", "pelvis")}
    assert ways["right_shoulder"] == pytest.approx(0.03, rel=0.01)
    assert ways["right_shoulder"] > ways["neck"] > ways["chest"] > ways["pelvis"] == 0.0


def test_arm_lengths_can_be_those_of_the_recording() -> None:
    arm_m = swing(at_rate(RATE_HZ, 2.0))
    body = bodies(arm_m, ArmLengths(*bone_lengths_of(arm_m)))
    for index, name in enumerate(("right_shoulder", "right_elbow", "right_hand")):
        np.testing.assert_allclose(part(body, name), arm_m[:, index], atol=1e-12)


def test_a_camera_sees_with_x_right_y_down_z_away() -> None:
    camera = Camera("camera", looking_at((2.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    np.testing.assert_allclose(camera.sees(np.array([0.0, 0.0, 0.0])), [0.0, 0.0, 2.0], atol=1e-12)
    # Who faces the camera has the left hand on the right of the picture, and the head at its top.
    np.testing.assert_allclose(camera.sees(np.array([0.0, 0.3, 0.5])), [0.3, -0.5, 2.0], atol=1e-12)
    assert np.linalg.det(camera.arm_from_camera[:3, :3]) == pytest.approx(1.0)


def test_an_arm_that_hangs_straight_or_has_no_direction_stays_finite() -> None:
    straight = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, -0.18], [0.0, 0.0, -0.414]], np.zeros((3, 3))])
    assert np.isfinite(bodies(straight)).all()


def test_who_is_drawn_beside_a_robot_on_the_floor_stands_on_it_too() -> None:
    frames = [dict(zip(BODY_JOINTS, body, strict=True)) for body in bodies(swing(at_rate(RATE_HZ, 1.0)))]
    floor_m = floor_height(frames)
    for lower_m in (0.0, 0.15):
        stood = stood_on(frames, floor_m - lower_m)
        assert floor_height(stood) == pytest.approx(floor_m - lower_m, abs=1e-9)
        for before, after in zip(frames, stood, strict=True):
            np.testing.assert_array_equal(after["right_hand"], before["right_hand"])
            assert after["left_hip"][2] > after["left_knee"][2] > after["left_ankle"][2]


def test_whose_shoulders_are_as_low_as_peppers_is_drawn_on_one_knee() -> None:
    frames = [dict(zip(BODY_JOINTS, body, strict=True)) for body in bodies(swing(at_rate(RATE_HZ, 0.2)))]
    floor_m = floor_height(frames) + 0.635
    knelt = stood_on(frames, floor_m)
    assert floor_height(knelt) == pytest.approx(floor_m, abs=1e-9)
    for before, after in zip(frames, knelt, strict=True):
        np.testing.assert_array_equal(after["right_hand"], before["right_hand"])
        assert after["right_knee"][2] - floor_m < 0.1 < after["left_knee"][2] - floor_m
        # Bones of a whole adult, not of one with legs cut short.
        assert np.linalg.norm(after["right_knee"] - after["right_hip"]) == pytest.approx(0.42, abs=0.03)


def test_a_person_who_kneels_keeps_trunk_arm_and_bones() -> None:
    standing = bodies(swing(at_rate(RATE_HZ, 0.2)))
    knelt = with_fist(kneeling(standing))

    def bone(body: FloatArray, start: str, end: str) -> float:
        return float(np.linalg.norm(body[0, BODY_JOINTS.index(end)] - body[0, BODY_JOINTS.index(start)]))

    for name in ("head", "pelvis", "right_hand", "left_shoulder"):
        np.testing.assert_array_equal(knelt[:, BODY_JOINTS.index(name)], standing[:, BODY_JOINTS.index(name)])
    for side in ("left", "right"):
        for start, end in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist")):
            names = (f"{side}_{start}", f"{side}_{end}")
            assert bone(knelt, *names) == pytest.approx(bone(standing, *names), abs=0.02)
    assert bone(knelt, "right_hand", "right_hand_tip") == pytest.approx(0.027)

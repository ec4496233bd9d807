# SPDX-License-Identifier: Apache-2.0
"""The neutral second: which frame of reference it finds, what it refuses, and keeping it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.perception.calibration import calibration_from_mapping
from mild_core.perception.stage import PerceptionSettings
from mild_core.shapes import FloatArray
from mild_core.signals import SkeletonFrame
from mild_ros.simulation.person import Camera, looking_at
from test.core.perception.scene import PERSON, SECOND, SETTINGS, People, at_rate, newest_arms, run, seen, truth

EXACT_M = 1e-9

CAMERAS = [
    ((2.2, 0.7, 0.15), (0.0, 0.2, -0.4)),
    ((2.0, -1.5, 1.2), (0.0, 0.0, -0.3)),
    ((1.2, 1.6, -1.0), (0.0, 0.2, 0.0)),
    ((-2.5, 0.3, 0.3), (0.0, 0.0, -0.3)),
]


@pytest.mark.parametrize(("place", "target"), CAMERAS)
def test_the_arm_frame_is_the_persons_wherever_the_camera_stands(
    place: tuple[float, float, float], target: tuple[float, float, float]
) -> None:
    camera = Camera("camera", looking_at(place, target))
    state, windows = run(seen(at_rate(40.0, 3.0), camera=camera))
    assert state.calibration
    np.testing.assert_allclose(state.calibration.arm_from_source, camera.arm_from_camera[:3, :3], atol=EXACT_M)
    np.testing.assert_allclose(state.calibration.shoulder_m, camera.sees(np.zeros(3)), atol=EXACT_M)
    np.testing.assert_allclose(state.calibration.bone_lengths_m, [0.29, 0.335], atol=EXACT_M)
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=EXACT_M)


def test_a_second_with_a_hole_is_no_neutral_second() -> None:
    times = np.concatenate([at_rate(40.0, 0.5), 1.2 + at_rate(40.0, 1.5)])
    _, windows = run(seen(times, lambda times: np.repeat(swing_start(), len(times), axis=0)))
    assert windows[0].stamp_ns == pytest.approx(2.2 * SECOND, abs=SECOND // 40)


def moved(people: People, positions_m: FloatArray) -> People:
    return (replace(people[0], positions_m=positions_m),)


def test_a_person_who_does_not_stand_still_is_waited_for() -> None:
    messages = seen(at_rate(40.0, 5.0), lambda times: np.repeat(swing_start(), len(times), axis=0))
    swaying = [
        moved(people, people[0].positions_m + np.array([0.2 * np.sin(4.0 * index / 40.0), 0.0, 0.0]))
        if index < 120
        else moved(people, people[0].positions_m + np.array([0.2 * np.sin(4.0 * 119 / 40.0), 0.0, 0.0]))
        for index, people in enumerate(messages)
    ]
    state, windows = run(swaying)
    assert state.counts["moving"] > 80
    assert state.counts["calibrated"] == 1
    assert 3.0 < windows[0].stamp_ns / SECOND < 4.0


def swing_start() -> FloatArray:
    return np.array([[[0.0, 0.0, 0.0], [0.0, -0.02, -0.18], [0.03, -0.02, -0.41]]])


def test_the_origin_is_the_mean_shoulder_of_noisy_frames() -> None:
    generator = np.random.default_rng(5)
    messages = [
        moved(people, people[0].positions_m + generator.normal(0.0, 0.005, people[0].positions_m.shape))
        for people in seen(at_rate(40.0, 1.5))
    ]
    state, _ = run(messages)
    assert state.calibration
    error_m = state.calibration.shoulder_m - Camera().sees(np.zeros(3))
    assert np.abs(error_m).max() < 4 * 0.005 / np.sqrt(41)  # four standard errors of a mean over 41 frames
    turned = state.calibration.arm_from_source @ Camera().arm_from_camera[:3, :3].T
    assert np.degrees(np.arccos((np.trace(turned) - 1.0) / 2.0)) < 1.0


def test_the_left_arm_is_mirrored() -> None:
    """A person and their mirror image look the same, one watched on the right, one on the left."""
    right = seen(at_rate(40.0, 3.0))
    _, expected = run(right)
    left = [(mirrored(people[0]),) for people in right]
    state, windows = run(left, replace(SETTINGS, side="left"))
    assert state.calibration
    assert np.linalg.det(state.calibration.arm_from_source) == pytest.approx(1.0)
    assert len(windows) == len(expected)
    np.testing.assert_allclose(newest_arms(windows), newest_arms(expected), atol=EXACT_M)


def mirrored(frame: SkeletonFrame) -> SkeletonFrame:
    """What a mirror shows to the camera, with left and right named as the mirror image's own."""
    swapped = {"left": "right", "right": "left"}
    names = tuple(
        "_".join([swapped.get(name.split("_")[0], name.split("_")[0]), *name.split("_")[1:]])
        for name in frame.joint_names
    )
    return replace(frame, joint_names=names, positions_m=frame.positions_m * np.array([-1.0, 1.0, 1.0]))


def names_swapped(frame: SkeletonFrame) -> SkeletonFrame:
    return replace(frame, joint_names=mirrored(frame).joint_names)


def left_handed(frame: SkeletonFrame) -> SkeletonFrame:
    return replace(frame, positions_m=frame.positions_m * np.array([-1.0, 1.0, 1.0]))


def upside_down(frame: SkeletonFrame) -> SkeletonFrame:
    return replace(frame, positions_m=frame.positions_m * np.array([-1.0, -1.0, 1.0]))


@pytest.mark.parametrize(
    ("wrong", "settings", "reason"),
    [
        (names_swapped, SETTINGS, "mirrored"),
        (left_handed, SETTINGS, "mirrored"),
        (upside_down, SETTINGS, "wrong_up_axis"),
        (lambda frame: frame, replace(SETTINGS, source_axes="rep103"), "wrong_up_axis"),
    ],
)
def test_wrong_axes_are_named_and_nothing_is_calibrated_on_them(
    wrong: object, settings: PerceptionSettings, reason: str
) -> None:
    state, windows = run([(wrong(people[0]),) for people in seen(at_rate(40.0, 3.0))], settings)
    assert (state.outcome, state.calibration, windows) == (reason, None, [])
    assert state.counts[reason] == 80
    assert "depth_camera_link" in state.detail


def test_an_upside_down_camera_works_when_it_is_not_checked() -> None:
    settings = replace(SETTINGS, source_axes="unknown")
    _, windows = run([(upside_down(people[0]),) for people in seen(at_rate(40.0, 3.0))], settings)
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=EXACT_M)


def test_a_torso_without_extent_is_refused() -> None:
    def flat(frame: SkeletonFrame) -> SkeletonFrame:
        positions = frame.positions_m.copy()
        positions[frame.joint_names.index("left_shoulder")] = positions[frame.joint_names.index("right_shoulder")]
        return replace(frame, positions_m=positions)

    state, _ = run([(flat(people[0]),) for people in seen(at_rate(40.0, 2.0))])
    assert state.outcome == "flat_torso"


@pytest.mark.parametrize("joint", ["left_shoulder", "pelvis"])
def test_a_trunk_that_is_not_seen_delays_the_calibration(joint: str) -> None:
    messages = seen(at_rate(40.0, 3.0))
    for index in range(20):
        frame = messages[index][0]
        confidence = frame.confidence.copy()
        confidence[frame.joint_names.index(joint)] = 0.1
        messages[index] = (replace(frame, confidence=confidence),)
    state, windows = run(messages)
    assert state.counts["low_confidence"] == 20
    assert windows[0].stamp_ns == SECOND + SECOND // 2


def only(frame: SkeletonFrame, *names: str) -> SkeletonFrame:
    kept = [frame.joint_names.index(name) for name in names]
    return replace(frame, joint_names=names, positions_m=frame.positions_m[kept], confidence=frame.confidence[kept])


ARM = ("right_shoulder", "right_elbow", "right_hand")


def test_hips_stand_in_for_a_pelvis() -> None:
    names = (*ARM, "left_shoulder", "left_hip", "right_hip")
    state, windows = run([(only(people[0], *names),) for people in seen(at_rate(40.0, 3.0))])
    assert state.calibration
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=EXACT_M)


def in_arm_axes(people: People) -> SkeletonFrame:
    frame, camera = people[0], Camera()
    turned = frame.positions_m @ camera.arm_from_camera[:3, :3].T + camera.arm_from_camera[:3, 3]
    return replace(frame, positions_m=turned, frame_id="person")


def test_given_axes_need_no_trunk_and_allow_a_shoulder_at_the_origin() -> None:
    settings = replace(SETTINGS, axes="given")
    rest = [(replace(only(in_arm_axes(p), *ARM), person_id=PERSON),) for p in seen(at_rate(40.0, 3.0))]
    at_origin = []
    for (frame,) in rest:
        positions = frame.positions_m.copy()
        positions[0] = np.where(np.abs(positions[0]) < 1e-12, 0.0, positions[0])
        at_origin.append((replace(frame, positions_m=positions),))
    assert not at_origin[0][0].positions_m[0].any()
    state, windows = run(at_origin, settings)
    assert state.calibration
    np.testing.assert_array_equal(state.calibration.arm_from_source, np.eye(3))
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=EXACT_M)


@pytest.mark.parametrize(
    ("turn", "reason"),
    [((-1.0, -1.0, 1.0), "wrong_forward_axis"), ((1.0, -1.0, -1.0), "wrong_up_axis"), ((1.0, -1.0, 1.0), "mirrored")],
)
def test_given_axes_are_checked_where_a_trunk_is_seen(turn: tuple[float, float, float], reason: str) -> None:
    wrong = [(replace(f, positions_m=f.positions_m * np.array(turn)),) for f in map(in_arm_axes, seen(at_rate(40, 2)))]
    state, windows = run(wrong, replace(SETTINGS, axes="given"))
    assert (state.outcome, windows) == (reason, [])


def test_a_kept_calibration_answers_from_the_first_message() -> None:
    messages = seen(at_rate(40.0, 3.0))
    state, expected = run(messages)
    assert state.calibration
    kept = calibration_from_mapping(json.loads(json.dumps(state.calibration.as_mapping())))
    settings = replace(SETTINGS, calibration=kept)
    state, windows = run(messages[40:], settings)
    assert dict(state.counts) == {"accepted": 80, "windows": 80}
    for one, other in zip(windows, expected, strict=True):
        np.testing.assert_array_equal(one.features, other.features)
    state, _ = run(messages, settings, state)
    assert state.counts["time_reset"] == 1
    assert state.calibration is kept


@pytest.mark.parametrize(
    "change",
    [
        {"arm_from_source": [[1, 0, 0], [0, 1, 0], [0, 0, 2]]},
        {"arm_from_source": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]},
        {"arm_from_source": [[1, 0], [0, 1]]},
        {"shoulder_m": [0.0, float("nan"), 0.0]},
        {"arm_from_source": [[1, 0.01, 0], [-0.01, 1, 0], [0, 0, 1]]},
        {"bone_lengths_m": [0.3, -1.0]},
        {"bone_lengths_m": [0.3, 0.0]},
        {"bone_lengths_m": [0.3, 2.5]},
        {"bone_lengths_m": 3},
        {"side": "both"},
        {"stamp_ns": None},
    ],
)
def test_a_broken_kept_calibration_is_one_clear_line(change: dict[str, object]) -> None:
    state, _ = run(seen(at_rate(40.0, 1.5)))
    assert state.calibration
    values = {**state.calibration.as_mapping(), **change}
    with pytest.raises(SetupError, match=r"^calibration: .*calibrate again$"):
        calibration_from_mapping(values)
    with pytest.raises(SetupError, match=r"^calibration: "):
        calibration_from_mapping({})


@pytest.mark.parametrize(
    "change",
    [
        {"joint_names": ("shoulder", "elbo", "hand")},
        {"joint_names": ("shoulder",)},
        {"bone_lengths_m": (0.3,)},
        {"bone_lengths_m": (0.3, 0.0)},
        {"rate_hz": 0.0},
        {"rate_hz": float("nan")},
        {"window": 0},
        {"features": "velocities"},
        {"side": "both"},
        {"axes": "camera"},
        {"source_axes": "sideways"},
        {"max_gap_s": -1.0},
    ],
)
def test_settings_that_cannot_work_are_refused_by_name(change: dict[str, object]) -> None:
    with pytest.raises(SetupError, match=next(iter(change))):
        replace(SETTINGS, **change)


def test_a_calibration_of_the_other_arm_is_refused() -> None:
    state, _ = run(seen(at_rate(40.0, 1.5)))
    with pytest.raises(SetupError, match="right arm"):
        replace(SETTINGS, side="left", calibration=state.calibration)
    with pytest.raises(SetupError, match="other joints"):
        replace(SETTINGS, joint_names=("shoulder", "elbow"), bone_lengths_m=(0.2,), calibration=state.calibration)

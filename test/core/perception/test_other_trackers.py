# SPDX-License-Identifier: Apache-2.0
"""Trackers that stretch bones, jitter and lose frames: what they say of directions counts all the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mild_core.perception.arm import BoneFit, bone_fit
from mild_core.perception.stage import Perception, PerceptionSettings
from mild_core.shapes import FloatArray
from mild_core.signals import SkeletonFrame
from mild_ros.simulation.person import Camera, looking_at
from test.core.perception.scene import SECOND, SETTINGS, People, at_rate, changed, newest_arms, run, seen, truth

EXACT_M = 1e-9
"""Rounding of rotated directions."""

SIDE, ABOVE = looking_at((2.0, -1.5, 1.2), (0.0, 0.0, -0.3)), looking_at((1.2, 1.6, -1.0), (0.0, 0.2, 0.0))


def stretched(frame: SkeletonFrame, upper: float, fore: float) -> SkeletonFrame:
    """The frame with the right arm's bones so many times as long, in the same directions."""
    positions, names = frame.positions_m.copy(), frame.joint_names
    shoulder, elbow = (names.index(f"right_{part}") for part in ("shoulder", "elbow"))
    old = positions[elbow].copy()
    positions[elbow] = positions[shoulder] + upper * (old - positions[shoulder])
    for part in ("wrist", "hand", "hand_tip", "thumb"):
        place = names.index(f"right_{part}")
        positions[place] = positions[elbow] + fore * (positions[place] - old)
    return replace(frame, positions_m=positions)


def breathing(messages: list[People], rng: np.random.Generator, low: float, high: float) -> list[People]:
    """A tracker that stretches both bones in each frame after the neutral second."""
    return [
        (stretched(frame, *rng.uniform(low, high, 2)),) if frame.stamp_ns > SECOND else (frame,)
        for (frame,) in messages
    ]


def jittering(messages: list[People], rng: np.random.Generator, jitter_m: float, lost: float) -> list[People]:
    """A tracker with so much noise in each coordinate that loses so many of its frames."""
    noisy = [
        (replace(frame, positions_m=frame.positions_m + jitter_m * rng.normal(size=frame.positions_m.shape)),)
        for (frame,) in messages
    ]
    return [people for people in noisy if rng.uniform() >= lost]


@pytest.mark.parametrize(("low", "high"), [(0.7, 1.6), (0.4, 0.65), (1.4, 2.2)])
@pytest.mark.parametrize("pose", [SIDE, ABOVE])
def test_a_bones_length_alone_condemns_no_frame(low: float, high: float, pose: FloatArray) -> None:
    messages = seen(at_rate(40.0, 5.0), camera=Camera("camera", pose))
    state, windows = run(breathing(messages, np.random.default_rng(4), low, high))
    assert state.counts["accepted"] == 4 * 40
    assert "bone_length" not in state.counts
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=EXACT_M)


@pytest.mark.parametrize("rate_hz", [10.0, 15.0, 30.0, 60.0, 100.0])
@pytest.mark.parametrize("jitter_m", [0.0, 0.01, 0.02])
def test_frames_of_a_tracker_that_stretches_and_jitters_are_used_at_any_rate(rate_hz: float, jitter_m: float) -> None:
    rng = np.random.default_rng(round(rate_hz))
    messages = jittering(breathing(seen(at_rate(rate_hz, 8.0)), rng, 0.7, 1.7), rng, jitter_m, 0.1)
    state, _ = run(messages)
    used = state.counts["accepted"]
    assert state.counts["calibrated"] == 1
    assert used >= 0.95 * sum(number for name, number in state.counts.items() if name in (*REFUSALS, "accepted"))
    assert used > 0.7 * 6.0 * rate_hz


REFUSALS = ("bone_length", "mirrored", "wrong_up_axis", "other_person")


@pytest.mark.parametrize(
    ("joint", "place"),
    [
        ("right_elbow", (0.0, -0.15, 0.0)),  # up beside the head
        ("right_hand", (-0.5, 0.25, 0.35)),  # across the body, away from where it swings
    ],
)
def test_a_bone_that_leaps_with_its_length_is_a_glitch(joint: str, place: tuple[float, float, float]) -> None:
    clean = seen(at_rate(40.0, 4.0))
    spoilt = list(clean)
    names = clean[0][0].joint_names
    for index in (80, 81, 82):
        frame = clean[index][0]
        around = frame.positions_m[names.index("right_shoulder" if joint == "right_elbow" else "right_elbow")]
        spoilt[index] = (changed(frame, joint, position=around + np.array(place)),)
    state, windows = run(spoilt)
    assert state.counts["bone_length"] == 3
    assert "degrees" in run(spoilt[:81])[0].detail
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=0.004)


def test_a_bone_that_stays_elsewhere_is_believed_after_a_while() -> None:
    messages = seen(at_rate(40.0, 4.0), lambda times: np.repeat(AT_REST[None], len(times), axis=0))
    raised = [
        (changed(frame, "right_hand", position=frame.positions_m[ELBOW] + np.array([-0.1, -0.45, -0.1])),)
        for (frame,) in messages[80:]
    ]
    state, _ = run(messages[:80] + raised)
    assert 0 < state.counts["bone_length"] < 0.2 * 40
    assert state.outcome == "accepted"


AT_REST = np.array([[0.0, 0.0, 0.0], [0.0, -0.02, -0.18], [0.03, -0.02, -0.41]])
ELBOW = seen([0.0])[0][0].joint_names.index("right_elbow")


@pytest.mark.parametrize("rate_hz", [10.0, 15.0, 30.0, 60.0])
@pytest.mark.parametrize("pose", [None, SIDE, ABOVE])
def test_jitter_of_25_mm_and_a_fifth_of_the_frames_lost_calibrates(rate_hz: float, pose: FloatArray | None) -> None:
    camera = Camera() if pose is None else Camera("camera", pose)
    for seed in range(4):
        standing = seen(
            at_rate(rate_hz, 4.0), lambda times: np.repeat(AT_REST[None], len(times), axis=0), camera=camera
        )
        state, windows = run(jittering(standing, np.random.default_rng(seed), 0.025, 0.2))
        assert state.counts["calibrated"] == 1
        assert state.calibration is not None
        assert state.calibration.stamp_ns < 2.5 * SECOND
        turned = state.calibration.arm_from_source @ camera.arm_from_camera[:3, :3].T
        assert np.degrees(np.arccos((np.trace(turned) - 1.0) / 2.0)) < 6.0
        assert windows


def _details(messages: list[People]) -> set[str]:
    perception, found = Perception(SETTINGS), set()
    state = perception.init()
    for people in messages:
        state, _ = perception.step(state, people, people[0].stamp_ns)
        found.add(state.detail)
    return found


def _walking(messages: list[People]) -> list[People]:
    steps = np.array([0.3, 0.0, 0.0])
    return [(replace(p, positions_m=p.positions_m + p.stamp_ns / SECOND * steps),) for (p,) in messages]


def _hidden(messages: list[People]) -> list[People]:
    return [people for index, people in enumerate(messages) if index % 30 < 6]


@pytest.mark.parametrize(
    ("spoil", "reason", "said"),
    [
        (_walking, "moving", "trunk moved"),
        (lambda messages: jittering(messages, np.random.default_rng(0), 0.08, 0.0), "moving", "trunk jitters by 0.0"),
        (_hidden, "interrupted", "was not seen for 0.6 s"),
        (lambda messages: [(changed(p, "pelvis", confidence=0.1),) for (p,) in messages], "low_confidence", "pelvis"),
    ],
)
def test_who_is_not_calibrated_gets_the_reason(spoil: object, reason: str, said: str) -> None:
    messages = spoil(seen(at_rate(40.0, 4.0), lambda times: np.repeat(AT_REST[None], len(times), axis=0)))
    state, windows = run(messages)
    assert state.calibration is None
    assert windows == []
    assert state.counts[reason] > 0
    assert any(said in detail for detail in _details(messages))


def test_arms_of_another_length_for_long_are_another_persons() -> None:
    fit: BoneFit | None = None
    for index in range(100):
        lengths = (0.3, 0.28) if index < 20 else (0.45, 0.42) if index < 80 else (0.45, 0.28)
        fit = bone_fit(fit, index * SECOND // 10, lengths, (0.3, 0.28), 0.3)
        if index == 79:
            assert 4.0 < fit.misfit_ns / SECOND < 6.0
    assert fit is not None
    assert fit.misfit_since_ns is None  # one bone fits again: a tracker that stretches the other


def test_a_tracker_that_stretches_one_bone_calibrates_no_one_again() -> None:
    settings: PerceptionSettings = replace(SETTINGS, forget_s=1.0)
    messages = [(stretched(p, 1.0, 1.6),) if p.stamp_ns > SECOND else (p,) for (p,) in seen(at_rate(40.0, 5.0))]
    state, _ = run(messages, settings)
    assert "forgotten" not in state.counts
    assert state.counts["accepted"] == 4 * 40

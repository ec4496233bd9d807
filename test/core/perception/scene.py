# SPDX-License-Identifier: Apache-2.0
"""A person whose arm moves in a known way, seen by a camera at a known place, and a run of perception over it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from mild_core.perception.stage import Perception, PerceptionSettings, PerceptionState
from mild_core.shapes import FloatArray
from mild_core.signals import FeatureWindow, SkeletonFrame
from mild_ros.simulation.person import BODY_JOINTS, Camera, bodies, swaying

UPPER_M, FORE_M = 0.18, 0.234
"""Bone lengths of the YuMi recordings."""

FASTEST_M_S, SHARPEST_M_S2 = 0.82, 2.8
"""Of `swing`, by differences at 1 kHz, rounded up."""

TINY_M = 1e-10
"""Below all that is measured here, but no repetition to the bit."""

PERSON = 7
SECOND = 1_000_000_000

SETTINGS = PerceptionSettings(
    joint_names=("shoulder", "elbow", "hand"),
    bone_lengths_m=(UPPER_M, FORE_M),
    rate_hz=40.0,
    window=40,
    source_axes="optical",
)

Motion = Callable[[FloatArray], FloatArray]
People = tuple[SkeletonFrame, ...]


def swing(times_s: FloatArray) -> FloatArray:
    """(T, 3, 3) a smooth arm in the arm frame: at rest before 0 s, then raised, bent and lowered at 0.5 Hz.

    The hand moves at up to `FASTEST_M_S` and `SHARPEST_M_S2`, and the shoulder leans 3 cm forward.
    """
    turn = 2.0 * np.pi * 0.5 * np.maximum(times_s, 0.0)
    rise = (1.0 - np.cos(turn)) / 2.0
    raised, bent = 0.9 * rise, 0.2 + 0.6 * rise
    shoulder = np.stack([0.03 * rise, 0.0 * rise, -0.01 * rise], axis=-1)
    upper = np.stack([np.sin(raised), -0.1 + 0.2 * rise, -np.cos(raised)], axis=-1)
    fore = np.stack([np.sin(raised + bent), 0.3 * rise, -np.cos(raised + bent)], axis=-1)
    upper /= np.linalg.norm(upper, axis=-1, keepdims=True)
    fore /= np.linalg.norm(fore, axis=-1, keepdims=True)
    elbow = shoulder + UPPER_M * upper
    return np.stack([shoulder, elbow, elbow + FORE_M * fore], axis=1)


def seen(
    stamps_s: Iterable[float],
    motion: Motion = swing,
    person_id: int = PERSON,
    camera: Camera | None = None,
    sway_m: float = TINY_M,
) -> list[People]:
    """A message for each stamp [s]; the motion starts at 1 s, after the neutral second."""
    times = np.array(list(stamps_s), dtype=np.float64)
    camera = camera or Camera()
    positions = camera.sees(swaying(bodies(motion(times - 1.0)), times, sway_m))
    ones = np.ones(len(BODY_JOINTS))
    return [
        (SkeletonFrame(round(time * SECOND), camera.frame_id, person_id, BODY_JOINTS, joints, ones),)
        for time, joints in zip(times.tolist(), positions, strict=True)
    ]


def at_rate(rate_hz: float, seconds: float) -> FloatArray:
    """Stamps [s] of a steady tracker."""
    return np.arange(round(rate_hz * seconds)) / rate_hz


def changed(frame: SkeletonFrame, joint: str, **values: Any) -> SkeletonFrame:
    """The frame with another `position` [m] or `confidence` of one joint."""
    place = frame.joint_names.index(joint)
    positions, confidence = frame.positions_m.copy(), frame.confidence.copy()
    if "position" in values:
        positions[place] = values["position"]
    if "confidence" in values:
        confidence[place] = values["confidence"]
    return replace(frame, positions_m=positions, confidence=confidence)


def run(
    messages: Iterable[People], settings: PerceptionSettings = SETTINGS, state: PerceptionState | None = None
) -> tuple[PerceptionState, list[FeatureWindow]]:
    """Perception folded over messages that arrive at their stamps; an empty one 25 ms after the one before."""
    perception = Perception(settings)
    state = perception.init() if state is None else state
    windows: list[FeatureWindow] = []
    now_ns = 0
    for people in messages:
        now_ns = max((person.stamp_ns for person in people), default=now_ns + SECOND // 40)
        state, made = perception.step(state, people, now_ns)
        windows += made
    return state, windows


def newest_arms(windows: list[FeatureWindow]) -> FloatArray:
    """(N, 3, 3) the newest row of each window."""
    return np.stack([window.features[-1, :9].reshape(3, 3) for window in windows])


def stamps_s(windows: list[FeatureWindow]) -> FloatArray:
    """(N,) stamps [s]."""
    return np.array([window.stamp_ns for window in windows]) / SECOND


def truth(windows: list[FeatureWindow], motion: Motion = swing) -> FloatArray:
    """(N, 3, 3) where the arm really was at the windows' stamps."""
    return motion(stamps_s(windows) - 1.0)

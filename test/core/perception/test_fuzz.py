# SPDX-License-Identifier: Apache-2.0
"""Whatever a tracker sends: perception never raises, what it hands on is finite, and every message is accounted for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mild_core.perception.stage import Perception
from mild_core.signals import PersonPose, SkeletonFrame
from test.core.perception.scene import SECOND, SETTINGS, at_rate, seen
from test.core.perception.test_stage import OUTCOMES

CLEAN = [people[0] for people in seen(at_rate(40.0, 2.0))]
NUMBERS = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True, width=64), st.sampled_from([0.0, -0.0, 1e-320, 49.999, 1e308])
)
STAMPS = st.one_of(
    st.integers(0, 3 * SECOND),
    st.sampled_from([0, 1, 2**62, 2**63 - 1]),
    st.integers(0, 2**31).map(lambda s: s * SECOND),
)


@st.composite
def odd_frames(draw: st.DrawFn) -> SkeletonFrame:
    """A frame of a real person with anything about it changed, or nothing."""
    frame = CLEAN[draw(st.integers(0, len(CLEAN) - 1))]
    positions, confidence = frame.positions_m.copy(), frame.confidence.copy()
    positions *= draw(st.sampled_from([1.0, 1.0, 1.0, 1000.0, 0.0]))
    for _ in range(draw(st.integers(0, 3))):
        positions[draw(st.integers(0, 31)), draw(st.integers(0, 2))] = draw(NUMBERS)
    if draw(st.booleans()):
        confidence[draw(st.integers(0, 31))] = draw(NUMBERS)
    kept = slice(draw(st.sampled_from([0, 0, 0, 5])), draw(st.sampled_from([32, 32, 32, 15])))
    return replace(
        frame,
        stamp_ns=draw(st.one_of(st.just(frame.stamp_ns), STAMPS)),
        frame_id=draw(st.sampled_from([frame.frame_id] * 3 + ["", "map"])),
        person_id=draw(st.integers(0, 2)),
        joint_names=frame.joint_names[kept],
        positions_m=positions[kept],
        confidence=confidence[kept],
    )


def clean_second(start: int) -> list[tuple[SkeletonFrame, ...]]:
    return [(frame,) for frame in CLEAN[start : start + 45]]


MESSAGES = st.lists(
    st.one_of(
        st.lists(odd_frames(), max_size=3).map(lambda people: [tuple(people)]),
        st.integers(0, 35).map(clean_second),
        st.integers(0, 79).map(lambda index: [(CLEAN[index],)]),
    ),
    max_size=12,
).map(lambda parts: [people for part in parts for people in part])


def _check_pose(pose: PersonPose | None) -> None:
    if pose is None:
        return
    segments = pose.segments
    for numbers in (segments.ends_m, segments.velocities_m_s, segments.radii_m):
        assert np.isfinite(numbers).all()
    assert (segments.radii_m > 0.0).all()
    assert (segments.radii_m < 1.0).all()
    assert (np.linalg.norm(segments.velocities_m_s, axis=-1) < 10.0).all()
    assert len(set(zip(segments.people, segments.parts, strict=True))) == len(segments.parts)
    assert np.isnan(pose.facing).all() or abs(np.linalg.norm(pose.facing) - 1.0) < 1e-9
    assert pose.watched or np.isnan(pose.hand_m).all()


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
@given(
    messages=MESSAGES,
    axes=st.sampled_from(["torso", "given"]),
    side=st.sampled_from(["left", "right"]),
    features=st.sampled_from(["positions", "positions_velocities"]),
    receipt=STAMPS,
    measured=st.booleans(),
)
def test_anything_is_survived(
    messages: list[tuple[SkeletonFrame, ...]], axes: str, side: str, features: str, receipt: int, measured: bool
) -> None:
    camera = np.eye(4) if measured else None
    perception = Perception(
        replace(SETTINGS, axes=axes, side=side, features=features, source_axes="unknown", robot_from_source=camera)
    )
    state, made = perception.init(), 0
    for index, people in enumerate(messages):
        state, windows = perception.step(state, people, receipt + index * SECOND // 40)
        made += len(windows)
        _check_pose(state.person)
        for window in windows:
            assert window.features.shape == (40, 9 if features == "positions" else 18)
            assert np.isfinite(window.features).all()
    assert sum(state.counts.get(outcome, 0) for outcome in OUTCOMES) == len(messages)
    assert state.counts.get("windows", 0) == made

# SPDX-License-Identifier: Apache-2.0
"""Whatever comes, whenever it comes: commands stay finite, continuous and inside every limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mild_core.joint_measurements import OUTCOMES as OF_JOINTS
from mild_core.retargeting.guard import Guard
from mild_core.retargeting.human_track import AssumedPlacement
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Request, Retargeting, RetargetingInput, RetargetingSettings, RetargetingState
from mild_core.signals import ARM_FRAME, ROBOT_FRAME, JointCommand, PersonPose
from test.core.retargeting import people
from test.core.retargeting.limits import ROUNDING_RAD, check_limits
from test.core.retargeting.perfect import START_NS, measurement, window

PAUSES_NS = st.one_of(
    st.sampled_from([0, 1, 1_000, 1_000_000, 10_000_000, 25_000_000, 200_000_000, 300_000_000]),
    st.integers(0, 40_000_000),
    st.integers(0, 5_000_000_000),
    st.integers(-4_000_000_000, 0),
)


@dataclass(frozen=True)
class Event:
    """Something that comes `after_ns`; numbers too many to choose one by one come from `seed`."""

    after_ns: int
    kind: str
    size: float
    seed: int


EVENTS = st.builds(
    Event,
    PAUSES_NS,
    st.sampled_from(["tick"] * 6 + ["motion"] * 5 + ["jump", "unknown", "broken", "old", "measured", "moved", "lost"])
    | st.sampled_from(["enable", "disable", "reset", "hold", "release"] + ["person"] * 5 + ["reaching"] * 5),
    st.sampled_from([0.01, 0.2, 1.0, 20.0]),
    st.integers(0, 2**32 - 1),
)


STANDING = AssumedPlacement((0.9, 0.1, 0.7), np.pi, {"handshake": (0.7, 0.0, 0.6)})
"""Closer than a person should stand, so that everything is met that can be met."""


def _pose(event: Event, rng: np.random.Generator, stamp_ns: int) -> PersonPose:
    """A person anywhere, or one whose hand comes near the robot's home; now and then a part is hidden or broken."""
    near = event.kind == "reaching"
    hand = rng.normal([0.35, 0.2, -0.5] if near else 0.0, 0.1 if near else event.size, 3)
    parts = [hand, *rng.normal([[0.0, 0.2, 0.2], [0.0, 0.2, 0.0], [0.0, 0.2, -0.5]], 0.1 * event.size)]
    if rng.random() < 0.2:
        parts[rng.integers(4)] = np.full(3, rng.choice([np.nan, np.inf]))
    frame = str(rng.choice([ARM_FRAME, ROBOT_FRAME, "nowhere"], p=[0.5, 0.4, 0.1]))
    others = [(number, people.body_ends(*rng.normal(0.3, event.size, (4, 3)))) for number in range(rng.integers(3))]
    whole = np.isfinite(parts).all()
    known = people.segments([*([(0, people.body_ends(*parts))] if whole else []), *others], rng.normal(0, 0.5, 3))
    facing, watched = rng.normal(size=3) if rng.random() < 0.5 else np.full(3, np.nan), bool(rng.random() < 0.9)
    return PersonPose(stamp_ns, frame, parts[0], parts[1], np.array(parts[2:]), known, facing, watched)


def _given(event: Event, state: RetargetingState, now_ns: int) -> RetargetingInput:
    rng = np.random.default_rng(event.seed)
    here = np.array(YUMI.home_rad if state.motion is None else state.motion.position_rad)
    walk = here + np.cumsum(rng.normal(0.0, event.size / 6, (40, 7)), axis=0)
    stamp_ns = now_ns - int(rng.integers(0, 200_000_000))
    match event.kind:
        case "motion":
            return window(walk, stamp_ns, lead_ns=int(rng.integers(-1_000_000_000, 1_000_000_000)))
        case "jump":
            return window(rng.uniform(YUMI.lower_rad * 2, YUMI.upper_rad * 2, (40, 7)), stamp_ns)
        case "unknown":
            return window(walk, stamp_ns, interaction="", out_of_distribution=event.size)
        case "broken":
            walk[rng.integers(40), rng.integers(7)] = rng.choice([np.nan, np.inf, -np.inf])
            return window(walk, stamp_ns)
        case "old":
            return window(walk, stamp_ns - 10_000_000_000)
        case "measured":
            return measurement(np.clip(here + rng.normal(0, 0.02, 7), YUMI.lower_rad, YUMI.upper_rad), now_ns)
        case "moved":
            return measurement(rng.uniform(YUMI.lower_rad, YUMI.upper_rad), now_ns)
        case "lost":
            return measurement(np.full(7, np.nan), now_ns)
        case "person" | "reaching":
            return _pose(event, rng, stamp_ns)
        case "enable" | "disable" | "reset" | "hold" | "release":
            return Request(event.kind)
    return None


@pytest.fixture(scope="module")
def retargeting() -> Retargeting:
    return Retargeting(YUMI, RetargetingSettings(allow_unmeasured_contact=True), STANDING)


BETWEEN_M = 0.01
"""How much nearer parts may come between the places at which a stop is looked at; APART_M is twice that."""


def check_clearance(retargeting: Retargeting, commands: list[JointCommand]) -> None:
    """Assert that parts of the robot never come nearer to each other than they may, or than they were at first."""
    at = np.array([command.positions_rad for command in commands])
    clear_m = Guard(YUMI, retargeting.settings).own_clearance_m(at)
    assert clear_m.min() >= min(0.0, clear_m[0]) - BETWEEN_M


# Each run takes the same seeds; two thousand others were run once.
@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.lists(EVENTS, min_size=20, max_size=150))
def test_commands_are_continuous_and_inside_every_limit(retargeting: Retargeting, events: list[Event]) -> None:
    state, now_ns = retargeting.init(), START_NS
    state, _ = retargeting.step(state, measurement(YUMI.home_rad), now_ns)
    runs: list[list[JointCommand]] = [[]]
    for event in events:
        now_ns += event.after_ns
        before = state
        state, commands = retargeting.step(state, _given(event, before, now_ns), now_ns)
        assert len(commands) <= 1
        for command in commands:
            assert command.stamp_ns == now_ns
            fresh_start = before.commanded_ns is None or now_ns < before.commanded_ns
            gap = state.counts.get("gap", 0) > before.counts.get("gap", 0)
            if fresh_start or gap:
                runs.append([])
            if gap or (fresh_start and before.commanded_ns is not None):
                # After a gap, or when time went back, the command is where it was.
                assert before.motion is not None
                np.testing.assert_allclose(command.positions_rad, before.motion.position_rad, atol=ROUNDING_RAD)
            runs[-1].append(command)
    for run in runs:
        if run:
            check_limits(YUMI, run)
            check_clearance(retargeting, run)
    assert sum(state.counts[outcome] for outcome in OUTCOMES if outcome in state.counts) == len(events) + 1
    assert "no_plan" not in state.counts


OUTCOMES = (
    *("tick", "accepted", "unknown", "too_old", "from_future", "out_of_order", "not_finite", "wrong_joints"),
    *("person", "unknown_frame", "held", "released"),
    *("enabled", "disabled", "reset", "not_enabled", "no_joint_states", *OF_JOINTS),
)

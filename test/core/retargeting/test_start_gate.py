# SPDX-License-Identifier: Apache-2.0
"""Whether a raised hand is meant for the robot, one rule at a time: which hand it is, where it goes, for how long."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.retargeting.human_track import HumanTrack
from mild_core.retargeting.mode_inputs import with_rest
from mild_core.retargeting.modes import Mode
from mild_core.retargeting.obstacles import Crowd
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.start_gate import ASIDE, AT_HEAD, WATCHED, start_refusal, way_of
from mild_core.retargeting.state import RetargetingState
from mild_core.signals import ROBOT_FRAME, WATCHED_PERSON, BodySegments

SECOND_NS = 1_000_000_000
SETTINGS = RetargetingSettings()
TO_ROBOT, LEFT, UP = np.array([-1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])
CHEST_M = np.array([0.95, 0.0, 0.5])
SHOULDER_M = {"right": CHEST_M - 0.18 * LEFT, "left": CHEST_M + 0.18 * LEFT}


def person(side: str, hand_m: np.ndarray, raised_s: float = 1.0) -> tuple[HumanTrack, Crowd]:
    """A person who has raised the hand of a side for so long; the other arm hangs."""
    parts: dict[str, tuple[np.ndarray, np.ndarray]] = {"trunk": (CHEST_M, CHEST_M - 0.55 * UP)}
    for each, shoulder in SHOULDER_M.items():
        hand = hand_m if each == side else shoulder - 0.6 * UP
        elbow = (shoulder + hand) / 2.0 - 0.1 * UP
        parts |= {f"{each}_upper_arm": (shoulder, elbow), f"{each}_forearm": (elbow, hand + 0.2 * (hand - elbow))}
    ends = np.array(list(parts.values()))
    segments = BodySegments((WATCHED_PERSON,) * len(parts), tuple(parts), ends, 0.0 * ends, np.full(len(parts), 0.05))
    rest, since_ns = SHOULDER_M[side] - 0.6 * UP, round(-raised_s * SECOND_NS)
    sight = HumanTrack(ROBOT_FRAME, 0, 0, hand_m, np.zeros(3), rest, True, since_ns, 0.5, hand_m, since_ns)
    return sight, Crowd(segments, ROBOT_FRAME, 0, TO_ROBOT)


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_hand_is_judged_from_its_own_shoulder(side: str) -> None:
    out = LEFT if side == "left" else -LEFT
    shoulder = SHOULDER_M[side]
    for way, doubt in (
        (0.15 * TO_ROBOT + 0.55 * out - 0.1 * UP, ASIDE),
        (0.4 * TO_ROBOT - 0.36 * out - 0.1 * UP, ""),  # across the body, before the other shoulder
        (0.1 * TO_ROBOT + 0.3 * UP, AT_HEAD),
        (0.45 * TO_ROBOT - 0.1 * UP, ""),
    ):
        sight, crowd = person(side, shoulder + way)
        found = way_of(sight, crowd)
        np.testing.assert_allclose(found.now, (way @ TO_ROBOT, way @ out, way @ UP), atol=1e-9)
        assert found.doubt == doubt


def test_a_hand_has_to_be_raised_for_a_while() -> None:
    hand = SHOULDER_M["right"] + 0.45 * TO_ROBOT
    for raised_s, refusal in ((0.2, WATCHED), (0.3, "")):
        sight, crowd = person("right", hand, raised_s)
        assert start_refusal(sight, crowd, 1.0, True, SETTINGS, np.array([0.05, -0.07, 0.41]), 0) == refusal


@pytest.mark.parametrize(("still_s", "following_s", "near_m", "ends"), [
    (4.0, 3.5, 1.0, True),
    (4.0, 2.0, 1.0, False),  # the robot needs time to come near a hand that waits for it
    (2.0, 5.0, 1.0, False),
    (4.0, 3.5, 0.1, False),  # hands are together
])  # fmt: skip
def test_a_still_hand_ends_an_interaction_once_the_robot_had_time(
    still_s: float, following_s: float, near_m: float, ends: bool
) -> None:
    sight, _ = person("right", SHOULDER_M["right"] + 0.45 * TO_ROBOT, still_s)
    since_ns = round(-following_s * SECOND_NS)
    state = RetargetingState(mode=Mode.FOLLOWING, sight=sight, since_ns=since_ns, near_m=near_m)
    assert (with_rest(state, SETTINGS, 0).counts.get("ended_still", 0) == 1) is ends

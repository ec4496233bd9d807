# SPDX-License-Identifier: Apache-2.0
"""A hand that is held out and not met: why, in counts and in words; and people who are where no people are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mild_core.retargeting.camera_doubt import BEHIND, INSIDE, UPSIDE_DOWN
from mild_core.retargeting.modes import Mode
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import NEVER, Retargeting, RetargetingSettings
from mild_core.retargeting.start_gate import ASIDE, FAR, UNDECIDED, WATCHED
from mild_core.retargeting.unmet import (
    FAST,
    GUARDED,
    LIMITS,
    NO_TOUCH,
    NOT_MEANT,
    OUT_OF_REACH,
    TEXTS,
    UNKNOWN,
    not_followed,
    not_reached,
)
from test.core.retargeting.run import AWAY
from test.core.retargeting.test_people import MET_M, REST_M, STANDING, TO_ROBOT, Around


def said(run: Around) -> str:
    """What is said of the hand that is held out; at most one thing."""
    found = [notice for notice in run.state.notices(run.now_ns) if notice.startswith("hand not met: ")]
    assert len(found) <= 1
    return found[0].removeprefix("hand not met: ") if found else ""


def held_out(run: Around, hand_m: np.ndarray = MET_M, seconds: float = 3.0, **fields: object) -> Around:
    run.live(0.5)
    run.live(seconds, hand_m, AWAY, **fields)  # type: ignore[arg-type]
    return run


def test_nothing_is_said_of_hands_that_meet_or_rest() -> None:
    run = held_out(Around())
    assert said(run) == run.state.unmet == ""
    assert run.state.touch is not None
    run = held_out(Around(), REST_M)
    assert said(run) == ""


def test_a_hand_beyond_the_arm_is_out_of_reach_until_it_is_taken_back() -> None:
    run = held_out(Around(), np.array([0.85, -0.3, 0.0]))
    assert said(run) == TEXTS[OUT_OF_REACH]
    assert run.state.counts[OUT_OF_REACH] == 1
    run.live(2.0, REST_M)
    assert said(run) == ""


def test_a_hand_in_an_interaction_without_touch_is_said_to_be_so() -> None:
    run = held_out(Around(), interaction="hand_wave")
    assert said(run) == "", "that is as it should be"
    assert run.state.counts[NO_TOUCH] == 1


def test_a_motion_that_is_unknown_meets_no_hand() -> None:
    run = held_out(Around(), out_of_distribution=1.5)
    assert run.state.mode is not Mode.FOLLOWING
    assert said(run) == TEXTS[UNKNOWN]


def test_a_person_who_faces_elsewhere_is_not_met() -> None:
    run = Around()
    run.facing = -TO_ROBOT
    assert said(held_out(run)) == TEXTS[NOT_MEANT]


def test_an_arm_that_follows_and_does_not_come_there_is_late_or_held_back() -> None:
    free = {"beyond": False, "pushed": False, "yielding": False, "refusals": (), "hand_m_s": 0.0}
    for change, why in (
        ({}, LIMITS),
        ({"hand_m_s": 0.6}, FAST),
        ({"beyond": True}, OUT_OF_REACH),
        ({"pushed": True, "beyond": True}, GUARDED),
        ({"yielding": True}, GUARDED),
        ({"refusals": ("refused_keep_out",), "beyond": True}, GUARDED),
        ({"refusals": ("refused_speed",)}, GUARDED),
    ):
        assert not_reached(**(free | change)) == why, change  # type: ignore[arg-type]
    refusals = {
        "": UNKNOWN,
        UNDECIDED: UNKNOWN,
        FAR: OUT_OF_REACH,
        ASIDE: NOT_MEANT,
        WATCHED: "",
    }
    assert {name: not_followed(name) for name in refusals} == refusals


def test_a_model_in_which_hands_never_touch_says_so_at_the_start() -> None:
    standing = replace(STANDING, contact=())
    assert Retargeting(YUMI, RetargetingSettings(), standing, True).init().notices(0) == (f"no contact: {NEVER}",)
    assert Retargeting(YUMI, RetargetingSettings(ik="off"), standing, True).init().notices(0) == ()


def test_hands_touch_where_the_model_says_so_without_a_place_of_the_interaction() -> None:
    run = Around()
    run.retargeting = Retargeting(
        YUMI, RetargetingSettings(), replace(STANDING, by_interaction={}, contact=("handshake",))
    )
    assert held_out(run).state.touch is not None


@pytest.mark.parametrize("ik", ["blend", "only"])
def test_a_hand_that_is_held_out_anywhere_within_reach_is_met_from_home(ik: str) -> None:
    run = Around(RetargetingSettings(ik=ik))  # type: ignore[arg-type]
    hand_m = MET_M + np.array([0.0, -0.12, 0.02])
    run.live(0.5)
    run.live(4.0, hand_m, YUMI.home_rad)  # the learned motion stays at home
    assert run.state.touch is not None
    assert run.state.touch.apart_m < 0.02


@pytest.mark.parametrize(("place", "said"), [("turned", UPSIDE_DOWN), ("inside", INSIDE), ("behind", BEHIND)])
def test_a_person_where_no_person_can_be_shows_a_wrong_camera_pose(place: str, said: str) -> None:
    run = Around()
    seen = run.seen

    def moved(hand_m: np.ndarray, others: object = None) -> object:
        pose = seen(hand_m)
        middle = pose.trunk_m.mean(axis=0)
        shift = {
            "turned": np.zeros(3),
            "inside": np.array([0.05, -0.07, 0.4]) - middle,
            "behind": np.array([-2.0, 0, 0]),
        }
        turn = np.diag([1.0, -1.0, -1.0]) if place == "turned" else np.eye(3)

        def put(points_m: np.ndarray) -> np.ndarray:
            return (points_m - middle) @ turn + middle + shift[place]

        own = replace(pose.segments, ends_m=put(pose.segments.ends_m))
        parts = {name: put(getattr(pose, name)) for name in ("hand_m", "head_m", "trunk_m")}
        return replace(pose, segments=own, **parts)

    run.seen = moved  # type: ignore[method-assign, assignment]
    run.live(0.5)
    assert any(said in notice for notice in run.state.notices(run.now_ns))
    run.seen = seen  # type: ignore[method-assign]
    run.live(3.0)
    assert not any(said in notice for notice in run.state.notices(run.now_ns))

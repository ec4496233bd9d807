# SPDX-License-Identifier: Apache-2.0
"""How a learned hand gives way to the person's: by distance, at a bounded pace, by precision, and how it lets go."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mild_core.retargeting.contact import (
    ARRIVING_M,
    FAR_M,
    IN_HAND_M,
    NEAR_M,
    OVER_S,
    SEEN_TO_M,
    SOFT,
    STANDING_TO_M,
    Contact,
    ContactState,
    smooth,
    stiffness,
)
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robots.yumi import YUMI

CHAIN = chain_of(YUMI)
LEARNED = np.clip(YUMI.home_rad + 0.2, YUMI.lower_rad + 0.1, YUMI.upper_rad - 0.1)
TOOL_M = CHAIN.tool(LEARNED)
SURE, TICK_S = np.zeros((7, 7)), 0.01


@pytest.fixture(name="contact", scope="module")
def _contact() -> Contact:
    return Contact(YUMI, "blend", 0.01)


def aimed(
    contact: Contact,
    hand_m: np.ndarray | None,
    seconds: float,
    covariance: np.ndarray = SURE,
    offered: bool = True,
    before: ContactState | None = None,
    learned: np.ndarray = LEARNED,
) -> tuple[np.ndarray, ContactState | None]:
    """The joints and what they touch after a while in which the robot is where it was sent."""
    joints, touch = learned, before
    for _ in range(round(seconds / TICK_S)):
        joints, touch = contact.aim(learned, covariance, hand_m, offered, touch, joints, TICK_S)
    return joints, touch


def beside(metres: float) -> np.ndarray:
    return TOOL_M + metres * np.array([0.0, 1.0, 0.0])


def test_a_share_goes_from_zero_to_one_without_a_corner() -> None:
    assert [smooth(x) for x in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    shares = np.array([smooth(x) for x in np.linspace(0.0, 1.0, 101)])
    assert (np.diff(shares) > 0.0).all()
    assert shares[1] < 0.001
    assert smooth(0.25) == pytest.approx(3 * 0.25**2 - 2 * 0.25**3)


@pytest.mark.parametrize(
    ("share", "apart_m", "wanted"),
    [
        (1.0, IN_HAND_M, SOFT),
        (1.0, 0.0, SOFT),
        (1.0, ARRIVING_M, 1.0),
        (1.0, math.inf, 1.0),
        (0.5, 0.0, (1.0 + SOFT) / 2.0),
        (1.0, (IN_HAND_M + ARRIVING_M) / 2.0, (1.0 + SOFT) / 2.0),
        (0.0, 0.0, 1.0),
    ],
)
def test_the_arm_is_soft_where_hands_touch_and_stiff_where_it_reaches(share, apart_m, wanted) -> None:
    assert stiffness(ContactState(share, (0.0,) * 7, (0.0,) * 3, apart_m)) == pytest.approx(wanted)
    assert stiffness(None) == 1.0


@pytest.mark.parametrize(("apart_m", "share"), [(FAR_M + 0.01, 0.0), (0.25, 0.5), (NEAR_M - 0.01, 1.0)])
def test_the_nearer_the_learned_hand_the_more_the_person_s_counts(contact, apart_m, share) -> None:
    _, touch = contact.aim(LEARNED, SURE, beside(apart_m), False, None, LEARNED, 10.0)
    assert (touch.share if touch else 0.0) == pytest.approx(share, abs=1e-6)


def test_both_hands_of_the_robot_have_to_be_near_before_they_meet(contact) -> None:
    """The robot's own hand may have to catch up with the learned one."""
    elsewhere = np.clip(YUMI.home_rad - 0.4, YUMI.lower_rad + 0.05, YUMI.upper_rad - 0.05)
    assert math.dist(CHAIN.tool(elsewhere), beside(0.05)) > FAR_M
    assert contact.aim(LEARNED, SURE, beside(0.05), True, None, elsewhere, 10.0)[1] is None


@pytest.mark.parametrize(
    ("metres", "offered", "waits", "met"),
    [(0.35, True, True, True), (0.35, True, False, False), (0.35, False, True, False), (0.9, True, True, False)],
)
def test_a_hand_that_waits_within_reach_is_met_wherever_it_is(contact, metres, offered, waits, met) -> None:
    """Strangers hold their hands out where none of the model's people did."""
    hand_m, joints, touch = beside(metres), LEARNED, None
    assert metres > FAR_M
    for _ in range(100):
        joints, touch = contact.aim(LEARNED, SURE, hand_m, offered, touch, joints, TICK_S, waits=waits)
    assert (touch is not None) is met
    if met:
        assert math.dist(CHAIN.tool(joints), hand_m) < 0.02


def test_the_share_takes_its_time(contact) -> None:
    joints, touch, shares = LEARNED, None, []
    for _ in range(60):
        joints, touch = contact.aim(LEARNED, SURE, beside(0.05), True, touch, joints, TICK_S)
        shares.append(touch.share)
    assert np.diff(shares).max() <= TICK_S / OVER_S + 1e-9
    assert shares[0] == pytest.approx(TICK_S / OVER_S)
    assert shares[-1] == 1.0


@pytest.mark.parametrize("spread_m2", [0.0, 0.01, 1.0])
def test_met_hands_lie_at_the_mean_that_their_precisions_ask_for(contact, spread_m2) -> None:
    """Two measurements of one place: their mean is weighted by the inverse of each variance."""
    jacobian = CHAIN.jacobian(LEARNED)
    spread = np.trace(jacobian @ jacobian.T) / 3.0
    covariance = np.eye(7) * spread_m2 / spread
    learned = STANDING_TO_M**2 + spread_m2
    trust = learned / (learned + SEEN_TO_M**2)
    joints, touch = aimed(contact, beside(0.08), 2.0, covariance)
    assert touch is not None
    np.testing.assert_allclose(touch.gap_m, trust * np.array([0.0, 0.08, 0.0]), atol=1e-6)
    np.testing.assert_allclose(CHAIN.tool(joints), beside(0.08 * trust), atol=2e-3)
    assert touch.apart_m == pytest.approx(math.dist(CHAIN.tool(joints), beside(0.08)), abs=2e-3)


def test_a_partner_s_arm_is_as_sure_of_its_hand_as_the_last_three_of_its_nine_values(contact) -> None:
    covariance = np.diag([9.0] * 6 + [0.01] * 3)
    trust = (STANDING_TO_M**2 + 0.01) / (STANDING_TO_M**2 + 0.01 + SEEN_TO_M**2)
    _, touch = aimed(contact, beside(0.08), 1.0, covariance)
    assert touch.gap_m[1] == pytest.approx(trust * 0.08)


def test_hands_that_have_met_stay_together_while_the_person_s_is_offered_and_part_when_it_is_not(contact) -> None:
    _, met = aimed(contact, beside(0.05), 1.0)
    away = np.clip(LEARNED + 0.35, YUMI.lower_rad + 0.05, YUMI.upper_rad - 0.05)
    assert math.dist(CHAIN.tool(away), beside(0.05)) > FAR_M
    _, kept = aimed(contact, beside(0.05), 0.5, before=met, learned=away)
    assert kept is not None
    assert kept.share == 1.0
    _, parting = aimed(contact, beside(0.05), 0.1, offered=False, before=met, learned=away)
    assert parting is not None
    assert parting.withdrawn
    assert parting.share < 1.0
    assert parting.gap_m == met.gap_m  # it is not followed
    assert aimed(contact, beside(0.05), 0.5, offered=False, before=met, learned=away)[1] is None


def test_a_hand_that_is_lost_draws_on_ever_less(contact) -> None:
    _, met = aimed(contact, beside(0.05), 1.0)
    _, fading = aimed(contact, None, 0.1, before=met)
    assert fading is not None
    assert fading.share == pytest.approx(1.0 - 0.1 / OVER_S, abs=1e-6)
    assert fading.gap_m == met.gap_m
    assert fading.apart_m == math.inf
    joints, gone = aimed(contact, None, 1.0, before=met)
    assert gone is None
    np.testing.assert_array_equal(joints, LEARNED)


def test_a_hand_out_of_reach_is_reached_for_and_no_further(contact) -> None:
    shoulder = CHAIN.offsets[0][:3, 3]
    tried = np.random.default_rng(0).uniform(YUMI.lower_rad, YUMI.upper_rad, (300, 7))
    reach_m = max(math.dist(shoulder, CHAIN.tool(pose)) for pose in tried)
    outward = (TOOL_M - shoulder) / math.dist(TOOL_M, shoulder)
    assert math.dist(contact._within(shoulder + 3.0 * outward), shoulder) == pytest.approx(reach_m, rel=0.1)
    np.testing.assert_allclose(np.cross(contact._within(shoulder + 3.0 * outward) - shoulder, outward), 0.0, atol=1e-12)
    np.testing.assert_array_equal(contact._within(TOOL_M), TOOL_M)


def test_without_learned_motion_a_hand_at_the_end_of_the_arm_is_met_too() -> None:
    only = Contact(YUMI, "only", 0.01)
    shoulder = CHAIN.offsets[0][:3, 3]
    outward = (TOOL_M - shoulder) / math.dist(TOOL_M, shoulder)
    _, touch = only.aim(LEARNED, SURE, shoulder + (only._reach_m - 0.02) * outward, True, None, YUMI.home_rad, 10.0)
    assert touch is not None
    assert touch.share == 1.0
    beyond = shoulder + (only._reach_m + FAR_M) * outward
    assert only.aim(LEARNED, SURE, beyond, True, None, YUMI.home_rad, 10.0)[1] is None


def test_a_posture_that_is_given_up_gives_way_to_that_of_home_and_the_hand_stays(contact) -> None:
    elbows = []
    for relaxed in (0.0, 1.0):
        joints, touch = LEARNED, None
        for _ in range(200):
            joints, touch = contact.aim(LEARNED, SURE, beside(0.05), True, touch, joints, TICK_S, relaxed=relaxed)
        assert math.dist(CHAIN.tool(joints), beside(0.05)) < 0.01
        elbows.append(float(np.linalg.norm(joints - YUMI.home_rad)))
    assert elbows[1] < 0.9 * elbows[0]

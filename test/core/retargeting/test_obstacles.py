# SPDX-License-Identifier: Apache-2.0
"""Everyone in view as the robot has to respect them: where they will be, how unsure that is, what is kept from whom."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mild_core.retargeting.human_track import AssumedPlacement
from mild_core.retargeting.obstacles import (
    AGED_M_S,
    AGED_MOST_M,
    AGED_S,
    HORIZON_S,
    KEPT_S,
    NO_ONE,
    TOUCHED_M,
    ZONE_MARGIN_M,
    Crowd,
    Obstacles,
    obstacles_of,
)
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.signals import ARM_FRAME, ROBOT_FRAME, UNKNOWN_DIRECTION, BodySegments
from test.core.retargeting.people import body_ends, segments

SETTINGS = RetargetingSettings(look_ahead_s=0.05)
START_NS = 1_700_000_000_000_000_000
NOWHERE = np.full(3, np.nan)
HAND = np.array([0.5, 0.0, 0.3])
WATCHED = body_ends(HAND, np.array([0.9, 0.15, 0.7]), np.array([0.9, 0.15, 0.4]), np.array([0.9, 0.15, -0.1]))
OTHER = body_ends(HAND + 1.0, np.array([1.9, 1.15, 1.7]), np.array([1.9, 1.15, 1.4]), np.array([1.9, 1.15, 0.9]))
VELOCITY = np.array([-0.5, 0.2, 0.0])


def crowd(frame_id: str = ROBOT_FRAME, known: BodySegments | None = None) -> Crowd:
    known = segments([(0, WATCHED), (3, OTHER)], VELOCITY) if known is None else known
    return Crowd(known, frame_id, START_NS, UNKNOWN_DIRECTION)


def after(
    age_s: float, seen: Crowd | None = None, standing: AssumedPlacement | None = None, hand: np.ndarray = NOWHERE
) -> Obstacles:
    return obstacles_of(seen or crowd(), SETTINGS, standing, None, hand, START_NS + round(age_s * 1e9))


@pytest.mark.parametrize("age_s", [0.0, 0.1, 0.3, 2.0])
def test_everyone_goes_on_until_the_command_is_carried_out_and_no_longer_than_the_horizon(age_s: float) -> None:
    seen, found = crowd().segments, after(age_s)
    ahead_s = min(age_s + 0.05, HORIZON_S)
    np.testing.assert_allclose(found.ends_m, seen.ends_m + ahead_s * VELOCITY, atol=1e-6)
    assert found.horizon_s == pytest.approx(max(0.0, HORIZON_S - ahead_s))
    np.testing.assert_allclose(found.speeds_m_s, np.linalg.norm(VELOCITY))
    assert (found.people, found.parts) == (seen.people, seen.parts)


@pytest.mark.parametrize("age_s", [0.0, AGED_S, 0.5, 4.0])
def test_the_longer_ago_a_person_was_seen_the_more_room_they_get(age_s: float) -> None:
    wider = min(max(age_s - AGED_S, 0.0) * AGED_M_S, AGED_MOST_M)
    np.testing.assert_allclose(after(age_s).radii_m, crowd().segments.radii_m + wider, atol=1e-6)


def test_after_long_enough_a_missing_person_is_gone() -> None:
    assert len(after(KEPT_S - 0.01).people) == 22
    assert after(KEPT_S + 0.01) is NO_ONE
    assert obstacles_of(None, SETTINGS, None, None, NOWHERE, START_NS) is NO_ONE


def test_what_is_kept_from_everyone_alike_where_the_camera_is_known() -> None:
    found = after(0.0)
    np.testing.assert_allclose(found.keep_m, SETTINGS.keep_out_m)
    np.testing.assert_allclose(found.zones_m, SETTINGS.near_m + ZONE_MARGIN_M)


def test_people_whose_place_is_a_guess_are_placed_and_kept_from_by_all_that_it_may_be_off() -> None:
    standing = AssumedPlacement((1.0, 0.2, 0.6), math.pi / 2)
    found = after(0.0, crowd(ARM_FRAME), standing)
    given = crowd().segments
    wanted = standing.placed(given.ends_m + 0.05 * VELOCITY, ARM_FRAME, standing.place_m)
    np.testing.assert_allclose(found.ends_m, wanted, atol=1e-9)
    # A velocity has a direction and no place: yaw turns x towards y.
    np.testing.assert_allclose(found.velocities_m_s[0, 0], [-VELOCITY[1], VELOCITY[0], 0.0], atol=1e-9)
    np.testing.assert_allclose(found.keep_m, SETTINGS.keep_out_m + SETTINGS.placement_uncertainty_m)
    np.testing.assert_allclose(found.zones_m, SETTINGS.near_m + ZONE_MARGIN_M + SETTINGS.placement_uncertainty_m)
    assert after(0.0, crowd(ARM_FRAME)) is NO_ONE
    moved = obstacles_of(crowd(ARM_FRAME), SETTINGS, standing, (0.5, 0.2, 0.6), NOWHERE, START_NS)
    np.testing.assert_allclose(moved.ends_m - found.ends_m, np.broadcast_to([-0.5, 0.0, 0.0], moved.ends_m.shape))


def test_people_whose_place_is_a_guess_stand_at_every_place_of_the_model() -> None:
    standing = AssumedPlacement((1.0, 0.2, 0.6), math.pi, {"handshake": (0.9, 0.1, 0.7), "rocket": (0.8, 0.0, 0.9)})
    given, count = crowd(ARM_FRAME), 22
    found = obstacles_of(given, SETTINGS, standing, (0.9, 0.1, 0.7), NOWHERE, START_NS)
    assert len(found.people) == 2 * count
    assert found.people == 2 * given.segments.people
    assert found.parts == 2 * given.segments.parts
    away = np.broadcast_to([-0.1, -0.1, 0.2], (count, 2, 3))
    np.testing.assert_allclose(found.ends_m[count:] - found.ends_m[:count], away, atol=1e-9)
    assert len(obstacles_of(given, SETTINGS, standing, None, NOWHERE, START_NS).people) == 3 * count
    # On a mark, or seen by a measured camera, they stand in one place.
    marked = replace(SETTINGS, allow_unmeasured_contact=True)
    assert len(obstacles_of(given, marked, standing, None, NOWHERE, START_NS).people) == count
    assert len(obstacles_of(crowd(), SETTINGS, standing, None, NOWHERE, START_NS).people) == count


def test_only_the_watched_forearm_with_the_hand_in_it_may_be_touched() -> None:
    still = crowd(known=segments([(3, OTHER), (0, WATCHED)]))
    found = after(0.0, still, hand=HAND)
    place = found.offered
    assert (found.people[place], found.parts[place]) == (0, "right_forearm")
    touchable = found.touchable()
    assert touchable.keep_m[place] == -np.inf
    others = np.arange(len(found.people)) != place
    np.testing.assert_array_equal(touchable.keep_m[others], found.keep_m[others])
    assert not found.is_bystander(place)
    assert found.is_bystander(0)
    assert not found.is_bystander(-1)


@pytest.mark.parametrize("hand", [NOWHERE, HAND + np.array([0.0, TOUCHED_M + 0.2, 0.0]), OTHER["right_forearm"][1]])
def test_a_hand_that_is_unknown_far_from_the_forearm_or_another_person_s_is_not_touched(hand: np.ndarray) -> None:
    found = after(0.0, crowd(known=segments([(0, WATCHED), (3, OTHER)])), hand=hand)
    assert found.offered == -1
    assert found.touchable() is found
    assert np.isfinite(found.keep_m).all()

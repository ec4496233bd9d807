# SPDX-License-Identifier: Apache-2.0
"""Where a person stands before the robot, and what their hand does: tracked, raised, offered, withdrawn, back, lost."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mild_core.errors import DataError
from mild_core.retargeting.human_track import (
    BACK_AFTER_S,
    BACK_M,
    GONE_S,
    LONGEST_GUESS_S,
    LOST_S,
    OFFERED,
    RAISED_M,
    AssumedPlacement,
    HumanTrack,
    check_pose,
    first_sight,
    seen_again,
)
from mild_core.signals import ARM_FRAME, ROBOT_FRAME, PersonPose

RATE_HZ, START_NS = 30.0, 1_700_000_000_000_000_000
NOWHERE = np.full(3, np.nan)


def pose(time_s: float, hand_m: np.ndarray | tuple[float, ...], frame_id: str = ARM_FRAME) -> PersonPose:
    head, trunk = np.array([0.0, 0.2, 0.2]), np.array([[0.0, 0.2, 0.0], [0.0, 0.2, -0.5]])
    return PersonPose(START_NS + round(time_s * 1e9), frame_id, np.array(hand_m, dtype=float), head, trunk)


def tracked(hand: object, seconds: float, sight: HumanTrack | None = None, start_s: float = 0.0) -> HumanTrack:
    """The track after a hand went its way `hand(time)` for a while."""
    for frame in range(round(seconds * RATE_HZ)):
        time_s = start_s + frame / RATE_HZ
        given = pose(time_s, hand(time_s))  # type: ignore[operator]
        sight = seen_again(sight, given, given.stamp_ns)
    assert sight is not None
    return sight


def along(axis: int, metres: float) -> np.ndarray:
    found = np.zeros(3)
    found[axis] = metres
    return found


@pytest.mark.parametrize("yaw_rad", [0.0, 0.5, -2.0, math.pi])
def test_a_person_faces_the_way_their_yaw_says(yaw_rad: float) -> None:
    """REP-103: a yaw turns x towards y, so what is before the person lies at that angle from the robot's x axis."""
    place = (0.9, -0.2, 0.6)
    standing = AssumedPlacement(place, yaw_rad)
    ahead, left, up = (standing.placed(one, ARM_FRAME, place) - place for one in np.eye(3))
    np.testing.assert_allclose(ahead, [math.cos(yaw_rad), math.sin(yaw_rad), 0.0], atol=1e-12)
    np.testing.assert_allclose(left, [-math.sin(yaw_rad), math.cos(yaw_rad), 0.0], atol=1e-12)
    np.testing.assert_allclose(up, [0.0, 0.0, 1.0], atol=1e-12)
    several = np.random.default_rng(0).normal(size=(2, 4, 3))
    np.testing.assert_allclose(
        standing.placed(several, ARM_FRAME, place)[1, 2], standing.placed(several[1, 2], ARM_FRAME, place)
    )
    np.testing.assert_array_equal(standing.placed(several, ROBOT_FRAME, place), several)


def test_recognition_moves_a_person_no_further_than_people_move() -> None:
    standing = AssumedPlacement((1.0, 0.0, 0.7), 0.0, {"handshake": (0.4, 0.8, 0.7)})
    assert standing.place("handshake", None, 0.1) == (0.4, 0.8, 0.7)
    assert standing.place("hand_wave", None, 0.1) == (1.0, 0.0, 0.7)
    # From one to the other is a metre, along (-0.6, 0.8).
    np.testing.assert_allclose(standing.place("handshake", (1.0, 0.0, 0.7), 0.1), (0.94, 0.08, 0.7))
    assert standing.place("handshake", (1.0, 0.0, 0.7), 1.1) == (0.4, 0.8, 0.7)
    assert standing.place("handshake", (1.0, 0.0, 0.7), math.inf) == (0.4, 0.8, 0.7)


def test_a_hand_at_one_speed_is_followed_without_a_lag() -> None:
    velocity = np.array([0.4, -0.3, 0.5])
    sight = tracked(lambda time_s: velocity * time_s, 1.0)
    last_s = (sight.hand_ns - START_NS) * 1e-9
    np.testing.assert_allclose(sight.hand_m, velocity * last_s, atol=1e-3)
    np.testing.assert_allclose(sight.velocity_m_s, velocity, atol=1e-2)


def test_a_hand_is_guessed_on_at_its_speed_for_a_moment_and_never_back() -> None:
    sight = tracked(lambda time_s: along(0, 0.5 * time_s), 1.0)
    speed = sight.velocity_m_s[0]
    for ahead_s, guessed_s in ((0.05, 0.05), (LONGEST_GUESS_S + 1.0, LONGEST_GUESS_S), (-0.5, 0.0)):
        moved = sight.hand_at(sight.hand_ns + round(ahead_s * 1e9)) - sight.hand_m
        np.testing.assert_allclose(moved, along(0, speed * guessed_s), atol=1e-9)


def test_jitter_of_a_still_hand_is_smoothed() -> None:
    rng = np.random.default_rng(1)
    sight, errors = tracked(lambda _: np.zeros(3), 0.1), []
    for frame in range(200):
        given = pose(0.2 + frame / RATE_HZ, 0.005 * rng.normal(size=3))
        sight = seen_again(sight, given, given.stamp_ns)
        errors.append((sight.hand_m, sight.velocity_m_s))
    place, velocity = np.array(errors).swapaxes(0, 1).std(axis=1)
    assert place.max() < 0.005
    assert velocity.max() < 0.11


@pytest.mark.parametrize(("away_m", "raised"), [(RAISED_M - 0.01, False), (RAISED_M + 0.01, True)])
def test_a_hand_is_raised_where_it_has_left_its_rest(away_m: float, raised: bool) -> None:
    sight = tracked(lambda time_s: along(2, min(4.0 * time_s, 1.0) * away_m), 0.5)
    assert sight.raised == raised
    if raised:
        assert sight.farthest_m == pytest.approx(away_m, abs=5e-3)
    np.testing.assert_array_equal(sight.rest_m, np.zeros(3))


@pytest.mark.parametrize(
    ("away_m", "seconds", "back"),
    [
        (BACK_M - 0.02, BACK_AFTER_S + 0.3, True),
        (BACK_M - 0.02, BACK_AFTER_S - 0.15, False),
        (BACK_M + 0.02, BACK_AFTER_S + 1.0, False),
    ],
)
def test_a_hand_is_back_once_it_has_stayed_near_its_rest(away_m: float, seconds: float, back: bool) -> None:
    up = tracked(lambda time_s: along(2, 0.5 * min(time_s, 1.0)), 1.5)
    assert up.raised
    sight = tracked(lambda _: along(2, away_m), seconds, up, 1.5)
    assert sight.raised != back
    if back:  # it rests where it is now, and leaves that place next time
        np.testing.assert_allclose(sight.rest_m, along(2, away_m), atol=0.01)
        assert sight.farthest_m == 0.0


def test_a_hand_that_moves_about_near_its_rest_is_not_back() -> None:
    up = tracked(lambda time_s: along(2, 0.5 * min(time_s, 1.0)), 1.5)
    sight = tracked(lambda time_s: 0.1 * np.array([math.cos(6 * time_s), math.sin(6 * time_s), 0]), 2.0, up, 1.5)
    assert sight.raised


def test_how_long_a_hand_has_been_still_counts_from_where_it_last_moved() -> None:
    sight = tracked(lambda time_s: along(0, min(time_s, 1.0)), 3.0)
    assert sight.still_s() == pytest.approx(2.0, abs=0.1)
    np.testing.assert_allclose(sight.still_m, along(0, 1.0), atol=0.051)


def test_a_hand_that_is_held_out_is_offered_and_one_on_its_way_back_is_not() -> None:
    out = tracked(lambda time_s: along(0, 0.5 * min(time_s, 1.0)), 2.0)
    assert out.offered()
    assert not tracked(lambda _: np.zeros(3), 1.0).offered()
    # Drawn back at 1 m/s it would soon be nearer to its rest than the share of the way that counts as offered.
    withdrawn = tracked(lambda time_s: along(0, 0.5 - 1.0 * (time_s - 2.0)), 0.1, out, 2.0 + 1 / RATE_HZ)
    assert withdrawn.hand_m[0] > OFFERED * out.farthest_m
    assert not withdrawn.offered()
    lower = tracked(lambda _: along(0, 0.9 * 0.5), 1.0, out, 2.0 + 1 / RATE_HZ)
    assert lower.offered()


def test_a_hidden_hand_stays_where_it_was_and_its_person_is_still_there() -> None:
    sight = tracked(lambda time_s: along(0, 0.5 * time_s), 1.0)
    hidden = pose(1.1, NOWHERE)
    after = seen_again(sight, hidden, hidden.stamp_ns)
    assert after is not None
    assert (after.received_ns, after.hand_ns) == (hidden.stamp_ns, sight.hand_ns)
    np.testing.assert_array_equal(after.hand_m, sight.hand_m)
    assert first_sight(hidden, hidden.stamp_ns) is None


@pytest.mark.parametrize(
    ("away_s", "goes_on", "same"),
    [(LOST_S - 0.1, True, True), (LOST_S + 0.1, False, True), (GONE_S + 0.1, False, False)],
)
def test_a_hand_that_was_lost_has_no_speed_and_after_longer_no_rest(away_s: float, goes_on: bool, same: bool) -> None:
    sight = tracked(lambda time_s: along(0, 0.5 * time_s), 1.0)
    last_s = (sight.hand_ns - START_NS) * 1e-9
    again = pose(last_s + away_s, along(0, 0.5 * (last_s + away_s)))
    after = seen_again(sight, again, again.stamp_ns)
    assert after is not None
    assert (after.velocity_m_s[0] > 0.4) == goes_on
    assert after.raised == same
    np.testing.assert_allclose(after.rest_m, sight.rest_m if same else after.hand_m)


@pytest.mark.parametrize(("time_s", "frame_id"), [(1.1, ROBOT_FRAME), (0.2, ARM_FRAME)])
def test_another_frame_or_a_time_before_begin_with_a_new_person(time_s: float, frame_id: str) -> None:
    sight = tracked(lambda time_s: along(0, 0.5 * time_s), 1.0)
    other = pose(time_s, (3.0, 0.0, 0.0), frame_id)
    after = seen_again(sight, other, other.stamp_ns)
    assert after is not None
    assert not after.raised
    assert after.frame_id == frame_id
    np.testing.assert_array_equal(after.rest_m, [3.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("given", "reason"),
    [(pose(0.0, (math.inf, 0.0, 0.0)), "not_finite"), (pose(0.0, (0.0, 0.0, 0.0), "camera"), "unknown_frame")],
)
def test_a_pose_that_cannot_be_used_is_refused_by_its_reason(given: PersonPose, reason: str) -> None:
    with pytest.raises(DataError) as refused:
        check_pose(given)
    assert refused.value.reason == reason
    check_pose(pose(0.0, NOWHERE))


def noisy(noise_m: float, seed: int, moves: object) -> list[HumanTrack]:
    """Tracks of a hand that rests for two seconds and then is where `moves(time)` says, seen with noise."""
    rng, sight, found = np.random.default_rng(seed), None, []
    for frame in range(round(4.0 * RATE_HZ)):
        time_s = frame / RATE_HZ
        hand = np.zeros(3) if time_s < 2.0 else moves(time_s - 2.0)  # type: ignore[operator]
        given = pose(time_s, hand + noise_m * rng.normal(size=3))
        sight = seen_again(sight, given, given.stamp_ns)
        assert sight is not None
        found.append(sight)
    return found


@pytest.mark.parametrize("noise_m", [0.005, 0.01, 0.02])
def test_a_still_hand_is_where_it_is_on_the_mean(noise_m: float) -> None:
    place = np.array([0.3, 0.1, 0.4])
    tracks = [each for seed in range(5) for each in noisy(noise_m, seed, lambda t: min(t / 0.5, 1.0) * place)[90:]]
    off = np.array([each.hand_at(each.hand_ns + 40_000_000) - place for each in tracks])
    assert np.sqrt((off**2).mean()) < 0.6 * noise_m
    assert np.mean([each.noise_m for each in tracks]) == pytest.approx(noise_m, rel=0.4)


def test_a_hand_that_starts_to_move_is_followed_at_once() -> None:
    """Half a metre per second, from the mean of 0.4 s of rest, with 1 cm of noise."""
    place = np.array([0.4, 0.0, 0.3])

    def moves(time_s: float) -> np.ndarray:
        return min(time_s / 0.4, 1.0) * place + max(time_s - 1.0, 0.0) * np.array([0.0, 0.5, 0.0])

    off = [
        np.linalg.norm(each.hand_m - moves(1.0 + frame / RATE_HZ))
        for seed in range(5)
        for frame, each in enumerate(noisy(0.01, seed, moves)[90:])
        if frame > 6
    ]
    assert np.mean(off) < 0.03
    clean = noisy(0.0, 0, moves)
    assert all(each.means <= 1 for each in (*clean[62:71], *clean[92:])), "without noise every motion is one"

# SPDX-License-Identifier: Apache-2.0
"""Every body in view as capsules: where its parts are, what is inferred of hidden ones, who is who, who is gone."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest

from mild_core.perception.bodies import (
    ADULT_M,
    COASTING_S,
    COINCIDING_M,
    DOUBTED_M,
    FACING_S,
    HIDDEN_M,
    HIDDEN_M_S,
    LANDMARKS,
    MISSING_M,
    MISSING_M_S,
    MOST_BODIES,
    NO_BODIES,
    RADII_M,
    RENUMBERED_M,
    TALLEST_M,
    TIP_FROM_HAND_M,
    TIP_FROM_WRIST_M,
    Bodies,
    Placing,
    body_segments,
    facing_of,
    followed,
)
from mild_core.perception.person_tracker import detection_of
from mild_core.signals import BODY_PARTS, NO_SEGMENTS, WATCHED_PERSON, BodySegments, SkeletonFrame

START_NS, PERIOD_S = 1_700_000_000_000_000_000, 1 / 30
UP = np.array([0.0, 0.0, 1.0])
HERE = Placing(np.eye(3), np.zeros(3), np.zeros(3))

# A standing adult by shares of the stature, facing +x: x forward, y left, z up from the floor.
STANDING = {
    "head": (0.02, 0.0, 0.915),
    "neck": (0.0, 0.0, 0.837),
    "left_shoulder": (0.0, 0.105, 0.82),
    "right_shoulder": (0.0, -0.105, 0.82),
    "left_elbow": (0.0, 0.12, 0.646),
    "right_elbow": (0.0, -0.12, 0.646),
    "left_hand": (0.06, 0.12, 0.46),
    "right_hand": (0.06, -0.12, 0.46),
    "pelvis": (0.0, 0.0, 0.54),
    "left_hip": (0.0, 0.055, 0.54),
    "right_hip": (0.0, -0.055, 0.54),
    "left_knee": (0.0, 0.055, 0.298),
    "right_knee": (0.0, -0.055, 0.298),
    "left_ankle": (0.0, 0.055, 0.055),
    "right_ankle": (0.0, -0.055, 0.055),
}
FAR = np.array([2.0, 0.5, 0.0])


def body(
    place_m: np.ndarray = FAR,
    yaw_rad: float = 0.0,
    stature_m: float = ADULT_M,
    joints: Iterable[str] = tuple(STANDING),
    moved: dict[str, tuple[float, ...]] | None = None,
) -> dict[str, np.ndarray]:
    """Joints of a person who stands there [m]; some of them elsewhere in the body's own axes."""
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    own = {name: stature_m * np.array(STANDING[name]) for name in joints}
    own |= {name: np.array(place) for name, place in (moved or {}).items()}
    return {name: place_m + turn @ point for name, point in own.items()}


def person(joints: dict[str, np.ndarray], time_s: float, number: int = 7, doubted: Iterable[str] = ()) -> SkeletonFrame:
    doubted = set(doubted)
    confidence = np.array([0.1 if name in doubted else 0.9 for name in joints])
    stamp_ns = START_NS + round(time_s * 1e9)
    return SkeletonFrame(stamp_ns, "camera", number, tuple(joints), np.array(list(joints.values())), confidence)


def after(
    before: Bodies, people: Iterable[SkeletonFrame], time_s: float, watched: int | None = 0, keep_s: float = 5.0
) -> Bodies:
    everyone = [detection_of(one) for one in people]
    who = everyone[watched] if watched is not None and everyone else None
    return followed(before, everyone, who, UP, 0.5, 0.5, keep_s, START_NS + round(time_s * 1e9))


def standing(seconds: float = 0.5, before: Bodies = NO_BODIES, start_s: float = 0.0, **how: object) -> Bodies:
    """One person who stands there for a while."""
    for frame in range(max(1, round(seconds / PERIOD_S))):
        time_s = start_s + frame * PERIOD_S
        before = after(before, [person(body(**how), time_s)], time_s)  # type: ignore[arg-type]
    return before


def parts(bodies: Bodies, number: int = WATCHED_PERSON, placing: Placing = HERE) -> dict[str, tuple]:
    """Ends, velocities and radius of each part of a person."""
    found = body_segments(bodies, placing, UP)
    each = zip(found.people, found.parts, found.ends_m, found.velocities_m_s, found.radii_m, strict=True)
    return {part: (ends, moving, radius) for who, part, ends, moving, radius in each if who == number}


@pytest.mark.parametrize("yaw_rad", [0.0, 2.0])
def test_every_part_lies_between_its_joints(yaw_rad: float) -> None:
    joints, found = body(yaw_rad=yaw_rad), parts(standing(yaw_rad=yaw_rad))
    assert tuple(found) == BODY_PARTS
    between = {
        "shoulders": ("left_shoulder", "right_shoulder"),
        "left_upper_arm": ("left_shoulder", "left_elbow"),
        "right_upper_arm": ("right_shoulder", "right_elbow"),
        "left_thigh": ("left_hip", "left_knee"),
        "right_thigh": ("right_hip", "right_knee"),
        "left_shin": ("left_knee", "left_ankle"),
        "right_shin": ("right_knee", "right_ankle"),
    }
    for part, names in between.items():
        np.testing.assert_allclose(found[part][0], [joints[name] for name in names], atol=1e-6)
    middle = [(joints[f"left_{name}"] + joints[f"right_{name}"]) / 2.0 for name in ("shoulder", "hip")]
    np.testing.assert_allclose(found["trunk"][0], middle, atol=1e-6)
    np.testing.assert_allclose(found["head"][0][0], joints["head"], atol=1e-6)
    assert 0.0 < found["head"][0][1, 2] - joints["head"][2] < 0.1
    for side in ("left", "right"):
        elbow, hand = joints[f"{side}_elbow"], joints[f"{side}_hand"]
        tip = hand + TIP_FROM_HAND_M * (hand - elbow) / np.linalg.norm(hand - elbow)
        np.testing.assert_allclose(found[f"{side}_forearm"][0], [elbow, tip], atol=2e-3)
    for place, part in enumerate(BODY_PARTS):
        assert found[part][2] == pytest.approx(RADII_M[place], rel=0.02)
        np.testing.assert_allclose(found[part][1], 0.0, atol=1e-6)


@pytest.mark.parametrize("stature_m", [1.1, 1.45, 2.0])
def test_a_body_is_as_thick_as_its_own_bones_are_long(stature_m: float) -> None:
    found = parts(standing(2.0, stature_m=stature_m))
    for part in ("trunk", "left_thigh", "right_forearm"):
        wanted = RADII_M[BODY_PARTS.index(part)] * stature_m / ADULT_M
        assert found[part][2] == pytest.approx(wanted, rel=0.03)
    least, most = 0.85 * RADII_M[0], 1.1 * RADII_M[0]
    assert found["head"][2] == pytest.approx(np.clip(RADII_M[0] * stature_m / ADULT_M, least, most), rel=0.03)


def test_no_bone_makes_a_giant() -> None:
    found = parts(standing(2.0, moved={"left_knee": (0.0, 0.1, 0.25), "left_hip": (0.0, 0.1, 1.0)}))
    assert found["trunk"][2] <= RADII_M[1] * TALLEST_M / ADULT_M + 0.01


def test_parts_of_a_walking_person_move_and_are_where_they_are() -> None:
    velocity, bodies = np.array([0.8, -0.5, 0.0]), NO_BODIES
    for frame in range(30):
        time_s = frame * PERIOD_S
        bodies = after(bodies, [person(body(FAR + time_s * velocity), time_s)], time_s)
    joints, found = body(FAR + 29 * PERIOD_S * velocity), parts(bodies)
    np.testing.assert_allclose(found["right_upper_arm"][0][1], joints["right_elbow"], atol=5e-3)
    for part in BODY_PARTS:
        np.testing.assert_allclose(found[part][1], np.tile(velocity, (2, 1)), atol=0.05)


def test_a_pose_s_frame_turns_places_and_velocities_and_moves_places_alone() -> None:
    velocity, bodies = np.array([0.8, 0.0, 0.0]), NO_BODIES
    for frame in range(30):
        time_s = frame * PERIOD_S
        bodies = after(bodies, [person(body(FAR + time_s * velocity), time_s)], time_s)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    placing = Placing(turn, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.5]))
    plain, moved = parts(bodies), parts(bodies, placing=placing)
    for part in BODY_PARTS:
        np.testing.assert_allclose(moved[part][0], placing.placed(plain[part][0]), atol=1e-9)
        np.testing.assert_allclose(moved[part][0], (plain[part][0] - [1, 0, 0]) @ turn.T + [0, 0, 0.5], atol=1e-9)
        np.testing.assert_allclose(moved[part][1], plain[part][1] @ turn.T, atol=1e-9)
        assert moved[part][2] == plain[part][2]


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, -2.5])
def test_a_chest_points_where_the_person_faces(yaw_rad: float) -> None:
    bodies = standing(yaw_rad=yaw_rad)
    wanted = np.array([math.cos(yaw_rad), math.sin(yaw_rad), 0.0])
    np.testing.assert_allclose(facing_of(bodies.watched_body(), HERE), wanted, atol=0.02)
    turn = Placing(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.ones(3), np.ones(3))
    np.testing.assert_allclose(facing_of(bodies.watched_body(), turn), turn.rotation @ wanted, atol=0.02)
    assert np.isnan(facing_of(None, HERE)).all()


def test_without_shoulders_for_long_the_facing_is_unknown() -> None:
    shown = standing(1.0)
    hidden = [name for name in STANDING if "shoulder" not in name]
    soon = standing(FACING_S - 0.1, shown, 1.0, joints=hidden)
    late = standing(FACING_S + 0.2, shown, 1.0, joints=hidden)
    assert np.isfinite(facing_of(soon.watched_body(), HERE)).all()
    assert np.isnan(facing_of(late.watched_body(), HERE)).all()
    gone = after(shown, [], 1.0 + FACING_S + 0.2)
    assert np.isnan(facing_of(gone.everyone[0], HERE)).all()


SHOULDERS = ("left_shoulder", "right_shoulder")


@pytest.mark.parametrize("yaw_rad", [0.0, 1.5])
@pytest.mark.parametrize(
    "visible", [SHOULDERS, (*SHOULDERS, "neck"), ("neck", "left_hip", "right_hip"), ("head", "pelvis")]
)
def test_head_and_trunk_of_whom_little_is_seen_are_where_a_standing_person_has_them(
    visible: tuple[str, ...], yaw_rad: float
) -> None:
    if yaw_rad and "right_shoulder" not in visible and "right_hip" not in visible:
        yaw_rad = math.pi  # from a middle alone it is taken that people face the camera
    joints, found = body(yaw_rad=yaw_rad), parts(standing(1.0, yaw_rad=yaw_rad, joints=visible))
    assert {"head", "trunk", "shoulders"} <= found.keys()
    shoulders = (joints["left_shoulder"] + joints["right_shoulder"]) / 2.0
    hips = (joints["left_hip"] + joints["right_hip"]) / 2.0
    for (ends, _, radius), place, true, known in (
        (found["head"], 0, joints["head"], "head" in visible),
        (found["trunk"], 0, shoulders, False),
        (found["trunk"], 1, hips, False),
    ):
        assert np.linalg.norm(ends[place] - true) < (0.01 if known else 0.09)
        # The capsule covers what it does not know.
        assert radius > np.linalg.norm(ends[place] - true)
    assert found["head"][2] > RADII_M[0] + (0.1 if "head" not in visible else -0.01)


def test_a_hidden_head_stays_on_its_trunk_and_takes_more_room_up_to_a_bound() -> None:
    shown, hidden = standing(1.0), [name for name in STANDING if name != "head"]
    radii = [parts(standing(seconds, shown, 1.0, joints=hidden))["head"][2] for seconds in (0.1, 0.2, 0.4, 3.0)]
    assert radii[0] > RADII_M[0] + 0.02
    assert radii == sorted(radii)
    assert radii[1] - radii[0] == pytest.approx(HIDDEN_M_S * 0.1, abs=0.025)
    assert radii[-1] == pytest.approx(RADII_M[0] + HIDDEN_M[LANDMARKS.index("head")], rel=0.03)
    turned = standing(0.1, shown, 1.0, joints=hidden, place_m=FAR + np.array([0.05, 0.1, 0.0]))
    wanted = body(FAR + np.array([0.05, 0.1, 0.0]))["head"]
    np.testing.assert_allclose(parts(turned)["head"][0][0], wanted, atol=0.03)
    again = standing(0.1, standing(1.0, shown, 1.0, joints=hidden), 2.0)
    assert parts(again)["head"][2] == pytest.approx(RADII_M[0], rel=0.03)


def test_a_hidden_hand_moves_with_its_elbow() -> None:
    shown = standing(1.0)
    hidden = [name for name in STANDING if name != "right_hand"]
    up = {"right_elbow": (0.1, -0.21, 1.2)}
    moved = standing(0.3, shown, 1.0, joints=hidden, moved=up)
    before, found = parts(shown)["right_forearm"], parts(moved)["right_forearm"]
    np.testing.assert_allclose(found[0][1] - found[0][0], before[0][1] - before[0][0], atol=0.01)
    assert found[2] > before[2] + 0.04


def test_a_doubted_joint_counts_half_and_both_places_are_covered() -> None:
    shown = standing(1.0)
    aside = {"head": (0.335, 0.0, 1.60)}  # 30 cm before where it was
    bodies = after(shown, [person(body(moved=aside), 1.0, doubted=["head"])], 1.0)
    ends, _, radius = parts(bodies)["head"]
    true, was = body(moved=aside)["head"], body()["head"]
    np.testing.assert_allclose(ends[0], (true + was) / 2.0, atol=0.01)
    for place in (true, was):
        assert np.linalg.norm(place - ends[0]) <= radius - RADII_M[0] + 0.01
    elsewhere = after(shown, [person(body(moved={"head": (1.2, 0.0, 1.6)}), 1.0, doubted=["head"])], 1.0)
    np.testing.assert_allclose(parts(elsewhere)["head"][0][0], was, atol=0.01)


def test_where_everything_is_doubted_it_has_to_do_and_takes_more_room() -> None:
    bodies = NO_BODIES
    for frame in range(20):
        time_s = frame * PERIOD_S
        bodies = after(bodies, [person(body(), time_s, doubted=STANDING)], time_s)
    found = parts(bodies)
    np.testing.assert_allclose(found["head"][0][0], body()["head"], atol=0.01)
    assert found["trunk"][2] > RADII_M[1] + DOUBTED_M - 0.01


@pytest.mark.parametrize("joint", ["head", "left_hand", "right_knee", "right_hip", "left_elbow"])
@pytest.mark.parametrize("wrong", [(0.0, 0.0, 5.0), (4.0, 0.0, 0.0)])
def test_a_joint_out_of_a_human_s_reach_is_a_tracker_s_error(joint: str, wrong: tuple[float, ...]) -> None:
    shown = standing(1.0)
    bodies = after(shown, [person(body(moved={joint: wrong}), 1.0)], 1.0)
    plain, found = parts(shown), parts(bodies)
    for part in BODY_PARTS:
        # Where the fingers end is known from the elbow's side of the hand, by the length of a hand at most.
        fingers = 2.0 * TIP_FROM_HAND_M if (joint, part) == ("left_elbow", "left_forearm") else 0.02
        np.testing.assert_allclose(found[part][0], plain[part][0], atol=fingers)


@pytest.mark.parametrize("lost", [(0.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (1000.0, 0.0, 0.0)])
def test_a_joint_that_is_nowhere_is_hidden(lost: tuple[float, ...]) -> None:
    joints = body()
    joints["head"] = np.array(lost)
    shown = standing(1.0)
    found = parts(after(shown, [person(joints, 1.0)], 1.0))
    np.testing.assert_allclose(found["head"][0][0], body()["head"], atol=1e-6)
    assert found["head"][2] > parts(shown)["head"][2]


def test_wrists_and_ears_stand_in_for_hands_and_heads() -> None:
    joints = body(joints=[name for name in STANDING if name not in ("head", "right_hand")])
    wrist = joints["right_elbow"] + np.array([0.05, 0.0, -0.24])
    ears = {"left_ear": FAR + np.array([0.03, 0.075, 1.6]), "right_ear": FAR + np.array([0.03, -0.075, 1.6])}
    bodies = NO_BODIES
    for frame in range(10):
        time_s = frame * PERIOD_S
        bodies = after(bodies, [person(joints | ears | {"right_wrist": wrist}, time_s)], time_s)
    found = parts(bodies)
    np.testing.assert_allclose(found["head"][0][0], FAR + np.array([0.03, 0.0, 1.6]), atol=1e-6)
    way = wrist - joints["right_elbow"]
    tip = wrist + TIP_FROM_WRIST_M * way / np.linalg.norm(way)
    np.testing.assert_allclose(found["right_forearm"][0][1], tip, atol=3e-3)


def numbers(bodies: Bodies) -> dict[int, np.ndarray]:
    """Where the trunk of everyone is, by number."""
    found: BodySegments = body_segments(bodies, HERE, UP)
    each = zip(found.people, found.parts, found.ends_m, strict=True)
    return {who: ends[0] for who, part, ends in each if part == "trunk"}


ASIDE = FAR + np.array([0.0, 1.5, 0.0])


def two(swapped: bool, time_s: float, places: tuple[np.ndarray, np.ndarray] = (FAR, ASIDE)) -> list[SkeletonFrame]:
    ids = (8, 7) if swapped else (7, 8)
    return [person(body(place), time_s, number) for place, number in zip(places, ids, strict=True)]


def test_everyone_is_there_the_watched_one_by_one_number_and_others_by_their_own() -> None:
    bodies = NO_BODIES
    for frame in range(20):
        bodies = after(bodies, two(False, frame * PERIOD_S), frame * PERIOD_S)
    found = numbers(bodies)
    assert len(found) == 2
    assert WATCHED_PERSON in found
    other = next(who for who in found if who != WATCHED_PERSON)
    assert np.linalg.norm(found[WATCHED_PERSON][:2] - FAR[:2]) < 0.01
    assert np.linalg.norm(found[other][:2] - ASIDE[:2]) < 0.01
    assert body_segments(NO_BODIES, HERE, UP) is NO_SEGMENTS


@pytest.mark.parametrize(("apart_m", "watched"), [(1.5, 0), (0.45, None)])
def test_a_tracker_that_swaps_its_numbers_changes_no_one(apart_m: float, watched: int | None) -> None:
    """Also of two who stand so near that either could be where the other was."""
    bodies, aside = NO_BODIES, FAR + np.array([0.0, apart_m, 0.0])
    for frame in range(20):
        bodies = after(bodies, two(frame >= 10, frame * PERIOD_S, (FAR, aside)), frame * PERIOD_S, watched)
    assert sorted(one.number for one in bodies.everyone) == [1, 2]
    assert {one.number: one.person_id for one in bodies.everyone} == {1: 8, 2: 7}
    found = numbers(bodies)
    assert np.linalg.norm(found[2][:2] - aside[:2]) < 0.01


def test_a_bystander_keeps_the_number_and_a_newcomer_gets_a_new_one() -> None:
    bodies = NO_BODIES
    for frame in range(10):
        bodies = after(bodies, two(False, frame * PERIOD_S), frame * PERIOD_S)
    third = person(body(FAR - np.array([0.0, 1.5, 0.0])), 1.0, 9)
    bodies = after(bodies, [*two(False, 1.0), third], 1.0)
    assert sorted(one.number for one in bodies.everyone) == [1, 2, 3]
    for frame in range(300):
        time_s = 1.1 + frame * PERIOD_S
        bodies = after(bodies, two(False, time_s), time_s)
    assert sorted(one.number for one in bodies.everyone) == [1, 2]
    bodies = after(bodies, [*two(False, 12.0), person(body(FAR - np.array([0.0, 1.5, 0.0])), 12.0, 9)], 12.0)
    assert sorted(one.number for one in bodies.everyone) == [1, 2, 4]


def test_a_body_that_a_tracker_shows_twice_is_one() -> None:
    near = (FAR, FAR + np.array([0.0, COINCIDING_M - 0.03, 0.0]))
    assert len(after(NO_BODIES, two(False, 0.0, near), 0.0).everyone) == 1
    apart = (FAR, FAR + np.array([0.0, COINCIDING_M + 0.03, 0.0]))
    assert len(after(NO_BODIES, two(False, 0.0, apart), 0.0).everyone) == 2


@pytest.mark.parametrize("at_once", [False, True])
@pytest.mark.parametrize("age_s", [0.1, 0.4, 2.0])
def test_a_missing_body_goes_on_for_a_moment_takes_more_room_and_is_forgotten(age_s: float, at_once: bool) -> None:
    velocity, bodies = np.array([0.6, 0.0, 0.0]), NO_BODIES
    for frame in range(30):
        time_s = frame * PERIOD_S
        bodies = after(bodies, [person(body(FAR + time_s * velocity), time_s)], time_s)
    shown, last_s = parts(bodies), 29 * PERIOD_S
    gone, steps = bodies, 1 if at_once else round(age_s / PERIOD_S)
    for step in range(1, steps + 1):
        gone = after(gone, [], last_s + age_s * step / steps)
    found = parts(gone)
    moved = found["trunk"][0] - shown["trunk"][0]
    np.testing.assert_allclose(moved, np.tile(min(age_s, COASTING_S) * velocity, (2, 1)), atol=0.02)
    assert found["trunk"][2] - shown["trunk"][2] == pytest.approx(min(MISSING_M_S * age_s, MISSING_M), abs=0.01)
    assert np.linalg.norm(found["trunk"][1]) == pytest.approx(0.0 if age_s > COASTING_S else 0.85, abs=0.1)
    assert after(gone, [], last_s + 5.2).everyone == ()


def test_a_person_who_comes_back_under_another_number_is_the_same() -> None:
    bodies = standing(1.0)
    for frame in range(3):
        bodies = after(bodies, [], 1.0 + frame * PERIOD_S)
    back = after(bodies, [person(body(FAR + np.array([0.0, RENUMBERED_M - 0.1, 0.0])), 1.15, number=99)], 1.15)
    assert [one.number for one in back.everyone] == [1]


def test_an_old_message_changes_nothing_and_a_time_long_before_resets() -> None:
    bodies = standing(1.0)
    assert after(bodies, [person(body(), 0.8)], 1.0) is bodies
    assert after(bodies, [person(body(), 29 * PERIOD_S)], 1.0) is bodies
    assert [one.number for one in after(bodies, [person(body(), -3.0)], 1.0).everyone] == [2]


def test_of_too_many_the_nearest_and_the_watched_one_are_followed() -> None:
    crowd = [person(body(np.array([1.0 + 0.6 * place, 0.0, 0.0])), 0.0, place) for place in range(MOST_BODIES + 4)]
    bodies = after(NO_BODIES, crowd, 0.0, watched=MOST_BODIES + 3)
    assert bodies.left_out == 4
    assert len(bodies.everyone) == MOST_BODIES
    assert {one.person_id for one in bodies.everyone} == {*range(MOST_BODIES - 1), MOST_BODIES + 3}
    watched = bodies.watched_body()
    assert watched is not None
    assert watched.person_id == MOST_BODIES + 3

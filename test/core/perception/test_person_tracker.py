# SPDX-License-Identifier: Apache-2.0
"""One person is watched, under changing tracker numbers and among other people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mild_core.perception.person_tracker import apart_m
from mild_core.perception.stage import Perception
from mild_core.signals import FeatureWindow, SkeletonFrame
from test.core.perception.scene import PERSON, SECOND, SETTINGS, People, at_rate, run, seen

INTERLOPER = 2


def beside(frame: SkeletonFrame, person_id: int = INTERLOPER, metres: float = 0.8) -> SkeletonFrame:
    """Another person with another motion, to the side of the watched person and 20 cm nearer to the camera."""
    positions = frame.positions_m + np.array([metres, 0.0, -0.2])
    positions[frame.joint_names.index("right_hand")] += 0.1 * np.sin(frame.stamp_ns * 1e-9)
    return replace(frame, person_id=person_id, positions_m=positions)


def same(windows: list[FeatureWindow], expected: list[FeatureWindow]) -> None:
    assert [window.stamp_ns for window in windows] == [window.stamp_ns for window in expected]
    for one, other in zip(windows, expected, strict=True):
        np.testing.assert_array_equal(one.features, other.features)


@pytest.fixture(name="alone", scope="module")
def _alone() -> list[People]:
    return seen(at_rate(40.0, 4.0))


def test_an_interloper_changes_nothing_whatever_the_order(alone: list[People]) -> None:
    _, expected = run(alone)
    crowd = []
    for index, (person,) in enumerate(alone):
        other = beside(person)
        present = index > 10  # the watched person was there first
        crowd.append(((other, person) if index % 2 else (person, other)) if present else (person,))
    state, windows = run(crowd)
    same(windows, expected)
    assert state.counts["bystanders"] == len(alone) - 11
    assert "reacquired" not in state.counts


def test_the_nearest_to_the_camera_is_chosen(alone: list[People]) -> None:
    state, _ = run([(beside(person, metres=1.5), person) for (person,) in alone])
    assert state.lock
    assert state.lock.person_id == PERSON
    state, _ = run([(beside(person, metres=-0.3), person) for (person,) in alone])
    assert state.lock
    assert state.lock.person_id == INTERLOPER


def test_swapped_numbers_do_not_swap_people(alone: list[People]) -> None:
    _, expected = run(alone)
    crowd = []
    for index, (person,) in enumerate(alone):
        other = beside(person)
        if index >= 80:
            person, other = replace(person, person_id=INTERLOPER), replace(other, person_id=PERSON)
        crowd.append((other, person) if index > 10 else (person,))
    state, windows = run(crowd)
    same(windows, expected)
    assert state.counts["reacquired"] == 1


def test_a_renumbered_person_is_found_again_where_they_were(alone: list[People]) -> None:
    _, expected = run(alone)
    state, windows = run([(replace(p, person_id=PERSON + (index >= 80)),) for index, (p,) in enumerate(alone)])
    same(windows, expected)
    assert state.counts["reacquired"] == 1


def test_who_stands_elsewhere_is_not_the_lost_person(alone: list[People]) -> None:
    crowd = [(person,) if index < 80 else (beside(person),) for index, (person,) in enumerate(alone)]
    state, windows = run(crowd)
    assert state.counts["other_person"] == 80
    assert windows[-1].stamp_ns == alone[79][0].stamp_ns
    assert state.calibration is not None


def test_a_person_with_the_right_number_may_have_walked_while_hidden() -> None:
    times = np.concatenate([at_rate(40.0, 2.0), 3.0 + at_rate(40.0, 1.0)])
    walked = [
        (replace(p, positions_m=p.positions_m + (p.stamp_ns > 2.5 * SECOND) * np.array([1.5, 0.0, 0.0])),)
        for (p,) in seen(times)
    ]
    state, windows = run(walked)
    assert state.counts["gap_reset"] == 1
    assert state.counts["accepted"] == 80
    assert "other_person" not in state.counts
    assert abs(windows[-1].features[-1, :3]).max() > 1.0  # the origin stays at the calibrated shoulder


def test_after_a_while_another_person_may_take_over() -> None:
    times = at_rate(40.0, 14.0)
    crowd = [(p,) if p.stamp_ns < 2 * SECOND else (beside(p),) for (p,) in seen(times)]
    state, windows = run(crowd)
    assert state.counts["forgotten"] == 1
    assert state.counts["calibrated"] == 2
    assert state.lock
    assert state.lock.person_id == INTERLOPER
    resumed = next(window.stamp_ns for window in windows if window.stamp_ns > 2 * SECOND) / SECOND
    assert resumed == pytest.approx(1.975 + SETTINGS.forget_s + 1.0, abs=0.06)


def test_waiting_is_by_the_clock_of_receipt_and_not_by_stamps(alone: list[People]) -> None:
    """A message without people has no stamp, and a camera's clock need not be ours."""
    perception = Perception(SETTINGS)
    state, _ = run(alone)
    far = 10**18
    for index, people in enumerate(seen(4.0 + at_rate(40.0, 1.0))):
        state, windows = perception.step(state, people, far + index * SECOND // 40)
        assert len(windows) == 1
    state, _ = perception.step(state, (), far + 2 * SECOND)
    assert (state.outcome, state.calibration is None) == ("no_person", False)
    state, _ = perception.step(state, (), far + 7 * SECOND)
    assert (state.outcome, state.calibration is None) == ("no_person", True)


def test_a_body_that_shows_nothing_is_not_locked_on(alone: list[People]) -> None:
    ghost = replace(alone[0][0], person_id=99, positions_m=np.zeros_like(alone[0][0].positions_m))
    state, _ = run([(ghost,), *alone])
    assert state.counts["accepted"] == 120
    assert state.lock
    assert state.lock.person_id == PERSON


def test_of_two_bodies_in_one_place_the_one_with_the_right_number_wins() -> None:
    """In a hug the other body may be nearer to where the watched one was a frame ago."""
    stood = seen(at_rate(40.0, 2.0), _at_rest)
    hug = [
        (beside(p, metres=0.02), replace(p, positions_m=p.positions_m + np.array([0.15, 0.0, 0.0])))
        for (p,) in seen(2.0 + at_rate(40.0, 0.025), _at_rest)
    ]
    hug = [(replace(near, positions_m=near.positions_m + np.array([0.0, 0.0, 0.2])), far) for near, far in hug]
    state, _ = run([*stood, *hug])
    assert state.counts["bystanders"] == 1
    assert state.lock
    assert state.lock.person_id == PERSON


def test_a_ghost_beside_a_person_is_not_chosen(alone: list[People]) -> None:
    def ghost(p: SkeletonFrame) -> SkeletonFrame:
        return replace(p, person_id=99, positions_m=np.zeros_like(p.positions_m))

    _, expected = run(alone)
    state, windows = run([(ghost(p), p) for (p,) in alone])
    same(windows, expected)
    assert state.lock
    assert state.lock.person_id == PERSON


def test_a_person_whose_trunk_was_hidden_is_found_again_by_where_it_was(alone: list[People]) -> None:
    def trunkless(p: SkeletonFrame) -> SkeletonFrame:
        positions = p.positions_m.copy()
        for name in ("pelvis", "chest", "left_shoulder", "right_shoulder", "head"):
            positions[p.joint_names.index(name)] = 0.0
        return replace(p, positions_m=positions)

    crowd = [(trunkless(p),) if 80 <= index < 84 else (p,) for index, (p,) in enumerate(alone)]
    crowd = [(replace(p, person_id=PERSON + (index >= 84)),) for index, (p,) in enumerate(crowd)]
    state, windows = run(crowd)
    assert state.counts["zeroed"] == 4
    assert state.counts["reacquired"] == 1
    assert len(windows) == 120


def test_bones_of_another_person_lead_to_a_new_calibration(alone: list[People]) -> None:
    def giant(p: SkeletonFrame) -> SkeletonFrame:
        return replace(p, positions_m=p.positions_m[:1] + 1.5 * (p.positions_m - p.positions_m[:1]))

    crowd = [(p,) if p.stamp_ns < 2 * SECOND else (giant(p),) for (p,) in seen(at_rate(40.0, 9.0), _at_rest)]
    state, _ = run(crowd, replace(SETTINGS, reacquire_distance_m=1.0))
    assert "bone_length" not in state.counts
    assert state.counts["forgotten"] == 1
    assert state.counts["calibrated"] == 2
    assert state.outcome == "accepted"
    assert state.calibration is not None
    np.testing.assert_allclose(state.calibration.bone_lengths_m, [1.5 * 0.29, 1.5 * 0.335])


def _at_rest(times_s: np.ndarray) -> np.ndarray:
    rest = np.array([[0.0, 0.0, 0.0], [0.0, -0.02, -0.18], [0.03, -0.02, -0.41]])
    return np.repeat(rest[None], len(times_s), axis=0)


@pytest.mark.parametrize("joints", [3, 4])
def test_one_joint_that_a_tracker_throws_away_is_no_change_of_person(joints: int) -> None:
    trunk = tuple((0.2 * joint, 2.0, 1.0) for joint in range(joints))
    moved = tuple((x + 0.1, y, z) for x, y, z in trunk)
    assert apart_m(trunk, (*moved[:-1], (9.0, 9.0, 9.0))) == pytest.approx(0.1)
    assert apart_m(trunk, (None,) * joints) is None

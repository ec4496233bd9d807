# SPDX-License-Identifier: Apache-2.0
"""A tracker that repeats itself to the bit under new stamps shows no living person."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mild_core.perception.stage import Perception
from mild_ros.simulation.person import BODY_JOINTS, bodies, skeleton_frames
from test.core.perception.scene import SECOND, SETTINGS, People, at_rate, run, seen
from tools.scenes import ROCKET_KNEELING, SCENES, Scene, arm_track

RATE_HZ = 30.0
FREEZES_S, THAWS_S = 2.5, 4.0


def restamped(people: People, stamp_ns: int) -> People:
    return tuple(replace(person, stamp_ns=stamp_ns) for person in people)


def frozen(messages: list[People], joints: tuple[str, ...] = BODY_JOINTS) -> list[People]:
    """The messages with these joints as they were at `FREEZES_S`, until `THAWS_S`."""
    places = [BODY_JOINTS.index(joint) for joint in joints]
    last = messages[round(FREEZES_S * RATE_HZ)]
    changed = []
    for (person,) in messages:
        if FREEZES_S <= person.stamp_ns / SECOND < THAWS_S:
            positions = person.positions_m.copy()
            positions[places] = last[0].positions_m[places]
            person = replace(person, positions_m=positions)
        changed.append((person,))
    return changed


def outcomes(messages: list[People]) -> list[tuple[float, str, int, bool]]:
    """Stamp [s], outcome, number of windows and whether a watched person is in the pose, of each message."""
    perception, seen = Perception(SETTINGS), []
    state = perception.init()
    for people in messages:
        stamp_ns = people[0].stamp_ns
        state, windows = perception.step(state, people, stamp_ns)
        watched = state.person is not None and state.person.watched
        seen.append((stamp_ns / SECOND, state.outcome, len(windows), watched))
    return seen


ARM = ("right_shoulder", "right_elbow", "right_wrist", "right_hand")


@pytest.mark.parametrize("joints", [BODY_JOINTS, ARM])
def test_a_frozen_body_or_arm_gives_no_window_and_is_back_at_once(joints: tuple[str, ...]) -> None:
    for time_s, outcome, windows, posed in outcomes(frozen(seen(at_rate(RATE_HZ, 6.0)), joints)):
        if time_s <= 1.0:
            continue
        if FREEZES_S + 0.5 + 1e-6 < time_s < THAWS_S:
            assert (outcome, windows) == ("frozen", 0), time_s
            assert posed == (joints == ARM)  # head and trunk still live
        else:
            assert outcome == "accepted", time_s
            assert posed


def test_a_tracker_that_publishes_faster_than_it_measures_is_not_frozen() -> None:
    measured = seen(at_rate(10.0, 6.0))
    messages = [restamped(people, people[0].stamp_ns + k * SECOND // 50) for people in measured for k in range(5)]
    state, windows = run(messages)
    assert "frozen" not in state.counts
    assert windows


def test_every_fifth_frame_may_come_twice() -> None:
    shown = seen(at_rate(RATE_HZ, 6.0))
    messages = [
        restamped(shown[number - 1], people[0].stamp_ns) if number % 5 == 4 else people
        for number, people in enumerate(shown)
    ]
    assert "frozen" not in run(messages)[0].counts


def test_unseen_joints_may_repeat_themselves_and_confidence_is_no_measurement() -> None:
    generator = np.random.default_rng(0)
    still = seen([0.0])[0][0]
    hidden = [place for place, joint in enumerate(BODY_JOINTS) if joint.startswith("left_")]
    messages, repeats = [], []
    for number, time_s in enumerate(at_rate(RATE_HZ, 3.0)):
        stamp_ns = round(time_s * SECOND)
        positions, confidence = (
            still.positions_m.copy(),
            still.confidence * generator.uniform(0.6, 1.0, len(BODY_JOINTS)),
        )
        repeats.append((replace(still, stamp_ns=stamp_ns, confidence=confidence),))
        positions = positions + 1e-9 * number
        positions[hidden] = np.nan
        messages.append((replace(still, stamp_ns=stamp_ns, positions_m=positions),))
    assert run(repeats)[0].outcome == "frozen"
    assert "frozen" not in run(messages)[0].counts


def test_a_body_left_behind_does_not_keep_others_from_being_watched() -> None:
    left = seen([0.0])[0][0]
    alive = [people[0] for people in seen(at_rate(RATE_HZ, 12.0), person_id=8)]
    aside = left.positions_m + np.array([0.0, 0.0, -0.6])  # nearer to the camera, so it is watched at first
    messages = [(replace(left, stamp_ns=person.stamp_ns, positions_m=aside), person) for person in alive]
    state, windows = run(messages)
    assert state.counts["frozen"]
    assert state.lock is not None
    assert state.lock.person_id == 8
    assert state.outcome == "accepted"
    assert windows


def test_a_setting_says_how_long() -> None:
    messages = frozen(seen(at_rate(RATE_HZ, 6.0)))
    state, _ = run(messages, replace(SETTINGS, frozen_after_s=1.6))
    assert "frozen" not in state.counts


@pytest.mark.parametrize("scene", [*SCENES, ROCKET_KNEELING], ids=lambda scene: scene.name)
def test_our_generated_people_live(scene: Scene) -> None:
    """In the tracker's own precision, as in the shipped bags."""
    frames = skeleton_frames(bodies(arm_track(scene)), RATE_HZ, 0)
    messages = [(replace(frame, positions_m=frame.positions_m.astype(np.float32)),) for frame in frames]
    assert "frozen" not in run(messages)[0].counts


def test_guessed_joints_that_move_do_not_make_a_frozen_body_live() -> None:
    still, messages = seen([0.0])[0][0], []
    guessed = [place for place, joint in enumerate(BODY_JOINTS) if joint.endswith(("knee", "ankle", "foot"))]
    confidence = still.confidence.copy()
    confidence[guessed] = 0.3
    for number, time_s in enumerate(at_rate(RATE_HZ, 2.0)):
        positions = still.positions_m.copy()
        positions[guessed] += 0.001 * number
        stamp_ns = round(time_s * SECOND)
        messages.append((replace(still, stamp_ns=stamp_ns, positions_m=positions, confidence=confidence),))
    state, _ = run(messages)
    assert state.outcome == "frozen"
    assert state.repetitions[still.person_id].body.lasts(SETTINGS.frozen_after_ns)

# SPDX-License-Identifier: Apache-2.0
"""A real Azure Kinect, whole: a person at work, 62 s at 15 Hz, with stretches in which the camera sees no person."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from mild_core.perception.skeletons import SOURCES
from mild_core.perception.stage import Perception, PerceptionSettings, PerceptionState
from mild_core.signals import FeatureWindow, SkeletonFrame
from mild_ros.bag.reader import open_bag
from mild_ros.messages.skeletons import ADAPTERS, people_from_msg

AZURE = SOURCES["azure_kinect"]
TOPIC = "/kinect2/body_tracking_data"
SETTINGS = PerceptionSettings(
    joint_names=("shoulder", "elbow", "hand"),
    bone_lengths_m=(0.18, 0.234),
    rate_hz=40.0,
    window=40,
    source_axes=AZURE.axes,
)


@dataclass(frozen=True)
class Recorded:
    """Everyone in a message, and when it was received [ns]."""

    received_ns: int
    people: tuple[SkeletonFrame, ...]


@pytest.fixture(name="recorded", scope="module")
def _recorded(shared_bags: Path) -> list[Recorded]:
    path = shared_bags / "azure_kinect_body_tracking"
    if not path.is_dir():
        pytest.skip(f"no bag of a real Azure Kinect: {path} is no folder")
    with open_bag(path) as bag:
        assert bag.topics[TOPIC].type_name == ADAPTERS[AZURE.message].type_name
        return [
            Recorded(raw.time_ns, people_from_msg(bag.decode(raw), AZURE, raw.time_ns)) for raw in bag.messages([TOPIC])
        ]


def run(recorded: list[Recorded], settings: PerceptionSettings) -> tuple[PerceptionState, list[FeatureWindow]]:
    perception = Perception(settings)
    state, windows = perception.init(), []
    for message in recorded:
        state, made = perception.step(state, message.people, message.received_ns)
        windows += made
    return state, windows


def test_the_bag_holds_one_person_and_sixty_empty_messages(recorded: list[Recorded]) -> None:
    assert len(recorded) == 933
    assert sum(not message.people for message in recorded) == 60
    assert {len(message.people) for message in recorded} == {0, 1}
    frames = [person for message in recorded for person in message.people]
    assert {frame.person_id for frame in frames} == {9}
    assert {frame.frame_id for frame in frames} == {"kinect2_depth_camera_link"}
    assert {frame.joint_names for frame in frames} == {tuple(AZURE.joint_ids.values())}
    guessed = np.mean([frame.confidence < 0.5 for frame in frames], axis=0)
    by_name = dict(zip(frames[0].joint_names, guessed, strict=True))
    assert by_name["left_knee"] > 0.9  # behind a table
    assert 0.1 < by_name["right_hand"] < 0.25
    assert by_name["pelvis"] < 0.01


def test_every_message_of_it_is_accounted_for(recorded: list[Recorded]) -> None:
    state, windows = run(recorded, SETTINGS)
    assert dict(state.counts) == {
        "no_person": 60,
        "calibrating": 11,
        "moving": 36,  # they are at work from the first second on
        "low_confidence": 156,  # the hand behind an object, mostly
        "accepted": 670,
        "calibrated": 1,
        "gap_reset": 3,
        "windows": len(windows),
        "filled": 254,
    }
    assert 60 + 11 + 36 + 156 + 670 == len(recorded) == 933
    assert len(windows) == 1983


def test_its_windows_are_an_arm_at_the_models_rate(recorded: list[Recorded]) -> None:
    state, windows = run(recorded, SETTINGS)
    for window in windows:
        arm = window.features.reshape(40, 3, 3)
        bones = np.linalg.norm(np.diff(arm, axis=1), axis=-1)
        np.testing.assert_allclose(bones, np.tile([0.18, 0.234], (40, 1)), atol=1e-9)
    newest = np.stack([window.features[-1].reshape(3, 3) for window in windows])
    # They work in front of them: the hand is before the shoulder and not above it, on average.
    assert newest[:, 2, 0].mean() > newest[:, 0, 0].mean() + 0.1
    assert newest[:, 2, 2].mean() < newest[:, 0, 2].mean()
    assert state.calibration
    up = state.calibration.arm_from_source[2]
    assert up @ np.array([0.0, -1.0, 0.0]) > 0.9  # a camera that looks ahead


def test_a_second_person_in_it_would_change_nothing(recorded: list[Recorded]) -> None:
    _, expected = run(recorded, SETTINGS)

    def joined(message: Recorded) -> Recorded:
        if not message.people:
            return message
        (person,) = message.people
        other = replace(person, person_id=10, positions_m=person.positions_m[::-1] + np.array([1.2, 0.0, 0.9]))
        return replace(message, people=(other, person))

    state, windows = run([joined(message) for message in recorded], SETTINGS)
    assert state.counts["bystanders"] == 873
    assert len(windows) == len(expected)
    for one, other in zip(windows, expected, strict=True):
        np.testing.assert_array_equal(one.features, other.features)


def test_the_same_bag_gives_the_same_windows_twice(recorded: list[Recorded]) -> None:
    first, second = run(recorded, SETTINGS)[1], run(recorded, SETTINGS)[1]
    assert [window.stamp_ns for window in first] == [window.stamp_ns for window in second]
    assert b"".join(window.features.tobytes() for window in first) == b"".join(w.features.tobytes() for w in second)

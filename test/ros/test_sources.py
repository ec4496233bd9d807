# SPDX-License-Identifier: Apache-2.0
"""Every source: its driver's messages of a person who moves show the arm that moved, on both sides."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mild_core.errors import DataError, SetupError
from mild_core.perception.skeletons import SOURCES, SkeletonSource
from mild_core.perception.stage import Perception, PerceptionState
from mild_core.signals import FeatureWindow, SkeletonFrame
from mild_ros.messages.joint_by_joint import People
from mild_ros.messages.message_types import required_message_class
from mild_ros.messages.skeletons import ADAPTERS, people_from_msg
from test.core.perception.scene import SECOND, SETTINGS, at_rate, newest_arms, seen, truth
from test.core.perception.test_calibration import mirrored
from test.ros.driver_messages import ARMS, DRIVERS, Driver, transform, yolo, zed
from test.ros.foreign_messages import foreign, header, received

SEEN_IN_FLOAT32_M = 2e-6
"""Sway of a person who stands: several drivers send float32, in which less would be a repetition to the bit."""

EVERY = pytest.mark.parametrize("driver", DRIVERS.values(), ids=DRIVERS)


def people_of(source: SkeletonSource, sent: Iterable[tuple[str, Any]], now_ns: int = 1) -> list[People | None]:
    """What each message shows to who just began to listen."""
    read = {feed.topic: feed.read for feed in ADAPTERS[source.message].feeds(source)}
    return [read[topic](message, now_ns) for topic, message in sent]


def newest_of(driver: Driver) -> People:
    """Everyone in the newest whole frame after three."""
    sent = [pair for people in seen(at_rate(40.0, 0.075)) for pair in driver.messages(people[0])]
    return [people for people in people_of(driver.source, sent) if people][-1]


def watched(
    driver: Driver, frames: Iterable[SkeletonFrame], **settings: Any
) -> tuple[PerceptionState, list[FeatureWindow]]:
    """Perception over what a driver publishes of these."""
    read = {feed.topic: feed.read for feed in ADAPTERS[driver.source.message].feeds(driver.source)}
    perception = Perception(replace(SETTINGS, source_axes=driver.source.axes, **settings))
    state, windows = perception.init(), []
    for frame in frames:
        for topic, message in driver.messages(frame):
            people = read[topic](message, frame.stamp_ns)
            if people is not None:
                state, made = perception.step(state, people, frame.stamp_ns)
                windows += made
    return state, windows


def test_every_source_is_played_by_a_driver() -> None:
    assert {name.split()[0] for name in DRIVERS} == set(SOURCES)


@EVERY
@pytest.mark.parametrize("side", ["right", "left"])
def test_the_arm_that_moved_is_the_arm_that_is_seen(driver: Driver, side: str) -> None:
    frames = [people[0] for people in seen(at_rate(40.0, 2.5), sway_m=SEEN_IN_FLOAT32_M)]
    state, windows = watched(driver, frames if side == "right" else map(mirrored, frames), side=side)
    assert state.calibration is not None
    assert state.counts["accepted"] == 60 == len(windows)
    assert not {"reacquired", "missed", "filled", "missing_joint"} & state.counts.keys()
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=driver.tolerance_m + 3 * SEEN_IN_FLOAT32_M)


@EVERY
def test_up_is_checked(driver: Driver) -> None:
    wrong = {"optical": "rep103", "rep103": "optical"}[driver.source.axes]
    state, windows = watched(
        replace(driver, source=replace(driver.source, axes=wrong)),
        (people[0] for people in seen(at_rate(40.0, 1.2), sway_m=SEEN_IN_FLOAT32_M)),
    )
    assert (state.outcome, windows) == ("wrong_up_axis", [])


def test_confidence_is_the_trackers() -> None:
    expected = {"point_cloud": 0.9, "mediapipe": 0.99, "yolo": 0.8, "zed": 0.86}
    for name, driver in DRIVERS.items():
        (person, *_) = newest_of(driver)
        np.testing.assert_allclose(person.confidence, expected.get(name.split()[0], 1.0), atol=1e-7)


def test_people_keep_their_trackers_number_and_frame() -> None:
    assert {name: [(one.person_id, one.frame_id) for one in newest_of(driver)] for name, driver in DRIVERS.items()} == {
        "azure_kinect": [(7, "depth_camera_link")],
        "nuitrack": [(0, "camera_color_optical_frame")],
        "pose_array": [(0, "depth_camera_link")],
        "point_cloud": [(0, "camera_optical"), (1, "camera_optical")],
        "mediapipe": [(0, "")],
        "motion_capture": [(0, "world")],
        "tf": [(2, "openni_depth_frame")],
        "hri": [(0, "camera_link")],
        "zed": [(7, "zed_left_camera_frame")],
        "zed BODY_18": [(7, "zed_left_camera_frame")],
        "zed BODY_34": [(7, "zed_left_camera_frame")],
        "yolo": [(7, "base_link")],
    }


def test_a_zed_body_that_is_searched_for_is_guessed() -> None:
    ((_, message),) = zed(2)(seen([0.0])[0][0])
    message.objects[0].tracking_state = 2
    ((person,),) = people_of(SOURCES["zed"], [("skeleton", message)])
    assert (person.confidence == 0.3).all()
    message.objects[0].skeleton_available = False
    assert people_of(SOURCES["zed"], [("skeleton", message)]) == [()]


def test_a_yolo_person_without_a_number_has_a_place() -> None:
    ((_, message),) = yolo(seen([0.0])[0][0])
    message.detections[1].id = ""
    ((person,),) = people_of(SOURCES["yolo"], [("skeleton", message)])
    assert person.person_id == 1


def test_bodies_that_are_no_longer_listed_are_gone() -> None:
    driver, frames = DRIVERS["hri"], [people[0] for people in seen(at_rate(40.0, 1.0))]
    read = {feed.topic: feed.read for feed in ADAPTERS["tracked_bodies"].feeds(driver.source)}
    for frame in frames[:10]:
        found = [read[topic](message, 0) for topic, message in driver.messages(frame)]
    assert found[-1] is not None
    empty = received(foreign("hri_msgs/msg/IdsList", header=header(frames[10].stamp_ns, ""), ids=[]))
    assert read["/humans/bodies/tracked"](empty, 0) == ()
    still_moving = [(topic, message) for topic, message in driver.messages(frames[11]) if topic == "/tf"]
    assert [read[topic](message, 0) for topic, message in still_moving] == [None, None]


def test_a_body_that_motion_capture_loses_costs_its_joint_only() -> None:
    driver = DRIVERS["motion_capture"]

    def hidden(frame: SkeletonFrame) -> Any:
        lost = 1.3 < frame.stamp_ns / SECOND < 1.5
        sent = [pair for pair in driver.messages(frame) if not (lost and "left_elbow" in pair[0])]
        yield from sent

    state, windows = watched(replace(driver, messages=hidden), [people[0] for people in seen(at_rate(40.0, 2.5))])
    # The frame in which it went missing is only known to be done when the next one comes, late but whole.
    assert state.counts["accepted"] == 60 == len(windows)
    np.testing.assert_allclose(newest_arms(windows), truth(windows), atol=1e-9)


@pytest.mark.parametrize("size", [1, 63, 98, 100, 132 * 4])
def test_other_arrays_of_numbers_are_no_landmarks(size: int) -> None:
    with pytest.raises(DataError, match="33 landmarks"):
        people_from_msg(foreign("std_msgs/msg/Float32MultiArray", data=np.zeros(size)), SOURCES["mediapipe"], 0)


@pytest.mark.parametrize(
    "change",
    [{"height": 9}, {"row_step": 10}, {"data": b""}, {"fields": []}, {"point_step": 8}, {"width": 10**6}],
    ids=str,
)
def test_a_cloud_that_is_none_of_people_is_bad_data(change: dict[str, Any]) -> None:
    driver = DRIVERS["point_cloud"]
    ((_, message),) = driver.messages(seen([0.0])[0][0])
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(DataError) as caught:
        people_from_msg(message, driver.source, 0)
    assert caught.value.reason == "wrong_layout"


def test_a_loop_in_the_tree_of_frames_ends() -> None:
    source = SOURCES["tf"].with_joints(ARMS)
    loop = [transform(a, b, 5, np.ones(3)) for a, b in (("right_hand", "x"), ("x", "right_hand"))]
    message = foreign("tf2_msgs/msg/TFMessage", transforms=loop)
    assert people_of(source, [("/tf", message)] * 2) == [None, None]


def test_a_package_that_is_not_there_is_one_line() -> None:
    with pytest.raises(SetupError) as caught:
        required_message_class("zed_msgs/msg/ObjectsStamped")
    assert str(caught.value) == (
        "zed_msgs/msg/ObjectsStamped: the package zed_msgs is not installed; apt install ros-jazzy-zed-msgs"
    )
    with pytest.raises(SetupError, match="build yolo_msgs in your workspace"):
        required_message_class("yolo_msgs/msg/DetectionArray")

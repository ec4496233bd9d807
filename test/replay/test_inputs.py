# SPDX-License-Identifier: Apache-2.0
"""What of a bag a replay takes: what was latched before its beginning, stamps on the recorder's clock, transforms."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mild_core.errors import BagError, DataError
from mild_core.perception.skeletons import SOURCES
from mild_core.retargeting.robots.yumi import YUMI
from mild_ros.bag.encoding import encode
from mild_ros.bag.reader import open_bag
from mild_ros.bag.writer import create_bag
from mild_ros.messages.stamps import time_to_msg
from mild_ros.messages.standard import Marker, MarkerArray, standard_message
from mild_ros.messages.transforms import TransformPeople
from mild_ros.replay.in_process import Inputs

S = 10**9
START_NS = 1_700_000_000 * S
FRAMES, PERIOD_NS = 60, S // 15
Transform = standard_message("geometry_msgs/msg/TransformStamped")
Transforms = standard_message("tf2_msgs/msg/TFMessage")
Text = standard_message("std_msgs/msg/String")
AZURE = SOURCES["azure_kinect"]
HAND = SOURCES["tf"].with_joints(("right_hand", "pelvis"), "rep103", ("hand_{}", "hips_{}"))


def transform(
    parent: str, child: str, x: float = 0.0, q: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0), stamp_ns: int = 1
) -> Any:
    found = Transform()
    found.header.frame_id, found.child_frame_id, found.header.stamp = parent, child, time_to_msg(stamp_ns)
    found.transform.translation.x = x
    (
        found.transform.rotation.x,
        found.transform.rotation.y,
        found.transform.rotation.z,
        found.transform.rotation.w,
    ) = q
    return found


def test_what_was_latched_before_the_beginning_counts(tmp_path: Path) -> None:
    with create_bag(tmp_path / "bag") as bag:
        for topic in ("/note", "/robot_description", "/map"):
            bag.add_topic(topic, "std_msgs/msg/String", transient_local=topic != "/note")
        for index, frame in enumerate(("map", "camera")):
            message = Transforms(transforms=[transform("world", frame)])
            bag.write("/tf_static", "tf2_msgs/msg/TFMessage", START_NS + index, encode(message))
        for topic in ("/note", "/robot_description"):
            for words in ("old", "new"):
                bag.write(topic, "std_msgs/msg/String", START_NS + 2, encode(Text(data=words)))
        for index in range(FRAMES):
            time_ns = START_NS + index * PERIOD_NS
            message = Transforms(transforms=[transform("camera", "hand_1", 1.0, stamp_ns=time_ns)])
            bag.write("/tf", "tf2_msgs/msg/TFMessage", time_ns, encode(message))
        bag.write("/map", "std_msgs/msg/String", START_NS + 2 * S, encode(Text(data="later")))
    inputs = Inputs(HAND, YUMI, start_s=1.0, also=("all",))
    with open_bag(tmp_path / "bag") as bag:
        assert bag.topics["/robot_description"].latched
        assert not bag.topics["/note"].latched
        events = [event for event in inputs.messages(bag) if event.message and event.message.topic != "/joint_states"]
        first = [(event.message.topic, bag.decode(event.message)) for event in events[:4]]
    assert [topic for topic, _ in first] == ["/tf_static", "/tf_static", "/robot_description", "/tf"]
    assert [message.transforms[0].child_frame_id for _, message in first[:2]] == ["map", "camera"]
    assert first[2][1].data == "new"
    assert {event.time_ns for event in events[:3]} == {START_NS + S}
    assert sum(event.message.topic == "/map" for event in events) == 1


def tracked(folder: Path, stamp_ns: Any) -> Path:
    """A bag of an Azure Kinect, each message stamped with `stamp_ns(number, receipt)`."""
    with create_bag(folder) as bag:
        for index in range(FRAMES):
            time_ns = START_NS + index * PERIOD_NS
            markers = [Marker(id=number) for number in (12, 13)]
            for marker in markers:
                marker.header.stamp = time_to_msg(stamp_ns(index, time_ns))
            bag.write("/people", "visualization_msgs/msg/MarkerArray", time_ns, encode(MarkerArray(markers=markers)))
    return folder


def replayed_delays_s(bag_path: Path, **options: Any) -> tuple[np.ndarray, str]:
    """How long after its stamp each message comes in a replay, and what is said of that."""
    inputs = Inputs(AZURE, YUMI, joint_states="none", **options)
    with open_bag(bag_path) as bag:
        events = [(event.time_ns, event.message) for event in inputs.messages(bag) if event.message]
        stamps = [bag.decode(raw).markers[1].header.stamp for _, raw in events]
        clock = inputs.clock(bag)
    times = [time_ns - stamp.sec * S - stamp.nanosec for (time_ns, _), stamp in zip(events, stamps, strict=True)]
    return np.array(times) * 1e-9, clock.note


@pytest.mark.parametrize("behind_s", [START_NS * 1e-9 - 12.0, 1.5, -0.4, 3600.0])
@pytest.mark.parametrize("start_s", [0.0, 1.0])
def test_a_devices_own_clock_is_moved_to_the_recorders(tmp_path: Path, behind_s: float, start_s: float) -> None:
    bag = tracked(tmp_path / "bag", lambda index, time_ns: time_ns - round(behind_s * S) - 3_000_000 * (index % 3))
    delays_s, note = replayed_delays_s(bag, start_s=start_s)
    assert np.abs(delays_s).max() < 0.01, "as even as they were"
    assert len(np.unique(np.round(delays_s, 6))) == 3
    assert note == f"the clock of the tracker is {behind_s + 0.003:.1f} s off the recorder's: moved"


@pytest.mark.parametrize("behind_s", [0.0, 0.03, 0.3])
def test_an_honest_latency_is_kept(tmp_path: Path, behind_s: float) -> None:
    delays_s, note = replayed_delays_s(tracked(tmp_path / "bag", lambda index, now_ns: now_ns - round(behind_s * S)))
    assert (delays_s == pytest.approx(behind_s), note) == (True, "")


def test_stamps_that_are_no_times_become_the_receipts(tmp_path: Path) -> None:
    bag = tracked(tmp_path / "bag", lambda index, time_ns: (index * 7919) % 1000 * S + 1)
    delays_s, note = replayed_delays_s(bag)
    assert not delays_s.any()
    assert "jump about" in note


def test_messages_without_a_stamp_stay_so(tmp_path: Path) -> None:
    bag = tracked(tmp_path / "bag", lambda index, time_ns: 0)
    inputs = Inputs(AZURE, YUMI, joint_states="none")
    with open_bag(bag) as opened:
        raw = next(event.message for event in inputs.messages(opened) if event.message)
        assert opened.decode(raw).markers[0].header.stamp.sec == 0
        assert inputs.clock(opened).note == ""


TURNED = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
"""A quarter about z."""


def seen(camera: tuple[float, ...], joint: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)) -> np.ndarray:
    """Where a hand at 1 m along x of the camera is in the world; both joints come twice."""
    people = TransformPeople(HAND)
    people.fix(Transforms(transforms=[transform("world", "camera", 0.0, camera)]), 1)
    for stamp_ns in (10**9, 2 * 10**9):
        both = [transform("camera", name, 1.0, joint, stamp_ns) for name in ("hand_1", "hips_1")]
        done = people.move(Transforms(transforms=both), stamp_ns)
    assert done is not None
    return done[0].positions_m[0]


@pytest.mark.parametrize("length", [0.996, 1.0, 1.004])
def test_a_quaternion_of_short_decimals_is_made_one(length: float) -> None:
    np.testing.assert_allclose(seen(tuple(length * np.array(TURNED))), [0.0, 1.0, 0.0], atol=1e-12)


WRONG: dict[str, tuple[float, ...]] = {
    "length 1.1, not 1": tuple(1.1 * np.array(TURNED)),
    "length 0, not 1": (0.0, 0.0, 0.0, 0.0),
    "length 0.9, not 1": (0.0, 0.0, 0.0, 0.9),
    "is not finite": (0.0, 0.0, np.nan, 1.0),
}


@pytest.mark.parametrize("words", WRONG)
def test_what_is_no_rotation_is_refused_as_tf2_does(words: str) -> None:
    with pytest.raises(DataError, match=f"'camera' .*{words}") as caught:
        seen(WRONG[words])
    assert caught.value.reason == "not_a_transform"
    with pytest.raises(DataError, match=f"'hand_1' .*{words}"):
        seen(TURNED, WRONG[words])


def test_a_robots_bad_transform_costs_no_person() -> None:
    people = TransformPeople(HAND)
    bad = transform("base", "wheel", 0.0, (0.0, 0.0, 0.0, 0.0))
    both = [transform("camera", name, 1.0) for name in ("hand_1", "hips_1")]
    assert people.move(Transforms(transforms=[bad, *both]), 1) is not None
    people.move(Transforms(transforms=[transform("base", "camera")]), 2)
    with pytest.raises(DataError, match="'camera'"):
        people.move(Transforms(transforms=[transform("base", "camera", np.inf)]), 3)
    with pytest.raises(DataError, match="has the parent 'hand_1'"):
        people.move(Transforms(transforms=[transform("hand_1", "hand_1")]), 3)


def test_a_bag_that_begins_in_1970_says_where_to_begin_and_that_works(tmp_path: Path) -> None:
    """As recorders on simulated time begin that do not wait for `/clock`."""
    whole = tracked(tmp_path / "whole", lambda index, time_ns: time_ns)
    with open_bag(whole) as given, create_bag(tmp_path / "bag") as bag:
        for index, raw in enumerate(given.messages()):
            bag.write(raw.topic, raw.type_name, 0 if index < 2 else raw.time_ns, raw.data)
    with open_bag(tmp_path / "bag") as bag:
        with pytest.raises(BagError, match="has no message for 19676 days after its first 2; begin behind") as refused:
            list(Inputs(AZURE, YUMI, joint_states="none").messages(bag))
        found = re.search(r"--start ([0-9.]+)", str(refused.value))
        assert found is not None
        inputs = Inputs(AZURE, YUMI, joint_states="none", start_s=float(found[1]))
        assert len(list(inputs.messages(bag))) == FRAMES - 2


def test_where_the_robot_was_before_the_beginning_counts(tmp_path: Path) -> None:
    """A robot that stands still may say so once."""
    state = standard_message("sensor_msgs/msg/JointState")(name=list(YUMI.joint_names))
    whole = tracked(tmp_path / "whole", lambda index, time_ns: time_ns)
    with open_bag(whole) as given, create_bag(tmp_path / "bag") as bag:
        for x in (1.0, 2.0):
            state.position = np.full(7, x)
            bag.write("/joint_states", "sensor_msgs/msg/JointState", START_NS, encode(state))
        for raw in given.messages():
            bag.write(raw.topic, raw.type_name, raw.time_ns, raw.data)
    with open_bag(tmp_path / "bag") as bag:
        events = Inputs(AZURE, YUMI, start_s=1.0).messages(bag)
        first, second = next(events), next(events)
        assert first.message is not None
        assert (first.input, second.input, first.time_ns) == ("joint_states", "skeleton", START_NS + S)
        assert bag.decode(first.message).position[0] == 2.0

# SPDX-License-Identifier: Apache-2.0
"""People survive the messages of trackers, live or from a bag; what is no joint is passed over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geometry_msgs.msg import PoseArray
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from mild_core.perception.skeletons import JOINTS, SOURCES
from mild_core.perception.stage import PerceptionSettings
from mild_core.signals import SkeletonFrame
from mild_ros.bag.encoding import encode, type_name_of
from mild_ros.bag.reader import jazzy_types
from mild_ros.messages.marker_array import people_to_marker_array
from mild_ros.messages.pose_array import person_to_pose_array
from mild_ros.messages.skeletons import ADAPTERS, people_from_msg
from mild_ros.simulation.person import bodies, skeleton_frames
from test.core.perception.scene import at_rate, newest_arms, run, swing
from test.ros.foreign_messages import foreign_types

AZURE = SOURCES["azure_kinect"]
STAMP_NS = 1_700_000_000_123_456_789
NOW_NS = STAMP_NS + 30_000_000


def over_dds(message):
    """What a subscriber in another process gets."""
    return deserialize_message(serialize_message(message), type(message))


def out_of_a_bag(message):
    """What rosbags reads."""
    return jazzy_types().deserialize_cdr(encode(message), type_name_of(message))


ROADS = pytest.mark.parametrize("sent", [lambda message: message, over_dds, out_of_a_bag], ids=["as is", "dds", "bag"])


def person(person_id: int = 3, stamp_ns: int = STAMP_NS) -> SkeletonFrame:
    (frame,) = skeleton_frames(bodies(swing(np.array([0.7]))), 40.0, stamp_ns, person_id=person_id)
    return frame


def same(one: SkeletonFrame, other: SkeletonFrame) -> None:
    assert (one.stamp_ns, one.frame_id, one.person_id) == (other.stamp_ns, other.frame_id, other.person_id)
    assert one.joint_names == other.joint_names
    np.testing.assert_array_equal(one.positions_m, other.positions_m)
    np.testing.assert_array_equal(one.confidence, other.confidence)


@ROADS
def test_two_people_travel_as_markers(sent) -> None:
    people = (person(3), person(12, STAMP_NS + 1))
    read = people_from_msg(sent(people_to_marker_array(people, AZURE)), AZURE, NOW_NS)
    assert len(read) == 2
    for one, other in zip(people, read, strict=True):
        same(one, other)


@ROADS
def test_no_person_is_an_empty_message(sent) -> None:
    assert people_from_msg(sent(MarkerArray()), AZURE, NOW_NS) == ()
    assert people_from_msg(sent(PoseArray()), SOURCES["pose_array"].with_joints(("right_hand",)), NOW_NS) == ()


def test_markers_that_are_no_joints_are_passed_over() -> None:
    message = people_to_marker_array([person()], AZURE)
    expected = people_from_msg(message, AZURE, NOW_NS)
    message.markers.insert(0, Marker(action=Marker.DELETEALL))
    message.markers.append(Marker(action=Marker.DELETE, id=400))
    message.markers.append(Marker(id=399, type=Marker.LINE_LIST))
    message.markers.append(Marker(id=-1))
    read = people_from_msg(message, AZURE, NOW_NS)
    assert len(read) == 1
    same(read[0], expected[0])


def test_an_unstamped_message_is_stamped_when_it_comes() -> None:
    (read,) = people_from_msg(people_to_marker_array([person(stamp_ns=0)], AZURE), AZURE, NOW_NS)
    assert read.stamp_ns == NOW_NS


def test_a_colour_is_confidence_only_where_it_differs_within_a_person() -> None:
    """The driver's fifth person is painted blue all over; its forks paint guessed joints blue among green ones."""
    for body in range(8):
        (read,) = people_from_msg(people_to_marker_array([person(body)], AZURE), AZURE, NOW_NS)
        assert (read.confidence == 1.0).all()
    message = people_to_marker_array([person(1)], AZURE)
    for guessed in (13, 15):
        message.markers[guessed].color.g, message.markers[guessed].color.b = 0.0, 1.0
    (read,) = people_from_msg(out_of_a_bag(message), AZURE, NOW_NS)
    assert np.flatnonzero(read.confidence < 0.5).tolist() == [13, 15]


def test_a_part_of_a_body_is_a_person_of_these_joints() -> None:
    message = people_to_marker_array([person()], AZURE)
    message.markers = message.markers[12:16]
    (read,) = people_from_msg(message, AZURE, NOW_NS)
    assert read.joint_names == ("right_shoulder", "right_elbow", "right_wrist", "right_hand")


@ROADS
def test_a_person_travels_as_poses_in_a_given_order(sent) -> None:
    order = ("right_hand", "", "pelvis", "right_shoulder", "left_shoulder", "right_elbow")
    source = SOURCES["pose_array"].with_joints(order, "optical")
    shown = person(0)
    (read,) = people_from_msg(sent(person_to_pose_array(shown, source)), source, NOW_NS)
    assert read.joint_names == tuple(name for name in order if name)
    for name, position in zip(read.joint_names, read.positions_m, strict=True):
        np.testing.assert_array_equal(position, shown.positions_m[shown.joint_names.index(name)])
    assert (read.stamp_ns, read.frame_id) == (shown.stamp_ns, shown.frame_id)


def test_a_short_pose_array_holds_the_joints_that_it_has() -> None:
    source = SOURCES["pose_array"].with_joints(("right_shoulder", "right_elbow", "right_hand"))
    message = person_to_pose_array(person(), source)
    message.poses = message.poses[:2]
    (read,) = people_from_msg(message, source, NOW_NS)
    assert read.joint_names == ("right_shoulder", "right_elbow")


def test_both_kinds_of_message_show_the_same_arm() -> None:
    order = ("right_shoulder", "right_elbow", "right_hand", "left_shoulder", "pelvis")
    poses = SOURCES["pose_array"].with_joints(order, "optical")
    settings = PerceptionSettings(
        joint_names=("shoulder", "elbow", "hand"),
        bone_lengths_m=(0.18, 0.234),
        rate_hz=40.0,
        window=40,
        source_axes="optical",
    )
    shown = list(skeleton_frames(bodies(swing(at_rate(40.0, 3.0) - 1.0)), 40.0, STAMP_NS))
    one = run([people_from_msg(people_to_marker_array([frame], AZURE), AZURE, 0) for frame in shown], settings)[1]
    other = run([people_from_msg(person_to_pose_array(frame, poses), poses, 0) for frame in shown], settings)[1]
    assert len(one) == len(other) == 80
    np.testing.assert_array_equal(newest_arms(one), newest_arms(other))


def test_every_source_has_an_adapter_for_its_message() -> None:
    assert {source.message for source in SOURCES.values()} == set(ADAPTERS)
    for adapter in ADAPTERS.values():
        if adapter.type_name.split("/")[0] in ("tf2_msgs", "zed_msgs", "yolo_msgs"):  # not on PyPI
            assert adapter.type_name in foreign_types().types
        else:
            assert type_name_of(adapter.message_type()) == adapter.type_name


def test_every_joint_can_travel_as_a_pose() -> None:
    source = SOURCES["pose_array"].with_joints(JOINTS)
    positions = np.random.default_rng(1).normal(size=(len(JOINTS), 3))
    shown = replace(person(0), joint_names=JOINTS, positions_m=positions, confidence=np.ones(len(JOINTS)))
    (read,) = people_from_msg(out_of_a_bag(person_to_pose_array(shown, source)), source, NOW_NS)
    same(read, shown)

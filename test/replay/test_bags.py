# SPDX-License-Identifier: Apache-2.0
"""Good bags of every kind are read."""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mild_core.errors import BagError
from mild_ros.bag.reader import RawMessage, open_bag, topic_of_type
from test.replay.made_bags import (
    COUNT,
    EXPECTED,
    JOINT_STATE,
    positions,
    refused,
    write_foreign,
    write_ours,
    write_with_mcap,
)


def test_what_we_write_we_read(tmp_path):
    bag_path = write_ours(tmp_path / "bag")
    assert positions(bag_path) == EXPECTED
    assert positions(next(bag_path.glob("*.mcap"))) == EXPECTED
    with open_bag(bag_path) as bag:
        assert bag.topics["/joint_states"].count == COUNT
        assert [raw.time_ns for raw in bag.messages()] == [10**9 + index * 10**7 for index in range(COUNT)]


@pytest.mark.parametrize("storage", list(StoragePlugin))
@pytest.mark.parametrize("mode", list(CompressionMode))
def test_other_storages_are_read(tmp_path, storage, mode):
    if storage is StoragePlugin.SQLITE3 and mode is CompressionMode.STORAGE:
        pytest.skip("sqlite3 has no compression of its own")
    assert positions(write_foreign(tmp_path / "bag", storage, mode)) == EXPECTED


def test_the_formats_own_reader_opens_what_we_write(tmp_path):
    path = write_ours(tmp_path / "bag")
    with next(path.glob("*.mcap")).open("rb") as file:
        read = list(make_reader(file, validate_crcs=True).iter_messages())
    with open_bag(path) as bag:
        assert [(message.log_time, message.data) for _, _, message in read] == [
            (raw.time_ns, raw.data) for raw in bag.messages()
        ]
    assert {(schema.name, schema.encoding, channel.topic) for schema, channel, _ in read} == {
        (JOINT_STATE, "ros2msg", "/joint_states")
    }


@pytest.mark.parametrize("compression", list(CompressionType))
def test_what_the_formats_own_library_writes_is_read(tmp_path, compression):
    path = write_with_mcap(tmp_path / "other.mcap", compression=compression, chunk_size=1000)
    assert positions(path) == EXPECTED
    path.write_bytes(path.read_bytes()[:-40])
    assert refused(path)
    assert positions(path, salvage=True) == EXPECTED


def test_a_bag_of_ros_1_is_read(tmp_path):
    old = get_typestore(Stores.ROS1_NOETIC)
    old.register(get_types_from_msg("uint8 x", "other_msgs/msg/Own"))
    header, state = old.types["std_msgs/msg/Header"], old.types[JOINT_STATE]
    time, empty = old.types["builtin_interfaces/msg/Time"], np.zeros(0)
    with Ros1Writer(tmp_path / "old.bag") as writer:
        topic = writer.add_connection("/joint_states", JOINT_STATE, typestore=old)
        own = writer.add_connection("/own", "other_msgs/msg/Own", typestore=old)
        for index in range(COUNT):
            message = state(header(7, time(index, 5), "base"), ["a"], np.array([0.1 * index]), empty, empty)
            writer.write(topic, 10**9 + index, old.serialize_ros1(message, JOINT_STATE))
        writer.write(own, 10**9, b"\x01")
    with open_bag(tmp_path / "old.bag") as bag:
        read = [bag.decode(raw) for raw in bag.messages(["/joint_states"])]
        assert [bag.decode(raw).x for raw in bag.messages(["/own"])] == [1]
        assert bag.lost == ""
    assert [message.position[0] for message in read] == EXPECTED
    assert [(message.header.stamp.sec, message.header.stamp.nanosec) for message in read] == [
        (index, 5) for index in range(COUNT)
    ]
    whole = (tmp_path / "old.bag").read_bytes()
    (tmp_path / "old.bag").write_bytes(whole[: len(whole) // 2])
    assert refused(tmp_path / "old.bag", "bag of ROS 1")


def test_reading_can_begin_later(tmp_path):
    with open_bag(write_ours(tmp_path / "bag")) as bag:
        later = bag.messages(start_ns=bag.start_ns + 20 * 10**7)
        assert [bag.decode(raw).position[0] for raw in later] == EXPECTED[20:]


def test_equal_messages_have_equal_bytes(tmp_path):
    first, second = write_ours(tmp_path / "a"), write_ours(tmp_path / "b")
    with open_bag(first) as one, open_bag(second) as two:
        assert [raw.data for raw in one.messages()] == [raw.data for raw in two.messages()]


def test_the_topic_is_found_by_its_type(tmp_path):
    with open_bag(write_ours(tmp_path / "bag")) as bag:
        assert topic_of_type(bag, JOINT_STATE) == "/joint_states"
        assert topic_of_type(bag, JOINT_STATE, "joint_states") == "/joint_states"
        with pytest.raises(BagError, match="/joint_states"):
            topic_of_type(bag, "geometry_msgs/msg/PoseArray")
        with pytest.raises(BagError, match=f"/joint_states: is of {JOINT_STATE}, not geometry_msgs/msg/PoseA"):
            topic_of_type(bag, "geometry_msgs/msg/PoseArray", "joint_states")
        with pytest.raises(BagError, match=f"has no /joint_state of {JOINT_STATE}; name one of /joint_states"):
            topic_of_type(bag, JOINT_STATE, "/joint_state")


def test_a_raw_message_is_a_plain_value():
    assert RawMessage("/a", "t", 1, b"x") == RawMessage("/a", "t", 1, b"x")

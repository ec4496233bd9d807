# SPDX-License-Identifier: Apache-2.0
"""Good bags of fifty messages, as we and as other tools write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from mild_core.errors import BagError
from mild_ros.bag.encoding import encode
from mild_ros.bag.reader import jazzy_types, open_bag
from mild_ros.bag.writer import create_bag

JOINT_STATE = "sensor_msgs/msg/JointState"
COUNT = 50


def joint_state(index: int):
    types = jazzy_types().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](index, 0), "base")
    empty = np.zeros(0)
    return types[JOINT_STATE](header, ["a", "b"], np.array([0.1 * index, -1.0]), empty, empty)


def write_ours(path: Path, count: int = COUNT) -> Path:
    with create_bag(path) as bag:
        for index in range(count):
            bag.write("/joint_states", JOINT_STATE, 10**9 + index * 10**7, encode(joint_state(index)))
            if index % 10 == 9:
                bag.flush()
    return path


def write_foreign(path: Path, storage: StoragePlugin, mode: CompressionMode) -> Path:
    writer = Writer(path, version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topic: Connection = writer.add_connection("/joint_states", JOINT_STATE, typestore=jazzy_types())
        for index in range(COUNT):
            writer.write(topic, 10**9 + index * 10**7, encode(joint_state(index)))
    return path


def positions(path: Path, *, salvage: bool = False) -> list[float]:
    with open_bag(path, salvage=salvage) as bag:
        return [bag.decode(raw).position[0] for raw in bag.messages(["/joint_states"])]


EXPECTED = [0.1 * index for index in range(COUNT)]


def write_with_mcap(path: Path, **options: object) -> Path:
    """As the format's own library writes it: one file, times in no order, no metadata.yaml."""
    definition, _ = jazzy_types().generate_msgdef(JOINT_STATE, ros_version=2)
    with path.open("wb") as file:
        writer = McapWriter(file, **options)
        writer.start(profile="ros2")
        schema = writer.register_schema(JOINT_STATE, "ros2msg", definition.encode())
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for index in [*range(1, COUNT, 2), *range(0, COUNT, 2)]:
            time_ns = 10**9 + index * 10**7
            writer.add_message(channel, time_ns, encode(joint_state(index)), time_ns)
        writer.finish()
    return path


def refused(path: Path, *words: str, salvage: bool = False) -> str:
    """The one line that refuses the bag, with these words in it."""
    with pytest.raises(BagError) as caught:
        positions(path, salvage=salvage)
    line = str(caught.value)
    assert "\n" not in line
    assert path.name in line
    for word in words:
        assert word in line
    return line

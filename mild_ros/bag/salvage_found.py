# SPDX-License-Identifier: Apache-2.0
"""What the search for messages in broken files finds and misses."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import zstandard
from rosbags.rosbag2 import storage_mcap

from mild_ros.bag.budgets import UNPACK, check_scratch, unzstd

_ZSTD_FRAME = b"\x28\xb5\x2f\xfd"
"""Begins a packed message; a CDR message begins with a zero."""

_BLOCK_BYTES = 2**16

ROS1_ENCODING = "ros1"
ENCODINGS = ("cdr", ROS1_ENCODING)
"""Of messages of ROS."""


@dataclass(frozen=True)
class Found:
    """A message.

    Attributes:
        topic: Where it was published.
        type_name: E.g. `sensor_msgs/msg/JointState`.
        definition: Of its type, as stored in the bag; "" when it is not.
        time_ns: Of its receipt.
        data: Its bytes.
        encoding: What they are: `cdr`, or `ros1`.
        schema_encoding: In which language the definition is, e.g. `ros2msg`; "" when it is known by its looks.
    """

    topic: str
    type_name: str
    definition: str
    time_ns: int
    data: bytes
    encoding: str = "cdr"
    schema_encoding: str = ""


@dataclass
class Loss:
    """What could not be read so far.

    Attributes:
        messages: Known to have been there.
        unread_bytes: In which there may have been any number.
        foreign: Whole messages that are none of ROS, by their encoding.
    """

    messages: int = 0
    unread_bytes: int = 0
    foreign: Counter[str] = field(default_factory=Counter)


def unpacked(file: Path, target: Path, loss: Loss) -> Path:
    """Unpack a file that is zstd as a whole into `target`, as far as it goes."""
    size, written = file.stat().st_size, 0
    with file.open("rb") as given, target.open("wb") as whole:
        reader = zstandard.ZstdDecompressor().stream_reader(given, read_across_frames=True)
        try:
            while block := reader.read(_BLOCK_BYTES):
                written += len(block)
                check_scratch(target.parent, written, size, UNPACK)
                whole.write(block)
        except zstandard.ZstdError:
            loss.unread_bytes += size - given.tell()
    return target


def message_bytes(data: bytes) -> bytes | None:
    """A message that may be packed by itself; None when it cannot be unpacked."""
    if not data.startswith(_ZSTD_FRAME):
        return data
    try:
        return unzstd(data)
    except (storage_mcap.zstd.ZstdError, ValueError):
        return None

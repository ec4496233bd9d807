# SPDX-License-Identifier: Apache-2.0
"""What the search for messages in broken files finds and misses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import zstandard
from rosbags.rosbag2 import storage_mcap

from mild_ros.bag_budgets import UNPACK, check_scratch, unzstd

_ZSTD_FRAME = b"\x28\xb5\x2f\xfd"
"""Begins a packed message; a CDR message begins with a zero."""

_BLOCK_BYTES = 2**16


@dataclass(frozen=True)
class Found:
    """A message.

    Attributes:
        topic: Where it was published.
        type_name: E.g. `sensor_msgs/msg/JointState`.
        definition: Of its type, as the bag tells it; "" when it does not.
        time_ns: Of its receipt.
        data: CDR bytes.
    """

    topic: str
    type_name: str
    definition: str
    time_ns: int
    data: bytes


@dataclass
class Loss:
    """What could not be read so far.

    Attributes:
        messages: Known to have been there.
        unread_bytes: In which there may have been any number.
    """

    messages: int = 0
    unread_bytes: int = 0


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

# SPDX-License-Identifier: Apache-2.0
"""A bag in several files, as rosbag2 lays it out: each is whole by itself, metadata.yaml lists them all."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2.storage_mcap import McapWriter, write_channel, write_schema


@dataclass(frozen=True)
class Part:
    """One file of a bag that was split.

    Attributes:
        name: Of the file.
        start_ns: Time of its first message.
        end_ns: Time of its last.
        counts: Messages by number of their topic.
    """

    name: str
    start_ns: int
    end_ns: int
    counts: Mapping[int, int]


def set_aside(storage: McapWriter, number: int) -> Part:
    """Give a file that has been ended its number in the bag."""
    named = storage.path.with_name(f"{storage.path.stem}_{number}.mcap")
    storage.path.rename(named)
    return Part(named.name, storage.message_start_time, storage.message_end_time, dict(storage.channel_stats))


def continued(before: McapWriter) -> McapWriter:
    """The next file of a bag, which knows all the topics of the one before."""
    compression = CompressionMode.STORAGE if before.compression else CompressionMode.NONE
    storage = McapWriter(before.path.parent, compression)
    storage.schemas, storage.channels = list(before.schemas), list(before.channels)
    for schema in storage.schemas:
        write_schema(storage.chunk.bio, schema)
    for channel in storage.channels:
        write_channel(storage.chunk.bio, channel, storage.schemas)
        storage.channel_stats[channel.id] = 0
    return storage


def list_parts(metadata: Path, parts: Sequence[Part]) -> None:
    """Put all files of a bag into its metadata.yaml, which rosbags has written for a bag of one file."""
    paths = "".join(f"  - {part.name}\n" for part in parts)
    files = "".join(_described(part) for part in parts)
    text = metadata.read_text()
    text = re.sub(r"^  files:\n(?:  [- ] .*\n)+", f"  files:\n{files}", text, flags=re.MULTILINE)
    text = re.sub(
        r"^  relative_file_paths:\n(?:  - .*\n)+", f"  relative_file_paths:\n{paths}", text, flags=re.MULTILINE
    )
    whole = metadata.with_suffix(".yaml.tmp")
    whole.write_text(text)
    whole.replace(metadata)


def _described(part: Part) -> str:
    return (
        f"  - path: {part.name}\n"
        f"    message_count: {sum(part.counts.values())}\n"
        f"    starting_time:\n      nanoseconds_since_epoch: {part.start_ns}\n"
        f"    duration:\n      nanoseconds: {max(part.end_ns - part.start_ns, 0)}\n"
    )

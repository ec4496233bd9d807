# SPDX-License-Identifier: Apache-2.0
"""The whole messages of a broken mcap file.

An mcap file is a row of records, most of them chunks of packed messages, so one that was cut off (kill, full disk,
copy) is good up to its last whole record. Behind a record that makes no sense the search goes on at the next chunk.

The same walk reads good files that rosbags cannot: of ROS 1, or with a summary that leaves out what it relies on.

Source: MCAP file format specification, https://mcap.dev/spec.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path

from rosbags.rosbag2.storage_mcap import McapReader

from mild_core.printable import printable
from mild_ros.bag.budgets import CHUNK_BYTES, OverBudgetError, decompress
from mild_ros.bag.salvage_found import ENCODINGS, Found, Loss, message_bytes

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX = 0x03, 0x04, 0x05, 0x06, 0x07
_LAST_KIND = 0x0F
_PRIVATE_KINDS = range(0x80, 0x100)
_HEADER_BYTES = 9  # one byte of kind, eight of length
_MESSAGE_HEADER = struct.Struct("<HIQQ")
_CHUNK_HEADER = struct.Struct("<QQQII")
_INDEX_ENTRY_BYTES = 16
_COMPRESSIONS = tuple(struct.pack("<I", len(name)) + name for name in (b"zstd", b"lz4"))

_NAMELESS = "__schemaless__"
"""What rosbags calls a type whose name it has not read."""

Bytes = bytes | mmap.mmap
Record = tuple[int, int, int]
"""Kind, and where the content begins and ends."""


def mcap_messages(file: Path, loss: Loss) -> Iterator[Found]:
    """Messages in the order in which they stand in the file."""
    with file.open("rb") as given:
        if file.stat().st_size <= len(MAGIC):
            loss.unread_bytes += file.stat().st_size
            return
        with mmap.mmap(given.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield from _Search(data, loss).messages()


def is_whole(file: Path) -> bool:
    """Whether a file is mcap from its begin to its end; chunks are not looked into."""
    if file.stat().st_size <= 2 * len(MAGIC):
        return False
    loss = Loss()
    with file.open("rb") as given, mmap.mmap(given.fileno(), 0, access=mmap.ACCESS_READ) as data:
        for _ in _records(data, len(MAGIC), loss):
            pass
        return data[: len(MAGIC)] == data[-len(MAGIC) :] == MAGIC and not loss.unread_bytes


def is_indexed(reader: McapReader) -> bool:
    """Whether rosbags reads all of a file and in order: any part of a summary may be missing in a good one.

    Args:
        reader: That has opened it.
    """
    counted = sum(connection.msgcount for connection in reader.connections)
    named = all(connection.msgtype != _NAMELESS for connection in reader.connections)
    if counted != reader.metadata.message_count or not named:
        return False
    if reader.chunks:  # one that holds no messages, but says what would be in them, ends at time 0
        return counted > 0 or not any(chunk.message_end_time for chunk in reader.chunks)
    with reader.path.open("rb") as given, mmap.mmap(given.fileno(), 0, access=mmap.ACCESS_READ) as data:
        newest_ns = 0
        for kind, begin, stop in _records(data, len(MAGIC), Loss()):
            if kind == _MESSAGE and stop - begin >= _MESSAGE_HEADER.size:
                before_ns, newest_ns = newest_ns, _MESSAGE_HEADER.unpack_from(data, begin)[2]
                if newest_ns < before_ns:
                    return False
            elif kind == _CHUNK:
                return False
    return True


class _Search:
    """A walk through one file."""

    def __init__(self, data: Bytes, loss: Loss) -> None:
        self._data, self._loss = data, loss
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._channels: dict[int, tuple[int, str, str]] = {}

    def messages(self) -> Iterator[Found]:
        for kind, begin, stop in _records(self._data, len(MAGIC), Loss()):
            self._learn(self._data, kind, begin, stop)  # also what the summary at the end repeats
        chunk_is_lost = False
        for kind, begin, stop in _records(self._data, len(MAGIC), self._loss):
            if kind == _MESSAGE:
                yield from self._message(self._data, begin, stop)
            elif kind == _CHUNK:
                chunk = _unpack(self._data, begin, stop)
                chunk_is_lost = chunk is None
                if chunk is None:
                    self._loss.unread_bytes += stop - begin
                else:
                    yield from self._chunk(chunk)
            elif kind == _MESSAGE_INDEX and chunk_is_lost:
                self._loss.messages += max(stop - begin - 6, 0) // _INDEX_ENTRY_BYTES

    def _chunk(self, chunk: bytes) -> Iterator[Found]:
        for kind, begin, stop in _records(chunk, 0, self._loss):
            self._learn(chunk, kind, begin, stop)
            if kind == _MESSAGE:
                yield from self._message(chunk, begin, stop)

    def _learn(self, data: Bytes, kind: int, begin: int, stop: int) -> None:
        """Keep what a schema or a channel says; one that cannot be read says nothing."""
        try:
            if kind == _SCHEMA:
                (number,) = struct.unpack_from("<H", data, begin)
                name, at = _text(data, begin + 2, stop)
                encoding, at = _text(data, at, stop)
                definition, _ = _text(data, at, stop)
                self._schemas[number] = name, definition, encoding
            elif kind == _CHANNEL:
                number, schema = struct.unpack_from("<HH", data, begin)
                topic, at = _text(data, begin + 4, stop)
                encoding, _ = _text(data, at, stop)
                self._channels[number] = schema, topic, encoding
        except (struct.error, ValueError):
            return

    def _message(self, data: Bytes, begin: int, stop: int) -> Iterator[Found]:
        content = begin + _MESSAGE_HEADER.size
        if content > stop:
            self._loss.messages += 1
            return
        number, _, time_ns, _ = _MESSAGE_HEADER.unpack_from(data, begin)
        schema, topic, encoding = self._channels.get(number, (-1, "", "cdr"))
        if encoding not in ENCODINGS:
            self._loss.foreign[printable(encoding, 20)] += 1
            return
        name, definition, language = self._schemas.get(schema, ("", "", ""))
        message = message_bytes(bytes(data[content:stop]))
        if message is None or not name or time_ns >= 2**63:
            self._loss.messages += 1
            return
        yield Found(topic, name, definition, time_ns, message, encoding, language)


def _records(data: Bytes, start: int, loss: Loss) -> Iterator[Record]:
    """Whole records; behind one that is not, those from the next chunk on."""
    at, end = start, len(data)
    while at + _HEADER_BYTES <= end:
        kind, length = struct.unpack_from("<BQ", data, at)
        begin, stop = at + _HEADER_BYTES, at + _HEADER_BYTES + length
        if stop > end or not (0 < kind <= _LAST_KIND or kind in _PRIVATE_KINDS):
            following = _next_chunk(data, at + 1)
            loss.unread_bytes += following - at
            at = following
            continue
        yield kind, begin, stop
        at = stop
    if data[at:end] not in (b"", MAGIC):
        loss.unread_bytes += end - at


def _next_chunk(data: Bytes, start: int) -> int:
    """Where the next packed chunk begins, known by the name of its compression; the end when there is none."""
    back = _HEADER_BYTES + _CHUNK_HEADER.size - 4  # the length of the name is part of the mark
    found = [len(data)]
    for mark in _COMPRESSIONS:
        at = data.find(mark, start + back)
        while at >= 0 and data[at - back] != _CHUNK:
            at = data.find(mark, at + 1)
        found += [at - back] if at >= 0 else []
    return min(found)


def _unpack(data: Bytes, begin: int, stop: int) -> bytes | None:
    """The content of a chunk; None when it does not unpack to what it should."""
    try:
        _, _, size, checksum, length = _CHUNK_HEADER.unpack_from(data, begin)
        at = begin + _CHUNK_HEADER.size
        name = bytes(data[at : at + min(length, 16)]).decode()
        (packed,) = struct.unpack_from("<Q", data, at + length)
        content = at + length + 8
        if content + packed > stop or size > CHUNK_BYTES:
            return None
        return decompress(bytes(data[content : content + packed]), name, size, checksum)
    except OverBudgetError:
        raise
    except Exception:  # each compression has its own errors
        return None


def _text(data: Bytes, at: int, stop: int) -> tuple[str, int]:
    """A text with its length before it, and where it ends."""
    (length,) = struct.unpack_from("<I", data, at)
    end = at + 4 + length
    if end > stop:
        raise ValueError("a text is longer than its record")
    return bytes(data[at + 4 : end]).decode(), end

# SPDX-License-Identifier: Apache-2.0
"""Budgets for bags, which come from anywhere: memory, disk and time that opening and reading one may take.

An honest bag of any size is read message by message, so nothing here bounds how large a bag is. Bounded is what its
size says nothing about: one unpacked chunk, all chunks that overlap in time, bytes out for bytes in, steps of a
database, the size and depth of its texts, and time without messages.

rosbags reads the bags, and unpacks whatever it meets. `bound_rosbags` gives it unpackers that stop: they stand in the
tables and names where it looks for its own.
"""

from __future__ import annotations

import bz2
import os
import re
import shutil
import struct
import tempfile
from collections.abc import Callable, Generator, Mapping
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path
from shlex import quote as shell_quote
from types import SimpleNamespace
from typing import Any
from urllib.parse import quote

from lz4.frame import LZ4FrameDecompressor
from rosbags.rosbag1 import reader as reader_1
from rosbags.rosbag2 import metadata, reader, storage_mcap, storage_sqlite3
from rosbags.typesys import get_types_from_idl, get_types_from_msg

from mild_core.budgets import kind_of_file, shown
from mild_core.errors import BagError
from mild_core.yaml_budget import check_yaml

METADATA_BYTES = 2 << 20
"""Largest metadata.yaml; rosbag2 writes about 250 bytes for each file of a bag that was split."""

CHUNK_BYTES = 256 << 20
"""Largest chunk or message, unpacked; recorders write chunks of about one megabyte."""

HELD_BYTES = 512 << 20
"""Chunks that overlap in time are unpacked together: largest sum of them."""

CHUNK_MESSAGES = 2_000_000
"""Most messages of one chunk: each takes some hundred bytes of memory beside its content."""

FREE_BYTES, BYTES_PER_BYTE = 1 << 30, 500
"""A bag may unpack to so much, and to so much more for each of its bytes, each time that it is read."""

SCRATCH_FREE_BYTES, SCRATCH_PER_BYTE = 256 << 20, 200
"""The same for what has to be unpacked into the folder for temporary files."""

SCRATCH_LEFT_BYTES = 1 << 30
"""So much of that disk stays free."""

DEFINITION_BYTES = 1 << 20
"""Largest sum of a bag's own definitions of messages; all of ROS 2 Jazzy has less than half of that."""

DECODED_BYTES = 8 << 20
"""Largest message with parts of its own that is decoded: each part becomes an object of many times its size."""

FLAT_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/PointCloud2")
"""Messages that are one block of bytes and decode to just that."""

UNROLLED, ARRAY_LENGTH = 20_000, 1 << 28
"""Most elements of a bag's fixed arrays of texts and messages, for each of which rosbags writes code, and of one array
of numbers."""

SPARSE_BYTES, SPARSE_RATIO = 64 << 20, 1000
"""A file larger than this that has a smaller part of its length on the disk is a claim, not a recording."""

STEPS_FREE, STEPS_PER_BYTE = 20_000_000, 100
"""Steps of the virtual machine of sqlite3 for one query: an honest row takes tens of steps, and tens of bytes."""

STEPS_AT_ONCE = 100_000

PAUSE_NS, PER_MESSAGE_NS, LONGEST_PAUSE_NS = 600 * 10**9, 10 * 10**9, 24 * 3600 * 10**9
"""A replay lasts at most ten minutes and ten seconds for each message so far, and no pause is longer than a day."""

SALVAGE = "add --salvage (to a node: -p salvage:=true) to read what is left of it"
DISTRUST = "do not trust this bag"
UNPACK = "if you trust it, `zstd -d FILE.mcap.zstd -o FILE.mcap` and give that file"

RESTORE = "restore what it leads to, e.g. with `git annex get` or `dvc pull`, or copy the bag again"

apsw = storage_sqlite3.apsw
"""The sqlite3 that rosbags uses."""

_SMALLEST_MESSAGE = 31
"""Bytes of a record of mcap: kind, length, channel, number, two times."""


class OverBudgetError(Exception):
    """A bag asks for more than it may.

    Args:
        problem: What it asks for, and the budget.
        remedy: What to do.
    """

    def __init__(self, problem: str, remedy: str = DISTRUST) -> None:
        self.problem, self.remedy = problem, remedy
        super().__init__(problem)

    def of(self, thing: object) -> BagError:
        """The line that refuses `thing`."""
        return BagError(str(thing), self.problem, self.remedy)


class Account:
    """What one reading of a bag has taken so far, and may still take.

    Args:
        bag_bytes: Length of its files.
    """

    def __init__(self, bag_bytes: int) -> None:
        self.bag_bytes = bag_bytes
        self._out = self._held = self._defined = 0

    @classmethod
    def of(cls, path: Path) -> Account:
        """For a bag's folder or file."""
        files = [file for file in path.iterdir() if is_storage(file) and file.exists()] if path.is_dir() else [path]
        return cls(sum(file.stat().st_size for file in files))

    def use(self) -> None:
        """From now on, what is unpacked is charged to this account."""
        _account.set(self)

    def unpack(self, size: int) -> None:
        """Charge bytes out.

        Raises:
            OverBudgetError: They are too many for the bytes in.
        """
        self._out += size
        most = FREE_BYTES + BYTES_PER_BYTE * self.bag_bytes
        if self._out > most:
            raise OverBudgetError(f"unpacks to more than {shown(most)}, with {shown(self.bag_bytes)} on the disk")

    def hold(self, size: int) -> None:
        """Charge memory that is taken until it is given back by a negative size.

        Raises:
            OverBudgetError: It is too much at once.
        """
        self._held += size
        if self._held > HELD_BYTES:
            problem = f"has chunks that overlap in time and unpack to more than {shown(HELD_BYTES)} together"
            raise OverBudgetError(problem, "sort it first, e.g. with `ros2 bag convert`")

    def define(self, size: int) -> None:
        """Charge text that defines messages.

        Raises:
            OverBudgetError: It is too long.
        """
        self._defined += size
        if self._defined > DEFINITION_BYTES:
            raise OverBudgetError(f"defines its messages in more than {shown(DEFINITION_BYTES)} of text")


_account: ContextVar[Account] = ContextVar("_account", default=Account(0))  # noqa: B039  # nothing to share: no bag yet


def is_storage(file: Path) -> bool:
    """Whether a file of a bag's folder is one that holds messages, or belongs to one."""
    return bool(re.search(r"\.(mcap|db3|bag)(-wal|-journal)?(\.zstd|\.zst)?$", file.name))


def check_file(file: Path, named: Path) -> None:
    """Refuse what is no regular file, lies outside of the bag's folder, or is no more than a claim.

    The user's own word counts: what `named` itself leads to is the bag, wherever it lies. Beneath it, a link may lead
    anywhere in the bag's folder, and nowhere else, because the bag's sender made the link too.

    Args:
        file: The bag itself, or a file in its folder.
        named: The bag as the user named it.

    Raises:
        BagError: It is refused, in the same words whether the bag is salvaged or not.
    """
    real, root = os.path.realpath(file), os.path.realpath(named)
    outside = os.path.commonpath([real, root]) != root
    try:
        found = os.stat(file)
    except OSError as error:
        problem = f"is a link out of the bag, to {real}, and" if outside else ""
        remedy = RESTORE if file.is_symlink() else SALVAGE
        raise BagError(str(file), f"{problem} cannot be read ({error.strerror})", remedy) from None
    # First, so that no one is asked to copy a device.
    if kind := kind_of_file(found.st_mode):
        raise BagError(str(file), f"is {kind}, not a file", DISTRUST)
    if outside:
        raise BagError(
            str(file), f"is a link out of the bag, to {real}", f"if you trust it: cp -rL {shell_quote(str(named))} COPY"
        )
    on_disk = found.st_blocks * 512
    if found.st_size > SPARSE_BYTES and on_disk * SPARSE_RATIO < found.st_size and _is_mostly_hole(file):
        raise BagError(str(file), f"claims {shown(found.st_size)}, with {shown(on_disk)} on the disk", DISTRUST)


def _is_mostly_hole(file: Path) -> bool:
    """Whether a file has no data between its first megabyte and its sixteenth, as far as the disk knows."""
    with file.open("rb") as opened:
        try:
            return os.lseek(opened.fileno(), 1 << 20, os.SEEK_DATA) > 1 << 24
        except OSError:
            return True


def check_metadata(file: Path) -> str:
    """The text of a metadata.yaml, once it is of a bounded size and depth.

    Raises:
        BagError: It is not.
    """
    if file.stat().st_size > METADATA_BYTES:
        raise BagError(str(file), f"is larger than {shown(METADATA_BYTES)}", DISTRUST)
    text = file.read_text(errors="replace")
    try:
        _check_yaml(text)
    except OverBudgetError as error:
        raise error.of(file) from None
    return text


def _check_yaml(text: str) -> None:
    """As `check_yaml`, of the texts of a bag."""
    try:
        check_yaml(text)
    except ValueError as error:
        raise OverBudgetError(str(error)) from None


def check_scratch(folder: Path, written: int, size: int, remedy: str = DISTRUST) -> None:
    """Refuse to go on writing into a folder for temporary files.

    Args:
        folder: On that disk.
        written: Bytes so far.
        size: Of the file that they come from.
        remedy: What to do about one that is refused.

    Raises:
        OverBudgetError: They are too many, or the disk is nearly full.
    """
    most = SCRATCH_FREE_BYTES + SCRATCH_PER_BYTE * size
    if written > most:
        raise OverBudgetError(f"unpacks to more than {shown(most)}, with {shown(size)} on the disk", remedy)
    if shutil.disk_usage(folder).free < SCRATCH_LEFT_BYTES:
        problem = f"would fill the disk of {folder}, where less than {shown(SCRATCH_LEFT_BYTES)} is left"
        raise OverBudgetError(problem, "set TMPDIR to a folder on a larger disk")


def unzstd(data: bytes, limit: int = CHUNK_BYTES) -> bytes:
    """Unpack zstd, every frame of it.

    Raises:
        OverBudgetError: There is more than a chunk may have.
        ValueError: There is more than `limit`, or it is cut off.
    """
    return _unpacked(data, limit, storage_mcap.zstd.ZstdDecompressor, "zstd")


def unlz4(data: bytes, limit: int = CHUNK_BYTES) -> bytes:
    """Unpack one frame of lz4; raises as `unzstd`."""
    return _unpacked(data, limit, LZ4FrameDecompressor, "lz4")


def unbz2(data: bytes, limit: int = CHUNK_BYTES) -> bytes:
    """Unpack bzip2, every stream of it; raises as `unzstd`."""
    return _unpacked(data, limit, bz2.BZ2Decompressor, "bzip2")


def _unpacked(data: bytes, limit: int, decompressor: Callable[[], Any], name: str) -> bytes:
    parts, size = [], 0
    while data:
        stream = decompressor()
        part = stream.decompress(data, max_length=limit - size + 1)
        size += len(part)
        if size > CHUNK_BYTES:
            raise OverBudgetError(f"holds a block of {name} that unpacks to more than {shown(CHUNK_BYTES)}")
        if size > limit or not stream.eof:
            raise ValueError(f"a block of {name} is {'longer than announced' if size > limit else 'cut off'}")
        parts.append(part)
        data = stream.unused_data if name != "lz4" else b""
    _account.get().unpack(size)
    return parts[0] if len(parts) == 1 else b"".join(parts)


class _BoundedFile:
    """A packed file that gives no more than it may; rosbags copies it into the folder for temporary files."""

    def __init__(self, packed: Any, raw: Any) -> None:
        self._packed, self._name = packed, os.path.basename(str(raw.name))
        self._size, self._given = os.fstat(raw.fileno()).st_size, 0

    def __enter__(self) -> _BoundedFile:
        self._packed.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._packed.__exit__(*error)

    def read(self, size: int = -1) -> bytes:
        """The next bytes, as of any file."""
        block: bytes = self._packed.read(size)
        self._given += len(block)
        check_scratch(Path(tempfile.gettempdir()), self._given, self._size, UNPACK)
        return block


def check_chunk(size: int) -> None:
    """Refuse a chunk of an mcap file by the size that it announces.

    Raises:
        OverBudgetError: It is too large.
    """
    if size > CHUNK_BYTES:
        raise OverBudgetError(f"holds a chunk of {shown(size)}, more than {shown(CHUNK_BYTES)}", SALVAGE)


def _messages_of_chunk(
    chunk: Any, channels: Mapping[int, Any], start: int, stop: int, file: Any
) -> Generator[Any, None, None]:
    """As rosbags' own `msgsrc`, of which this keeps count: first when the chunk begins, then its messages."""
    source = _MSGSRC(chunk, channels, start, stop, file)
    yield next(source)
    check_chunk(chunk.uncompressed_size)
    account = _account.get()
    account.hold(chunk.uncompressed_size)
    try:
        yield from source
    finally:
        account.hold(-chunk.uncompressed_size)


def decompress(data: bytes, compression: str, size: int, checksum: int) -> bytes:
    """As rosbags' own, for a chunk of an mcap file, within the budgets for one.

    Raises:
        OverBudgetError: It is too large, or has too many messages.
    """
    check_chunk(size)
    raw: bytes = _DECOMPRESS(data, compression, size, checksum)
    if not compression:
        _account.get().unpack(size)  # an index may name the same chunk again and again
    if size > CHUNK_MESSAGES * _SMALLEST_MESSAGE and _records(raw) > CHUNK_MESSAGES:
        raise OverBudgetError(f"holds a chunk of more than {CHUNK_MESSAGES} messages")
    return raw


def _records(chunk: bytes) -> int:
    """How many records a chunk has, counted no further than needed."""
    at = count = 0
    length = struct.Struct("<xQ")
    while at + 9 <= len(chunk) and count <= CHUNK_MESSAGES:
        at += 9 + length.unpack_from(chunk, at)[0]
        count += 1
    return count


def _parsed_once(parse: Callable[..., Any]) -> Callable[..., Any]:
    """A parser of definitions that charges for them and does not do the same work twice."""
    remembered = lru_cache(maxsize=256)(parse)

    def parsed(text: str, *name: str) -> Any:
        _account.get().define(len(text))
        # The parser takes a tenth of a millisecond for each empty line; only IDL has texts of several lines.
        return remembered(re.sub(r"\n\s*\n", "\n", text) if name else text, *name)

    return parsed


types_from_msg, types_from_idl = _parsed_once(get_types_from_msg), _parsed_once(get_types_from_idl)


def _bounded_database(connection: Any) -> None:
    """Bound each query of a database that rosbags opens; apsw calls it for every new connection."""
    account, steps = _account.get(), 0

    def started(*_: Any) -> bool:
        nonlocal steps
        steps = 0
        return True

    def progressed() -> bool:
        nonlocal steps
        steps += STEPS_AT_ONCE
        return steps > STEPS_FREE + STEPS_PER_BYTE * account.bag_bytes

    connection.set_exec_trace(started)
    connection.set_progress_handler(progressed, STEPS_AT_ONCE)
    connection.limit(apsw.SQLITE_LIMIT_LENGTH, CHUNK_BYTES)
    connection.set_authorizer(only_reading)


def _database(address: str, **options: Any) -> Any:
    """As `apsw.Connection`, of an address in which rosbags has not quoted the path."""
    path, _, query = address.removeprefix("file:").rpartition("?")
    return apsw.Connection(f"file:{quote(path)}?{query}", **options)


def only_reading(action: int, *about: str | None) -> int:
    """An authorizer for a bag's database: tables may be read, and no view or function of its own answers."""
    function, view = about[1], about[3]
    reads = action in (apsw.SQLITE_SELECT, apsw.SQLITE_READ, apsw.SQLITE_PRAGMA)
    counts = action == apsw.SQLITE_FUNCTION and function is not None and function.lower() in ("count", "min", "max")
    return int(apsw.SQLITE_OK if (reads or counts) and view is None else apsw.SQLITE_DENY)


def check_types(definitions: Mapping[str, Any]) -> None:
    """Refuse definitions with arrays of absurd fixed lengths.

    Raises:
        OverBudgetError: There is one.
    """
    unrolled = 0
    for name, (_, fields) in definitions.items():
        for field, (kind, detail) in fields:
            if kind.name != "ARRAY":
                continue
            (element, of), length = detail
            unrolled += length * (element.name != "BASE" or of[0] == "string")
            if not 0 < length <= ARRAY_LENGTH or unrolled > UNROLLED:
                raise OverBudgetError(f"defines {name} with {length} elements of '{field}'")


class TimeBudget:
    """Time that a replay has to live through, which a bag of two messages can make endless."""

    def __init__(self) -> None:
        self._spent_ns = self._count = self._first_ns = 0
        self._before_ns: int | None = None

    def reach(self, time_ns: int) -> None:
        """Go on to the time of the next message.

        Raises:
            OverBudgetError: So much time lies between messages that a replay would never end.
        """
        self._first_ns = time_ns if self._before_ns is None else self._first_ns
        pause_ns = 0 if self._before_ns is None else max(time_ns - self._before_ns, 0)
        self._spent_ns += pause_ns
        if pause_ns > LONGEST_PAUSE_NS or self._spent_ns > PAUSE_NS + (self._count + 1) * PER_MESSAGE_NS:
            start_s = (time_ns - self._first_ns) * 1e-9 - 0.001
            behind = f"begin behind that with --start {start_s:.3f}, or " if pause_ns > LONGEST_PAUSE_NS else ""
            raise OverBudgetError(
                f"has no message for {_span(pause_ns)} after its first {self._count}",
                f"{behind}correct its times; a replay lasts at most 10 min and 10 s for each message",
            )
        self._count, self._before_ns = self._count + 1, time_ns


def _span(time_ns: int) -> str:
    hours = time_ns / 3.6e12
    return f"{hours / 24:.0f} days" if hours >= 48 else f"{hours:.1f} hours"


# What is put into another library's place is checked by the tests that open hostile bags, not by types.
_mcap: Any = storage_mcap
_reader: Any = reader
_sqlite3: Any = storage_sqlite3
_MSGSRC, _DECOMPRESS, _ZSTD, _PARSE_QOS = _mcap.msgsrc, _mcap.decompress, _reader.zstd, metadata.parse_qos


def _parse_qos(given: Any) -> Any:
    if isinstance(given, str):
        _check_yaml(given)
    return _PARSE_QOS(given)


def bound_rosbags() -> None:
    """Put the budgets of this module where rosbags looks for its own functions."""
    _mcap.DECOMPRESSORS.update(zstd=unzstd, lz4=unlz4)
    _mcap.msgsrc, _mcap.decompress = _messages_of_chunk, decompress
    _reader.zstd = SimpleNamespace(open=lambda raw, mode: _BoundedFile(_ZSTD.open(raw, mode), raw), decompress=unzstd)
    reader_1.decompressors.update(bz2=unbz2, lz4=unlz4)
    modules: tuple[Any, ...] = (storage_mcap, storage_sqlite3, reader)
    for module in modules:
        module.parse_qos = _parse_qos
    apsw.connection_hooks.append(_bounded_database)
    # rosbags makes an address of the path, in which `?`, `#` and `%` mean something.
    _sqlite3.apsw = SimpleNamespace(**{**vars(apsw), "Connection": _database})


bound_rosbags()

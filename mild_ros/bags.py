# SPDX-License-Identifier: Apache-2.0
"""Reading bags without ROS: any rosbag2 (mcap, sqlite3, zstd) or ROS 1 bag; one readable line when one is broken.

A bag comes from anywhere, so everything that a reader may throw on foreign bytes ends here as a `BagError`.
Writing lives in `bag_writer.py`, what can be saved of a broken bag in `salvage.py`.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from mild_core.errors import BagError, DataError
from mild_ros.bag_budgets import (
    DECODED_BYTES,
    DISTRUST,
    FLAT_TYPES,
    SALVAGE,
    Account,
    OverBudgetError,
    check_file,
    check_metadata,
    check_types,
    is_storage,
)
from mild_ros.ros1 import SUFFIX, as_rosbag2
from mild_ros.salvage import salvage as save_what_is_left

METADATA = "metadata.yaml"


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a bag: its message type, e.g. `sensor_msgs/msg/JointState`, and how many messages it holds."""

    type_name: str
    count: int


@dataclass(frozen=True)
class RawMessage:
    """One message as it was recorded: topic, type, time of receipt [ns], and the exact CDR bytes."""

    topic: str
    type_name: str
    time_ns: int
    data: bytes


@cache
def jazzy_types() -> Typestore:
    """All message types of ROS 2 Jazzy, for reading and writing messages without ROS."""
    return get_typestore(Stores.ROS2_JAZZY)


class BagReader:
    """An open bag; made by `open_bag`.

    Attributes:
        path: The folder or file that was opened.
        topics: What is in it.
        lost: What of it is not there, in a few words: of a broken bag that is salvaged, or of types of ROS 1 that
            ROS 2 does not have; "" when it is all there.
        start_ns: Time of its first message.
        duration_s: From its first message to its last.
    """

    def __init__(self, path: Path, reader: AnyReader, lost: str = "") -> None:
        self.path = path
        self.lost = lost
        self.start_ns = int(reader.start_time)
        self.duration_s = max(int(reader.duration), 0) * 1e-9
        self._reader = reader
        self._bag_bytes = Account.of(path).bag_bytes
        self._types: Typestore | None = None
        self.topics: Mapping[str, TopicSummary] = {
            topic: TopicSummary(info.msgtype or "(several types)", info.msgcount)
            for topic, info in reader.topics.items()
        }
        names = [name for connection in reader.connections for name in (connection.topic, connection.msgtype)]
        if not all(isinstance(name, str) and name for name in names):
            raise ValueError("a topic or a type has no name")

    @property
    def types(self) -> Typestore:
        """The types of ROS 2 Jazzy, and those of the bag's own definitions that it does not have."""
        if self._types is None:
            self._types, own = get_typestore(Stores.ROS2_JAZZY), self._reader.typestore.fielddefs
            self._types.register({name: own[name] for name in own if name not in self._types.fielddefs})
        return self._types

    def messages(self, topics: Collection[str] | None = None, start_ns: int | None = None) -> Iterator[RawMessage]:
        """Messages in order of receipt, of `topics` only and not before `start_ns` when given.

        Raises:
            BagError: The bag breaks off, or holds fewer or more messages than its metadata says.
        """
        wanted = [c for c in self._reader.connections if topics is None or c.topic in topics]
        if not wanted:
            return
        account = Account(self._bag_bytes)
        expected, seen = sum(c.msgcount for c in wanted), 0
        source = self._reader.messages(connections=wanted, start=start_ns)
        while True:
            account.use()
            try:
                connection, time_ns, data = next(source)
                account.unpack(len(data))
                raw = RawMessage(connection.topic, connection.msgtype, _time(time_ns), bytes(data))
            except StopIteration:
                break
            except OverBudgetError as error:
                raise error.of(self.path) from None
            except Exception as error:  # any failure on foreign bytes is the bag's fault, whatever its class
                raise BagError(str(self.path), f"breaks off after {seen} messages ({_why(error)})", SALVAGE) from None
            seen += 1
            yield raw
        if seen != expected and start_ns is None:
            raise BagError(str(self.path), f"holds {seen} messages where {expected} are announced", SALVAGE)

    def decode(self, raw: RawMessage) -> Any:
        """The message itself: attributes as in ROS, arrays as NumPy.

        Raises:
            DataError: `undecodable` when the bytes do not hold a message of that type.
        """
        if len(raw.data) > DECODED_BYTES and raw.type_name not in FLAT_TYPES:
            raise DataError("undecodable", f"{raw.topic} at {raw.time_ns}: has {len(raw.data)} bytes")
        own = any(connection.msgtype == raw.type_name for connection in self._reader.connections)
        try:
            if not own:  # a message that was made here, not read from the bag
                return jazzy_types().deserialize_cdr(raw.data, raw.type_name)
            return self._reader.deserialize(raw.data, raw.type_name)
        except Exception as error:  # as above: foreign bytes
            raise DataError("undecodable", f"{raw.topic} at {raw.time_ns}: {_why(error)}") from None


@contextmanager
def open_bag(path: Path | str, *, salvage: bool = False) -> Iterator[BagReader]:
    """Open a rosbag2 (a folder with metadata.yaml, or one .mcap or .db3 file) or a .bag of ROS 1.

    Args:
        path: The bag.
        salvage: Read what is readable of a bag that is broken.

    Raises:
        BagError: There is no bag, or it is broken (and `salvage` does not help).
    """
    path = Path(path)
    if not path.exists():
        raise BagError(str(path), "there is no such bag", "give the folder of a bag (it holds metadata.yaml) or a file")
    try:
        with ExitStack() as stack:
            yield _opened(path, salvage, stack)
    except OverBudgetError as error:
        raise error.of(path) from None


def _opened(path: Path, salvage: bool, stack: ExitStack) -> BagReader:
    """The bag, within its budgets and until `stack` is left."""
    _check_files(path, salvage)
    Account.of(path).use()
    part, lost = path, ""
    if salvage and path.suffix != SUFFIX:
        saved = save_what_is_left(path, _scratch(stack), jazzy_types())
        part, lost = saved.path, saved.lost
    elif path.suffix == SUFFIX:
        part, lost = as_rosbag2(path, _scratch(stack), jazzy_types())
    try:
        reader = stack.enter_context(AnyReader([part], default_typestore=jazzy_types()))
        check_types(reader.typestore.fielddefs)
        bag = BagReader(path, reader, lost)
    except OverBudgetError:
        raise
    except Exception as error:  # rosbags raises many classes here, its own and raw ones
        raise BagError(str(path), f"cannot be read as a bag ({_why(error)})", _remedy(salvage)) from None
    if not salvage:
        _check_counts(path, reader)
    return bag


def _scratch(stack: ExitStack) -> Path:
    return Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="mild_bag_")))


def topic_of_type(reader: BagReader, type_name: str, wanted: str = "") -> str:
    """The topic that is `wanted`, with or without its slash, or the only one of that type; "" is any type.

    Raises:
        BagError: `wanted` is not in the bag or of another type, or several topics or none would do.
    """
    found = sorted(topic for topic, summary in reader.topics.items() if summary.type_name == type_name)
    remedy = f"name one of {', '.join(found)}" if found else "choose another topic, source or bag"
    if wanted:
        topic = next((topic for topic in reader.topics if topic.strip("/") == wanted.strip("/")), "")
        if not topic:
            kind = f" of {type_name}" if type_name else ""
            raise BagError(str(reader.path), f"has no /{wanted.strip('/')}{kind}", remedy)
        given = reader.topics[topic].type_name
        if type_name not in ("", given):
            raise BagError(f"{reader.path}, {topic}", f"is of {given}, not {type_name}", remedy)
        return topic
    if len(found) == 1:
        return found[0]
    if found:
        raise BagError(str(reader.path), f"has several topics of {type_name}", remedy)
    listing = ", ".join(sorted(reader.topics)) or "no topic at all"
    raise BagError(str(reader.path), f"has no topic of {type_name}, but {listing}", "choose another bag or source")


def _check_files(path: Path, salvage: bool) -> None:
    """Refuse a folder whose metadata is missing or points out of the bag, and files that cannot be those of a bag.

    With `salvage` every file counts that could hold messages, without it those that the metadata names.
    """
    if not path.is_dir():
        check_file(path, path)
        if path.suffix not in (".mcap", ".db3", SUFFIX) and not salvage:
            raise BagError(str(path), "is no bag", "give a folder with metadata.yaml, or a .mcap, .db3 or .bag file")
        return
    file = path / METADATA
    if os.path.lexists(file):
        check_file(file, path)
    if salvage:
        for storage in sorted(path.iterdir()):
            if is_storage(storage):
                check_file(storage, path)
        return
    if not file.exists():
        holds = any(path.glob("*.mcap*")) or any(path.glob("*.db3*"))
        remedy = SALVAGE if holds else "give the folder that `ros2 bag record` or `mild_ros record` wrote"
        raise BagError(str(path), "has no metadata.yaml", remedy)
    for name in [PurePosixPath(name) for name in _listed_files(check_metadata(file))]:
        if name.is_absolute() or ".." in name.parts:
            raise BagError(str(file), f"points outside the bag ({name})", DISTRUST)
        if os.path.lexists(path / name.name):
            check_file(path / name.name, path)


def _listed_files(metadata: str) -> list[str]:
    """The storage files that metadata.yaml names, in either way YAML writes a list."""
    found = re.search(r"relative_file_paths:[ \t]*(\[[^\]]*\]|(?:\n[ \t]*-[ \t].*)+)", metadata)
    return re.findall(r"[^\s,\[\]'\"]{2,}", found.group(1)) if found else []


def _check_counts(path: Path, reader: AnyReader) -> None:
    """Compare what metadata.yaml announces with what the storage files say of themselves."""
    for part in reader.readers:
        storages = getattr(getattr(part, "storage", None), "storages", [])
        stored = sum(storage.metadata.message_count for storage in storages)
        if storages and stored != part.message_count:
            said = f"metadata.yaml announces {part.message_count} messages, its files hold {stored}"
            raise BagError(str(path), said, SALVAGE)


def _time(time_ns: object) -> int:
    """A time of receipt as the storage gives it; sqlite3 keeps anything in a column of whole numbers."""
    if not (isinstance(time_ns, int) and 0 <= time_ns < 2**63):
        raise ValueError(f"a message has the time {time_ns!r}")
    return time_ns


def _remedy(salvage: bool) -> str:
    return "nothing readable is left; record it again" if salvage else SALVAGE


def _why(error: Exception) -> str:
    """The first line of an error, without the machine's own paths in it."""
    text = (str(error).strip().splitlines() or [""])[0].rstrip(".")
    return text or type(error).__name__

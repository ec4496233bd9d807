# SPDX-License-Identifier: Apache-2.0
"""Reading bags without ROS: any rosbag2 (mcap, sqlite3, zstd) or ROS 1 bag; one readable line when one is broken.

A bag comes from anywhere, so everything that a reader may throw on foreign bytes ends here as a `BagError`. Messages
of any age come as those of Jazzy (`types.py`). Writing lives in `writer.py`, what can be saved of a broken bag
in `salvage.py`.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from rosbags.interfaces import Connection, ConnectionExtRosbag1, MessageDefinitionFormat, QosDurability
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys.store import Typestore

from mild_core.errors import BagError, DataError
from mild_ros.bag.budgets import (
    DECODED_BYTES,
    DISTRUST,
    FLAT_TYPES,
    SALVAGE,
    Account,
    OverBudgetError,
    check_file,
    check_metadata,
    is_storage,
)
from mild_ros.bag.kinds import begins_as, nothing_in, storages
from mild_ros.bag.salvage import refusal, rewritten
from mild_ros.bag.salvage import salvage as save_what_is_left
from mild_ros.bag.salvage_mcap import is_indexed
from mild_ros.bag.types import Layouts, current_name, jazzy_types

__all__ = ["BagReader", "RawMessage", "TopicSummary", "jazzy_types", "open_bag", "topic_of_type"]

METADATA = "metadata.yaml"
ROS1 = ".bag"
REINDEX = "mend it with `rosbag reindex` of ROS 1, or record it again"


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a bag.

    Attributes:
        type_name: Of its messages, by the name of today, e.g. `sensor_msgs/msg/JointState`.
        count: How many it holds.
        latched: Whether the topic is latched (transient local).
    """

    type_name: str
    count: int
    latched: bool = False


@dataclass(frozen=True)
class RawMessage:
    """One message: topic, type, time of receipt [ns], and CDR bytes, as recorded or brought into the form of today."""

    topic: str
    type_name: str
    time_ns: int
    data: bytes


class BagReader:
    """An open bag; made by `open_bag`.

    Attributes:
        path: The folder or file that was opened.
        topics: What is in it.
        types: Those of ROS 2 Jazzy, and those of the bag's own definitions that Jazzy does not have.
        lost: What of it is not there, in a few words: of a broken bag that is salvaged, or in encodings that are not
            of ROS; "" when it is all there.
        start_ns: Time of its first message.
        duration_s: From its first message to its last.
    """

    def __init__(self, path: Path, reader: Ros1Reader | Ros2Reader, lost: str = "") -> None:
        self.path = path
        self.lost = lost
        self.start_ns = int(reader.start_time)
        self.duration_s = max(int(reader.duration), 0) * 1e-9
        self._reader = reader
        self._remedy = REINDEX if isinstance(reader, Ros1Reader) else SALVAGE
        self._bag_bytes = Account.of(path).bag_bytes
        names = [name for connection in reader.connections for name in (connection.topic, connection.msgtype)]
        if not all(isinstance(name, str) and name for name in names):
            raise ValueError("a topic or a type has no name")
        self._layouts = Layouts()
        self._own = {self._key(c): self._layouts.define(*_definition(c)) for c in reader.connections}
        self.types: Typestore = self._layouts.types
        self.topics: Mapping[str, TopicSummary] = {topic: self._summary(topic) for topic in sorted(reader.topics)}

    def _summary(self, topic: str) -> TopicSummary:
        found = [connection for connection in self._reader.connections if connection.topic == topic]
        names = {current_name(connection.msgtype) for connection in found}
        name = names.pop() if len(names) == 1 else "(several types)"
        return TopicSummary(name, sum(c.msgcount for c in found), any(_is_latched(c) for c in found))

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """Messages in order of receipt, of `topics` only, not before `start_ns` and before `stop_ns` when given.

        Raises:
            BagError: The bag breaks off, or holds fewer or more messages than its metadata says.
        """
        wanted = [c for c in self._reader.connections if topics is None or c.topic in topics]
        if not wanted:
            return
        account, is_ros1 = Account(self._bag_bytes), isinstance(self._reader, Ros1Reader)
        converts = {
            self._key(c): self._layouts.convert(self._own[self._key(c)], c.msgtype, is_ros1=is_ros1) for c in wanted
        }
        expected, seen = sum(c.msgcount for c in wanted), 0
        source = self._reader.messages(connections=wanted, start=start_ns, stop=stop_ns)
        while True:
            account.use()
            try:
                connection, time_ns, data = next(source)
                account.unpack(len(data))
                convert = converts[self._key(connection)]
                content = bytes(data) if convert is None else convert(bytes(data))
                raw = RawMessage(connection.topic, current_name(connection.msgtype), _time(time_ns), content)
            except StopIteration:
                break
            except OverBudgetError as error:
                raise error.of(self.path) from None
            except Exception as error:  # any failure on foreign bytes is the bag's fault, whatever its class
                problem = f"breaks off after {seen} messages ({_why(error)})"
                raise BagError(str(self.path), problem, self._remedy) from None
            seen += 1
            yield raw
        if seen != expected and start_ns is None and stop_ns is None:
            raise BagError(str(self.path), f"holds {seen} messages where {expected} are announced", self._remedy)

    @staticmethod
    def _key(connection: Connection) -> tuple[int, str, str]:
        return connection.id, connection.topic, connection.msgtype

    def decode(self, raw: RawMessage) -> Any:
        """The message itself: attributes as in ROS, arrays as NumPy.

        Raises:
            DataError: `undecodable` when the bytes do not hold a message of that type.
        """
        if len(raw.data) > DECODED_BYTES and raw.type_name not in FLAT_TYPES:
            raise DataError("undecodable", f"{raw.topic} at {raw.time_ns}: has {len(raw.data)} bytes")
        if raw.type_name not in self.types.fielddefs:
            raise DataError("undecodable", f"{raw.topic}: the bag does not define {raw.type_name}")
        try:
            return self.types.deserialize_cdr(raw.data, raw.type_name)
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
    except (OverBudgetError, BagError) as error:
        refused = error.of(path) if isinstance(error, OverBudgetError) else error
        raise (refusal(refused, path) if refused.remedy == SALVAGE else refused) from None


def _opened(path: Path, salvage: bool, stack: ExitStack) -> BagReader:
    """The bag, within its budgets and until `stack` is left."""
    _check_files(path, salvage)
    Account.of(path).use()
    if path.suffix == ROS1:
        return _read(path, path, "", "cannot be read as a bag of ROS 1", REINDEX, stack)
    if salvage:
        saved = save_what_is_left(path, _scratch(stack))
        remedy = "nothing readable is left; record it again"
        return _read(path, saved.path, saved.lost, "cannot be read as a bag", remedy, stack)
    try:
        bag = _read(path, path, "", "cannot be read as a bag", SALVAGE, stack)
    except BagError:
        # A good file may still be one that rosbags does not know: mcap leaves much open.
        again = rewritten(path, _scratch(stack))
        if again is None:
            raise
        return _read(path, again.path, again.lost, "cannot be read as a bag", SALVAGE, stack)
    return bag


def _read(path: Path, part: Path, lost: str, problem: str, remedy: str, stack: ExitStack) -> BagReader:
    """A bag of which `part` holds the messages.

    Raises:
        BagError: It is broken.
    """
    try:
        reader: Ros1Reader | Ros2Reader = Ros1Reader(part) if part.suffix == ROS1 else Ros2Reader(part)
        stack.enter_context(reader)
        bag = BagReader(path, reader, lost)
    except OverBudgetError:
        raise
    except Exception as error:  # rosbags raises many classes here, its own and raw ones
        raise BagError(str(path), f"{problem} ({_why(error)})", remedy) from None
    if part == path and isinstance(reader, Ros2Reader):
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
        if path.suffix not in (".mcap", ".db3", ROS1) and not salvage:
            raise BagError(str(path), "is packed", SALVAGE) if is_storage(path) else nothing_in(path)
        if path.suffix == ROS1 and not begins_as(path, ROS1):
            raise nothing_in(path)
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
        raise BagError(str(path), "has no metadata.yaml", SALVAGE) if storages(path) else nothing_in(path)
    for name in [PurePosixPath(name) for name in _listed_files(check_metadata(file))]:
        if name.is_absolute() or ".." in name.parts:
            raise BagError(str(file), f"points outside the bag ({name})", DISTRUST)
        if os.path.lexists(path / name.name):
            check_file(path / name.name, path)


def _listed_files(metadata: str) -> list[str]:
    """The storage files that metadata.yaml names, in either way YAML writes a list."""
    found = re.search(r"relative_file_paths:[ \t]*(\[[^\]]*\]|(?:\n[ \t]*-[ \t].*)+)", metadata)
    return re.findall(r"[^\s,\[\]'\"]{2,}", found.group(1)) if found else []


def _check_counts(path: Path, reader: Ros2Reader) -> None:
    """Compare what metadata.yaml announces with what the storage files say of themselves."""
    storages = getattr(reader.storage, "storages", None) or [reader.storage]
    stored = sum(storage.metadata.message_count for storage in storages)
    if stored != reader.message_count:
        said = f"metadata.yaml announces {reader.message_count} messages, its files hold {stored}"
        raise BagError(str(path), said, SALVAGE)
    for storage in storages:
        if isinstance(storage, McapReader) and not is_indexed(storage):
            raise BagError(
                str(path), "has a summary that leaves out channels, counts or the order of messages", SALVAGE
            )


def _definition(connection: Connection) -> tuple[str, str, bool]:
    """The text that defines the type of a topic, its name, and whether it is in IDL."""
    form = connection.msgdef.format
    text = "" if form == MessageDefinitionFormat.NONE else connection.msgdef.data
    return text, connection.msgtype, form == MessageDefinitionFormat.IDL


def _is_latched(connection: Connection) -> bool:
    """Whether a topic is latched (transient local)."""
    if isinstance(connection.ext, ConnectionExtRosbag1):
        return bool(connection.ext.latching)
    return any(qos.durability == QosDurability.TRANSIENT_LOCAL for qos in connection.ext.offered_qos_profiles)


def _time(time_ns: object) -> int:
    """A time of receipt as the storage gives it; sqlite3 keeps anything in a column of whole numbers."""
    if not (isinstance(time_ns, int) and 0 <= time_ns < 2**63):
        raise ValueError(f"a message has the time {time_ns!r}")
    return time_ns


def _why(error: Exception) -> str:
    """The first line of an error, without the machine's own paths in it."""
    text = (str(error).strip().splitlines() or [""])[0].rstrip(".")
    return text or type(error).__name__

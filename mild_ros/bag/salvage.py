# SPDX-License-Identifier: Apache-2.0
"""What can be saved of a broken bag: every whole message of its storage files, written again as one good file.

`salvage_mcap.py` and `salvage_sqlite.py` find the messages; here they are brought together, and counted against what
the metadata announces. Good files that rosbags does not know are written again in the same way.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory

from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapReader

from mild_core.errors import BagError
from mild_ros.bag.budgets import METADATA_BYTES, OverBudgetError, check_scratch
from mild_ros.bag.kinds import begins_as, nothing_in, storages
from mild_ros.bag.salvage_found import ROS1_ENCODING, Found, Loss, unpacked
from mild_ros.bag.salvage_mcap import is_indexed, is_whole, mcap_messages
from mild_ros.bag.salvage_sqlite import sqlite_messages
from mild_ros.bag.types import Convert, Layouts, current_name

_PACKED = (".zstd", ".zst")
_COPIED = (".db3", *_PACKED)
CHECK_BYTES = 1 << 24
"""After so many more bytes it is looked how many there are in all, and how full the disk is."""

GLANCE_BYTES = 64 << 20
"""A larger file that has to be copied or unpacked to look into it is taken to hold a message."""


@dataclass(frozen=True)
class Salvaged:
    """What was saved.

    Attributes:
        path: An mcap file with all of it.
        saved: How many messages.
        lost: What was not, in a few words; "" when nothing is known to be missing.
        is_whole: Whether all messages of ROS were saved.
    """

    path: Path
    saved: int
    lost: str
    is_whole: bool


def salvage(path: Path, scratch: Path, most: float = inf) -> Salvaged:
    """Write what is readable of a bag again.

    Args:
        path: The bag's folder or one storage file.
        scratch: An empty folder for it.
        most: Messages after which it ends.

    Raises:
        BagError: There is nothing to read.
    """
    files = storages(path)
    loss = Loss()
    with Writer(scratch / "salvaged", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        written = _Rewriting(writer, sum(file.stat().st_size for file in files))
        for file in files:
            for found in _messages(file, scratch, loss) if written.saved < most else ():
                written.add(found, loss)
                if written.saved >= most:
                    break
        if not written.saved:
            raise nothing_in(path)
    announced = _announced(path / "metadata.yaml") if path.is_dir() else None
    foreign = sum(loss.foreign.values())
    lost = _loss_text(loss, written.saved + foreign, announced)
    whole = not lost
    if foreign:
        encodings = ", ".join(f"{count} in {name}" for name, count in loss.foreign.items())
        lost = "; ".join(filter(None, (lost, f"left out, as they are no messages of ROS: {encodings}")))
    return Salvaged(scratch / "salvaged" / "salvaged.mcap", written.saved, lost, whole)


def refusal(error: BagError, path: Path) -> BagError:
    """A refusal that advises to salvage; where that would find nothing, what is true in its place.

    Args:
        error: Why the bag is refused as it is.
        path: The bag.
    """
    files = storages(path)
    if any(file.stat().st_size > GLANCE_BYTES and begins_as(file, ending) for file in files for ending in _COPIED):
        return error
    try:
        with TemporaryDirectory(prefix="mild_bag_") as scratch:
            salvage(path, Path(scratch), most=1)
    except OverBudgetError as over:
        return BagError(error.thing, error.problem, over.remedy)
    except BagError as nothing:
        return BagError(nothing.thing, nothing.problem, nothing.remedy)
    return error


def rewritten(path: Path, scratch: Path) -> Salvaged | None:
    """A good bag of mcap files that rosbags cannot read as they are: of ROS 1, or that say little of themselves.

    Args:
        path: The bag's folder or file.
        scratch: An empty folder for what is written.

    Returns:
        All its messages; None when it is broken, or when its files are not the reason why it cannot be read.
    """
    files = storages(path)
    if not files or not all(file.suffix == ".mcap" and is_whole(file) for file in files):
        return None
    if not any(_needs_rewriting(file) for file in files):
        return None
    try:
        saved = salvage(path, scratch)
    except BagError:
        return None
    return saved if saved.is_whole else None


def _needs_rewriting(file: Path) -> bool:
    reader = McapReader(file)
    try:
        reader.open()
    except OverBudgetError:
        raise
    except Exception:  # what it throws on what it does not know
        return True
    try:
        return not is_indexed(reader)
    finally:
        reader.close()


def _messages(file: Path, scratch: Path, loss: Loss) -> Iterator[Found]:
    if file.suffix in _PACKED:
        file = unpacked(file, scratch / file.stem, loss)
    if file.suffix == ".mcap":
        yield from mcap_messages(file, loss)
    elif file.suffix == ".db3":
        yield from sqlite_messages(file, scratch / "database", loss)
        shutil.rmtree(scratch / "database", ignore_errors=True)


def _announced(metadata: Path) -> int | None:
    """How many messages metadata.yaml speaks of; it may itself be broken."""
    if not metadata.is_file() or metadata.stat().st_size > METADATA_BYTES:
        return None
    found = re.search(r"^  message_count: *(\d{1,15})\s*$", metadata.read_text(errors="replace"), re.MULTILINE)
    return int(found.group(1)) if found else None


def _loss_text(loss: Loss, saved: int, announced: int | None) -> str:
    if announced is not None and announced > saved:
        return f"{announced - saved} of {announced} messages are lost"
    parts = [f"at least {loss.messages} messages are lost"] if loss.messages else []
    parts += [f"{loss.unread_bytes} bytes cannot be read"] if loss.unread_bytes else []
    return " and ".join(parts)


class _Rewriting:
    """Messages of any origin into one new file."""

    def __init__(self, writer: Writer, bag_bytes: int) -> None:
        self.saved = self._written = self._checked = 0
        self._bag_bytes, self._scratch = bag_bytes, writer.path.parent
        self._writer = writer
        self._connections: dict[tuple[str, str, str, str], tuple[Connection, Convert] | None] = {}
        self._written_to: dict[tuple[str, str], Connection] = {}
        self._layouts = Layouts()

    def add(self, found: Found, loss: Loss) -> None:
        """Write a message; one of an unknown type is left out."""
        key = found.topic, found.type_name, found.definition, found.encoding
        if key not in self._connections:
            self._connections[key] = self._connection(found)
        target = self._connections[key]
        if target is None:
            loss.messages += 1
            return
        connection, convert = target
        data = convert(found.data)
        self._written += len(data)
        if self._written >= self._checked + CHECK_BYTES:
            self._checked = self._written
            check_scratch(self._scratch, self._written, self._bag_bytes)
        self._writer.write(connection, found.time_ns, data)
        self.saved += 1

    def _connection(self, found: Found) -> tuple[Connection, Convert] | None:
        """The type as the bag itself defines it, or, where that is broken or absent, as ROS does."""
        name = current_name(found.type_name)
        is_idl = found.schema_encoding.endswith("idl")
        own = self._layouts.define(found.definition, name, is_idl)
        is_ros1 = found.encoding == ROS1_ENCODING
        convert = self._layouts.convert(own, name, is_ros1=is_ros1)
        if name not in self._layouts.types.fielddefs:
            return None
        if (found.topic, name) not in self._written_to:
            self._written_to[found.topic, name] = self._writer.add_connection(
                found.topic, name, typestore=self._layouts.types
            )
        return self._written_to[found.topic, name], convert or bytes

# SPDX-License-Identifier: Apache-2.0
"""What can be saved of a broken bag: every whole message of its storage files, written again as one good file.

`salvage_mcap.py` and `salvage_sqlite.py` find the messages; here they are brought together, and counted against what
the metadata announces.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from mild_core.errors import BagError
from mild_ros.bag_budgets import (
    METADATA_BYTES,
    OverBudgetError,
    check_scratch,
    is_storage,
    types_from_idl,
    types_from_msg,
)
from mild_ros.salvage_found import Found, Loss, unpacked
from mild_ros.salvage_mcap import mcap_messages
from mild_ros.salvage_sqlite import sqlite_messages

_PACKED = (".zstd", ".zst")
CHECK_BYTES = 1 << 24
"""After so many more bytes it is looked how many there are in all, and how full the disk is."""


@dataclass(frozen=True)
class Salvaged:
    """What was saved.

    Attributes:
        path: An mcap file with all of it.
        saved: How many messages.
        lost: What was not, in a few words; "" when nothing is known to be missing.
    """

    path: Path
    saved: int
    lost: str


def salvage(path: Path, scratch: Path, types: Typestore) -> Salvaged:
    """Write what is readable of a bag again.

    Args:
        path: The bag's folder or one storage file.
        scratch: An empty folder for it.
        types: Known when the bag does not define its own.

    Raises:
        BagError: There is nothing to read.
    """
    files = sorted(file for file in path.iterdir() if is_storage(file)) if path.is_dir() else [path]
    loss = Loss()
    with Writer(scratch / "salvaged", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        written = _Rewriting(writer, types, sum(file.stat().st_size for file in files))
        for file in files:
            for found in _messages(file, scratch, loss):
                written.add(found, loss)
        if not written.saved:
            raise BagError(str(path), "holds no readable message", "record it again")
    announced = _announced(path / "metadata.yaml") if path.is_dir() else None
    lost = _told(loss, written.saved, announced)
    return Salvaged(scratch / "salvaged" / "salvaged.mcap", written.saved, lost)


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


def _told(loss: Loss, saved: int, announced: int | None) -> str:
    if announced is not None and announced > saved:
        return f"{announced - saved} of {announced} messages are lost"
    parts = [f"at least {loss.messages} messages are lost"] if loss.messages else []
    parts += [f"{loss.unread_bytes} bytes cannot be read"] if loss.unread_bytes else []
    return " and ".join(parts)


class _Rewriting:
    """Messages of any origin into one new file."""

    def __init__(self, writer: Writer, types: Typestore, bag_bytes: int) -> None:
        self.saved = self._written = self._checked = 0
        self._bag_bytes, self._scratch = bag_bytes, writer.path.parent
        self._writer = writer
        self._connections: dict[tuple[str, str], Connection | None] = {}
        self._known = types

    def add(self, found: Found, loss: Loss) -> None:
        """Write a message; one of a type that nobody knows is lost."""
        key = found.topic, found.type_name
        if key not in self._connections:
            self._connections[key] = self._connection(found)
        connection = self._connections[key]
        if connection is None:
            loss.messages += 1
            return
        self._written += len(found.data)
        if self._written >= self._checked + CHECK_BYTES:
            self._checked = self._written
            check_scratch(self._scratch, self._written, self._bag_bytes)
        self._writer.write(connection, found.time_ns, found.data)
        self.saved += 1

    def _connection(self, found: Found) -> Connection | None:
        """The type as the bag itself defines it, or, where that is broken or absent, as ROS 2 does."""
        definition = found.definition if _is_whole(found.definition, found.type_name) else None
        if definition is None and found.type_name not in self._known.fielddefs:
            return None
        store: Typestore | None = None if definition else self._known
        digest = None if store else "unknown"
        return self._writer.add_connection(
            found.topic, found.type_name, typestore=store, msgdef=definition, rihs01=digest
        )


def _is_whole(definition: str, type_name: str) -> bool:
    """Whether a message definition can be read and defines that type."""
    rule = "=" * 80 + "\n"
    try:
        if definition.startswith(f"{rule}IDL: "):
            parts = [part.split("\n", 1)[1] for part in definition.split(rule)[1:]]
            types = {name: kind for part in parts for name, kind in types_from_idl(part).items()}
        else:
            types = types_from_msg(definition, type_name)
        get_typestore(Stores.EMPTY).register(types)
    except OverBudgetError:
        raise
    except Exception:  # a parser on foreign bytes
        return False
    return bool(definition) and type_name in types

# SPDX-License-Identifier: Apache-2.0
"""Bags with one thing wrong in each, and what comes of opening them: the table of the documentation.

Each is created when the table is written, from a good bag of 24 messages, and opened twice: as it is, and with
salvage.
"""

from __future__ import annotations

import re
import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from mild_core.errors import BagError, DataError
from mild_ros.bag.budgets import SALVAGE
from mild_ros.bag.encoding import encode
from mild_ros.bag.reader import jazzy_types, open_bag
from mild_ros.bag.writer import create_bag

COUNT = 24
CHUNK = 6
"""Messages in each chunk of a bag as `record` writes it."""

STRING, START_NS, STEP_NS = "std_msgs/msg/String", 10**9, 10**7
TEXTS = [f"message {index} of {COUNT} {'.' * 400}" for index in range(COUNT)]
"""Long enough that a database of them has several pages."""

NOISE = b"\xff" * 16


def write_ours(folder: Path) -> None:
    """As `record` writes it: in mcap, chunk by chunk."""
    text = jazzy_types().types[STRING]
    with create_bag(folder) as bag:
        for index, words in enumerate(TEXTS):
            bag.write("/text", STRING, START_NS + index * STEP_NS, encode(text(words)))
            if index % CHUNK == CHUNK - 1:
                bag.flush()


def write_foreign(storage: StoragePlugin, mode: CompressionMode) -> Callable[[Path], None]:
    """As other tools write it."""

    def write(folder: Path) -> None:
        text = jazzy_types().types[STRING]
        writer = Writer(folder, version=9, storage_plugin=storage)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            topic = writer.add_connection("/text", STRING, typestore=jazzy_types())
            for index, words in enumerate(TEXTS):
                writer.write(topic, START_NS + index * STEP_NS, encode(text(words)))

    return write


def write_ros1(folder: Path) -> None:
    """A bag of ROS 1, in a folder of its own."""
    folder.mkdir()
    types = get_typestore(Stores.ROS1_NOETIC)
    with Ros1Writer(folder / "old.bag") as writer:
        topic = writer.add_connection("/text", STRING, typestore=types)
        for index, words in enumerate(TEXTS):
            data = types.serialize_ros1(types.types[STRING](words), STRING)
            writer.write(topic, START_NS + index * STEP_NS, data)


write_sqlite = write_foreign(StoragePlugin.SQLITE3, CompressionMode.NONE)
write_packed = write_foreign(StoragePlugin.MCAP, CompressionMode.FILE)


@dataclass(frozen=True)
class Opened:
    """What came of opening a bag and reading everything.

    Attributes:
        read: How many messages.
        undecodable: How many of these hold no message of their type.
        lost: What is said to be lost.
        error: The line that refuses the bag, or says where it breaks off; None when it ends well.
    """

    read: int = 0
    undecodable: int = 0
    lost: str = ""
    error: BagError | None = None


def opened(path: Path, *, salvage: bool) -> Opened:
    """Open a bag and read everything."""
    read = undecodable = 0
    lost = ""
    try:
        with open_bag(path, salvage=salvage) as bag:
            lost = bag.lost
            for raw in bag.messages():
                read += 1
                try:
                    bag.decode(raw)
                except DataError:
                    undecodable += 1
    except BagError as error:
        return Opened(read, undecodable, lost, error)
    return Opened(read, undecodable, lost)


def _metadata(change: Callable[[str], str]) -> Callable[[Path], None]:
    """Harm metadata.yaml."""

    def harm(bag: Path) -> None:
        file = bag / "metadata.yaml"
        file.write_text(change(file.read_text()))

    return harm


def _storage(change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    """Harm the file that holds the messages."""

    def harm(bag: Path) -> None:
        (file,) = (file for file in bag.iterdir() if file.suffix != ".yaml")
        file.write_bytes(change(file.read_bytes()))

    return harm


def _third_chunk(data: bytes) -> int:
    """Where the compressed bytes of the third chunk begin."""
    return [found.end() for found in re.finditer(b"zstd", data)][2] + 8


def _half(data: bytes) -> bytes:
    return data[: len(data) // 2]


def _most(data: bytes) -> bytes:
    return data[: len(data) * 4 // 5]


def _overwritten(data: bytes, at: int) -> bytes:
    return data[:at] + NOISE + data[at + len(NOISE) :]


def _database_page(data: bytes) -> bytes:
    """Overwrite one of the pages of a database that hold messages."""
    page = int.from_bytes(data[16:18], "big")
    at = len(data) // page * 3 // 4 * page
    return data[:at] + b"\xff" * page + data[at + page :]


def _without_metadata(bag: Path) -> None:
    (bag / "metadata.yaml").unlink()


def _killed_database(bag: Path) -> None:
    """As a recorder that is killed leaves it: the newest rows are in the journal only, and there is no metadata."""
    (whole,) = bag.glob("*.db3")
    copies = {}
    with closing(sqlite3.connect(whole)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute(f"UPDATE messages SET timestamp = timestamp + 1 WHERE id > {COUNT // 2}")
        database.commit()
        for file in bag.glob("*.db3*"):
            copies[file] = file.read_bytes()
    for file, data in copies.items():
        if not file.name.endswith("-shm"):
            file.write_bytes(data)
    _without_metadata(bag)


def _undecodable(bag: Path) -> None:
    """A good bag, of which one message is none of its type."""
    shutil.rmtree(bag)
    with create_bag(bag) as writer:
        for data in (encode(jazzy_types().types[STRING]("good")), b"\x00\x01\x00\x00" + NOISE):
            writer.write("/text", STRING, START_NS, data)


def _emptied(bag: Path) -> None:
    for file in bag.iterdir():
        file.unlink()


Write = Callable[[Path], None]

BROKEN: dict[str, tuple[Write, Write]] = {
    "`metadata.yaml` missing": (write_ours, _without_metadata),
    "`metadata.yaml` empty": (write_ours, _metadata(lambda text: "")),
    "`metadata.yaml` garbage": (write_ours, _metadata(lambda text: "a: [1, 2")),
    "`metadata.yaml` without a key": (write_ours, _metadata(lambda text: text.replace("  duration:", "  length:"))),
    "`metadata.yaml` of version 99": (
        write_ours,
        _metadata(lambda text: text.replace("version: 9\n", "version: 99\n")),
    ),
    "`metadata.yaml` with a wrong count": (write_ours, _metadata(lambda text: text.replace(f": {COUNT}", ": 30"))),
    "`metadata.yaml` names a file outside": (write_ours, _metadata(lambda text: text.replace("- bag", "- ../bag"))),
    "`metadata.yaml` names a file that is not there": (
        write_ours,
        _metadata(lambda text: text.replace("- bag", "- b")),
    ),
    "mcap cut off in the third chunk: killed recorder, full disk": (
        write_ours,
        _storage(lambda data: data[: _third_chunk(data) + 20]),
    ),
    "mcap overwritten where the third chunk begins": (
        write_ours,
        _storage(lambda data: _overwritten(data, _third_chunk(data))),
    ),
    "mcap overwritten inside of the third chunk": (
        write_ours,
        _storage(lambda data: _overwritten(data, _third_chunk(data) + 20)),
    ),
    "mcap without its index": (write_ours, _storage(lambda data: data[:-40])),
    "mcap of a single chunk, zstd per file, cut off": (write_packed, _storage(_half)),
    "sqlite3 cut off": (write_sqlite, _storage(_most)),
    "sqlite3 with a broken page": (write_sqlite, _storage(_database_page)),
    "sqlite3 with its journal still beside it: killed recorder": (write_sqlite, _killed_database),
    "one of two messages does not decode": (write_ours, _undecodable),
    "an empty folder": (write_ours, _emptied),
    "an empty file": (write_ours, _storage(lambda data: b"")),
    "garbage": (write_ours, _storage(lambda data: NOISE * 40)),
    "ROS 1, cut off": (write_ros1, _storage(_half)),
}
"""By what is wrong: how the good bag is written, and what is done to it."""


def broken_bag(name: str, folder: Path) -> Path:
    """Make the bag of that name in `BROKEN` in a folder; returns what to open."""
    write, harm = BROKEN[name]
    bag = folder / "bag"
    write(bag)
    harm(bag)
    return bag / "old.bag" if write is write_ros1 else bag


@cache
def bag_faults_markdown() -> str:
    """Every broken bag and what comes of opening it; made once in a process."""
    lines = ["| Fault | As it is | With `--salvage` |", "|---|---|---|"]
    for name in BROKEN:
        with tempfile.TemporaryDirectory(prefix="mild_bag_") as scratch:
            path = broken_bag(name, Path(scratch))
            cells = [_outcome_text(opened(path, salvage=salvage)) for salvage in (False, True)]
        lines.append(f"| {name} | {cells[0]} | {cells[1]} |")
    return "\n".join(lines) + "\n"


def _outcome_text(found: Opened) -> str:
    """An outcome as the table says it; what a foreign reader says in brackets differs with its version."""
    parts = [f"{found.read} read"] if found.read else []
    parts += [f"{found.undecodable} counted as `undecodable`"] if found.undecodable else []
    parts += [f"*{found.lost}*"] if found.lost else []
    if found.error is not None:
        problem = re.sub(r" [(].*[)]", "", found.error.problem)
        remedy = "" if found.error.remedy == SALVAGE else f"; {found.error.remedy}"
        parts.append(f"{'then' if found.read else 'refused:'} *{problem}{remedy}*")
    return ", ".join(parts)

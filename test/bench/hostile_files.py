# SPDX-License-Identifier: Apache-2.0
"""Hostile files: each is made, given to the real command line, and must be refused in one line and within its means.

    ./mild measure hostile_files [--only WORD] [--plain] [--json] [--write]

Every command runs in a process of its own that may take two gigabytes of memory beyond what the program itself has
mapped, write files of one gigabyte and compute for two minutes. Printed is the table of docs/bags.md: what a file does,
the line that refuses it, seconds, peak memory and the most bytes that lay in the folder for temporary files.
"""

from __future__ import annotations

import argparse
import bz2
import json
import os
import re
import resource
import shutil
import socket
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from io import BytesIO
from pathlib import Path

import lz4.frame
import zstandard
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from mild_ros.bag.encoding import encode
from mild_ros.bag.reader import jazzy_types
from mild_ros.bag.writer import create_bag
from mild_ros.environment.processes import PYTHON
from test.faults.broken_bags import STRING
from test.habits.tree import ROOT
from test.ros.foreign_messages import foreign, foreign_types

MEMORY_BYTES, FILE_BYTES, SECONDS = 2 << 30, 1 << 30, 120
"""Limits of the process that opens a hostile file."""

START_NS, YEAR_NS = 10**18, 365 * 24 * 3600 * 10**9
MARKERS = "visualization_msgs/msg/MarkerArray"
NO_PERSON = encode(jazzy_types().types[MARKERS]([]))
"""What a tracker sends when it sees no person."""

DOCUMENT = "docs/bags.md"

MAGIC = b"\x89MCAP0\r\n"


def _write(storage: StoragePlugin, mode: CompressionMode) -> Callable[[Path], None]:
    """A good bag of a tracker that sees no person."""

    def write(bag: Path) -> None:
        writer = Writer(bag, version=9, storage_plugin=storage)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            topic = writer.add_connection("/body_tracking_data", MARKERS, typestore=jazzy_types())
            for index in range(24):
                writer.write(topic, START_NS + index * 10**7, NO_PERSON)

    return write


write_packed_messages = _write(StoragePlugin.SQLITE3, CompressionMode.MESSAGE)
write_packed_file = _write(StoragePlugin.MCAP, CompressionMode.FILE)
write_sqlite = _write(StoragePlugin.SQLITE3, CompressionMode.NONE)
write_ours = _write(StoragePlugin.MCAP, CompressionMode.STORAGE)


def zeros_zstd(gigabytes: float) -> bytes:
    """So many zeros, packed: frames of 128 MB one behind the other."""
    frame = zstandard.ZstdCompressor().compress(bytes(128 << 20))
    return frame * round(gigabytes * 8)


def _storage(bag: Path) -> Path:
    (file,) = (file for file in bag.iterdir() if file.suffix != ".yaml")
    return file


def _packed_file(bag: Path) -> None:
    write_packed_file(bag)
    _storage(bag).write_bytes(zeros_zstd(20))


def _packed_message(bag: Path) -> None:
    write_packed_messages(bag)
    with closing(sqlite3.connect(_storage(bag))) as database:
        database.execute("UPDATE messages SET data = ? WHERE id = 3", (zeros_zstd(8),))
        database.commit()


def record(kind: int, content: bytes) -> bytes:
    """One record of an mcap file."""
    return struct.pack("<BQ", kind, len(content)) + content


def text(words: str) -> bytes:
    """A text with its length before it."""
    return struct.pack("<I", len(words.encode())) + words.encode()


def message(channel: int, time_ns: int, data: bytes) -> bytes:
    """A message as it stands in a chunk."""
    return record(5, struct.pack("<HIQQ", channel, 0, time_ns, time_ns) + data)


@dataclass(frozen=True)
class Chunk:
    """A chunk of an mcap file, and what it says of itself."""

    content: bytes
    size: int
    compression: str = "zstd"
    start_ns: int = START_NS
    end_ns: int = START_NS


def write_mcap(
    file: Path,
    chunks: list[Chunk],
    definition: str = "",
    qualities: str = "",
    times: int = 1,
    type_name: str = MARKERS,
) -> None:
    """An mcap file of chunks that may say anything, each listed in the index `times` times."""
    definition = definition or jazzy_types().generate_msgdef(MARKERS, ros_version=2)[0]
    schema = record(3, struct.pack("<H", 1) + text(type_name) + text("ros2msg") + text(definition))
    about = text("offered_qos_profiles") + text(qualities) if qualities else b""
    channel = struct.pack("<HH", 1, 1) + text("/body_tracking_data") + text("cdr")
    channel = record(4, channel + struct.pack("<I", len(about)) + about)
    data = MAGIC + record(1, text("ros2") + text("hostile")) + schema + channel
    index = b""
    for chunk in chunks:
        head = struct.pack("<QQQI", chunk.start_ns, chunk.end_ns, chunk.size, 0) + text(chunk.compression)
        whole = record(6, head + struct.pack("<Q", len(chunk.content)) + chunk.content)
        messages = record(7, struct.pack("<HI", 1, 16) + struct.pack("<QQ", chunk.start_ns, 0))
        listed = struct.pack("<QQQQ", chunk.start_ns, chunk.end_ns, len(data), len(whole))
        listed += struct.pack("<IHQ", 10, 1, len(data) + len(whole)) + struct.pack("<Q", len(messages))
        listed += text(chunk.compression) + struct.pack("<QQ", len(chunk.content), chunk.size)
        index += record(8, listed) * times
        data += whole + messages
    data += record(15, struct.pack("<I", 0))
    count = len(chunks) * times
    statistics = struct.pack("<QHIIIIQQ", count, 1, 1, 0, 0, count, START_NS, START_NS)
    statistics += struct.pack("<IHQ", 10, 1, count)
    summary = schema + channel + index + record(11, statistics)
    data_end = len(data)
    file.write_bytes(data + summary + record(2, struct.pack("<QQI", data_end, 0, 0)) + MAGIC)


def _chunk(kind: str, packed: bytes, size: int) -> Callable[[Path], None]:
    def write(bag: Path) -> None:
        write_mcap(bag.with_suffix(".mcap"), [Chunk(packed, size, kind)])

    return write


def _zstd_chunk(bag: Path) -> None:
    write_mcap(bag.with_suffix(".mcap"), [Chunk(zeros_zstd(2), 2 << 30)])


def _lying_chunk(bag: Path) -> None:
    write_mcap(bag.with_suffix(".mcap"), [Chunk(zeros_zstd(8), 1000)])


def _lz4_chunk(bag: Path) -> None:
    write_mcap(bag.with_suffix(".mcap"), [Chunk(lz4.frame.compress(bytes(1 << 30)), 1 << 30, "lz4")])


def _one_message(size: int, data: bytes = NO_PERSON) -> bytes:
    """A chunk of `size` bytes: a message, and a record of zeros that is not needed."""
    first = message(1, START_NS, data)
    return first + record(0x80, bytes(size - len(first) - 9))


def _overlapping_chunks(bag: Path) -> None:
    content = zstandard.ZstdCompressor().compress(_one_message(200 << 20))
    write_mcap(bag.with_suffix(".mcap"), [Chunk(content, 200 << 20, end_ns=START_NS + 10**9)] * 40)


def _repeated_chunk(bag: Path) -> None:
    content = zstandard.ZstdCompressor().compress(_one_message(200 << 20))
    write_mcap(bag.with_suffix(".mcap"), [Chunk(content, 200 << 20)], times=10_000)


def _tiny_messages(bag: Path) -> None:
    content = message(1, START_NS, b"") * 8_000_000
    write_mcap(bag.with_suffix(".mcap"), [Chunk(zstandard.ZstdCompressor().compress(content), len(content))])


def _definition(bag: Path) -> None:
    content = _one_message(1000)
    write_mcap(bag.with_suffix(".mcap"), [Chunk(content, 1000, "")], "string[500000000] markers")


def _long_definition(bag: Path) -> None:
    content = _one_message(1000)
    definition = "".join(f"float64 a_number_{index}\n" for index in range(200_000))
    write_mcap(bag.with_suffix(".mcap"), [Chunk(content, 1000, "")], definition)


def aliases(levels: int = 12) -> str:
    """YAML in which each line stands for ten of the line before."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, levels)]
    return "\n".join(lines) + "\n"


def _qualities(bag: Path) -> None:
    write_mcap(bag.with_suffix(".mcap"), [Chunk(_one_message(1000), 1000, "")], qualities="[" * 100_000)


def _metadata(change: Callable[[str], str]) -> Callable[[Path], None]:
    def write(bag: Path) -> None:
        write_ours(bag)
        file = bag / "metadata.yaml"
        file.write_text(change(file.read_text()))

    return write


def _endless_view(bag: Path) -> None:
    """The definitions of messages never end."""
    write_sqlite(bag)
    with closing(sqlite3.connect(_storage(bag))) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute(
            "CREATE VIEW message_definitions AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
            " SELECT i AS id, 'a' AS topic_type, 'ros2msg' AS encoding, 'b' AS encoded_message_definition, '' AS"
            " type_description_hash FROM n"
        )
        database.commit()


def _endless_messages(bag: Path) -> None:
    """The messages themselves never end: only --salvage would ask."""
    write_sqlite(bag)
    with closing(sqlite3.connect(_storage(bag))) as database:
        database.execute("ALTER TABLE messages RENAME TO kept")
        database.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id,"
            " 1 AS topic_id, i AS timestamp, zeroblob(100000000) AS data FROM n"
        )
        database.commit()


def _endless_tree(bag: Path) -> None:
    """Ten pages of a database, each of which leads sixty times to the next: 60^10 rows."""
    write_sqlite(bag)
    file = _storage(bag)
    with closing(sqlite3.connect(file)) as database:
        (root,) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
        # No index, so that the rows themselves have to be walked.
        database.execute("DROP INDEX IF EXISTS timestamp_idx")
        database.commit()
    data = bytearray(file.read_bytes())
    size = int.from_bytes(data[16:18], "big")
    first, pages = (root - 1) * size, len(data) // size
    data += bytes(9 * size) + data[first : first + size]  # the root is a leaf: so few messages take one page
    for level in range(10):
        page = root if level == 0 else pages + level
        at, child = (page - 1) * size, pages + level + 1
        cells = b"".join(struct.pack(">IB", child, number + 1) for number in range(60))
        head = struct.pack(">BHHHBI", 5, 0, 60, size - len(cells), 0, child)
        pointers = b"".join(struct.pack(">H", size - len(cells) + 5 * number) for number in range(60))
        data[at : at + size] = (head + pointers).ljust(size - len(cells), b"\0") + cells
    data[28:32] = struct.pack(">I", len(data) // size)
    file.write_bytes(bytes(data))


def _pipe(bag: Path) -> None:
    write_ours(bag)
    _storage(bag).unlink()
    os.mkfifo(bag / "bag.mcap")


def _socket(bag: Path) -> None:
    write_ours(bag)
    file = _storage(bag)
    file.unlink()
    here = os.getcwd()
    os.chdir(bag)  # the name of a socket may be no longer than a hundred characters
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(file.name)
    os.chdir(here)


def _linked(target: str, name: str = "bag.mcap") -> Callable[[Path], None]:
    def write(bag: Path) -> None:
        write_ours(bag)
        (bag / name).unlink()
        (bag / name).symlink_to(target)

    return write


def _link_out(bag: Path) -> None:
    write_ours(bag)
    shutil.move(_storage(bag), bag.parent / "elsewhere.mcap")
    (bag / "bag.mcap").symlink_to("../elsewhere.mcap")


def _pipe_metadata(bag: Path) -> None:
    write_ours(bag)
    (bag / "metadata.yaml").unlink()
    os.mkfifo(bag / "metadata.yaml")


def _pipe_bag(bag: Path) -> None:
    os.mkfifo(bag.with_suffix(".mcap"))


def _sparse(bag: Path) -> None:
    write_ours(bag)
    with _storage(bag).open("r+b") as file:
        file.truncate(8 << 40)


def _times(*times_ns: int) -> Callable[[Path], None]:
    """The first messages of the shipped handshake, at other times."""

    def write(bag: Path) -> None:
        from mild_ros.bag.reader import open_bag

        with open_bag(ROOT / "bags" / "handshake") as given, create_bag(bag) as writer:
            people = [topic for topic in given.topics if "JointState" not in given.topics[topic].type_name]
            for raw, time_ns in zip(given.messages(people[:1]), times_ns, strict=False):
                writer.write(raw.topic, raw.type_name, time_ns, raw.data)

    return write


def _many_markers(bag: Path) -> None:
    """Markers of 150 bytes each, of which Python makes objects of 5 kB."""
    many = foreign(MARKERS, markers=[foreign("visualization_msgs/msg/Marker")] * 70_000)
    data = bytes(foreign_types().serialize_cdr(many, MARKERS))
    with create_bag(bag) as writer:
        for index in range(2):
            writer.write("/body_tracking_data", MARKERS, START_NS + index, data)


def _ros1_bz2(bag: Path) -> None:
    """A chunk of ROS 1 that unpacks to eight gigabytes: streams of bzip2 one behind the other."""
    types = get_typestore(Stores.ROS1_NOETIC)
    file = bag.with_suffix(".bag")
    writer = Ros1Writer(file)
    writer.set_compression(Ros1Writer.CompressionFormat.BZ2)
    with writer:
        topic = writer.add_connection("/text", STRING, typestore=types)
        writer.write(topic, START_NS, types.serialize_ros1(types.types[STRING]("a"), STRING))
    data = file.read_bytes()
    begin = data.index(b"BZh")
    (length,) = struct.unpack_from("<I", data, begin - 4)
    bomb = bz2.compress(bytes(256 << 20)) * 32
    grown = len(bomb) - length
    head = data[: begin - 4] + struct.pack("<I", len(bomb)) + bomb
    tail = data[begin + length :]
    position = re.search(rb"index_pos=(.{8})", head, re.DOTALL)
    assert position is not None
    (index,) = struct.unpack("<Q", position.group(1))
    head = head[: position.start(1)] + struct.pack("<Q", index + grown) + head[position.end(1) :]
    file.write_bytes(head + tail)


def _golden(bag: Path) -> None:
    """A model whose golden sample claims 10^12 numbers, with the right digest."""
    import hashlib

    shutil.copytree(ROOT / "models" / "yumi_buetepage_ahead", bag)
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }".ljust(117) + b"\n"
    member = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head
    packed = BytesIO()
    import zipfile

    with zipfile.ZipFile(packed, "w") as archive:
        for name in ("windows", "positions", "covariance", "belief", "probability", "phase"):
            archive.writestr(f"{name}.npy", member)
    (bag / "golden.npz").write_bytes(packed.getvalue())
    manifest = json.loads((bag / "manifest.json").read_text())
    manifest["sha256"]["golden.npz"] = hashlib.sha256(packed.getvalue()).hexdigest()
    (bag / "manifest.json").write_text(json.dumps(manifest))


def _weights(bag: Path) -> None:
    """Weights whose head claims 10^12 numbers, with the right digest."""
    import hashlib

    shutil.copytree(ROOT / "models" / "yumi_buetepage_ahead", bag)
    head = json.dumps({"a": {"dtype": "F32", "shape": [10**12], "data_offsets": [0, 4 * 10**12]}}).encode()
    content = struct.pack("<Q", len(head)) + head
    (bag / "weights.safetensors").write_bytes(content)
    manifest = json.loads((bag / "manifest.json").read_text())
    manifest["sha256"]["weights.safetensors"] = hashlib.sha256(content).hexdigest()
    (bag / "manifest.json").write_text(json.dumps(manifest))


def _deep_manifest(bag: Path) -> None:
    shutil.copytree(ROOT / "models" / "yumi_buetepage_ahead", bag)
    (bag / "manifest.json").write_text("[" * 200_000)


def _config(words: str) -> Callable[[Path], None]:
    def write(bag: Path) -> None:
        bag.with_suffix(".yaml").write_text(words)

    return write


def _robot(words: str) -> Callable[[Path], None]:
    def write(bag: Path) -> None:
        bag.with_suffix(".toml").write_text(words)

    return write


def _data_set(bag: Path) -> None:
    """A recording of half a megabyte whose four arrays unpack to 8 GB."""
    import zipfile

    with zipfile.ZipFile(bag.with_suffix(".npz"), "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("train_data", "train_labels", "test_data", "test_labels"):
            head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (33554432,), }".ljust(117) + b"\n"
            archive.writestr(f"{name}.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + bytes(1 << 28))
            with archive.open(f"{name}.more", "w", force_zip64=True):
                pass


Write = Callable[[Path], None]

BAGS: dict[str, Write] = {
    "zstd per file: 650 kB that unpack to 20 GB": _packed_file,
    "zstd per message: 260 kB that unpack to 8 GB": _packed_message,
    "mcap, a chunk that announces 2 GB": _zstd_chunk,
    "mcap, a chunk that announces 1 kB and unpacks to 8 GB": _lying_chunk,
    "mcap, a chunk of lz4 that unpacks to 1 GB": _lz4_chunk,
    "mcap, 40 chunks of the same time, 200 MB each": _overlapping_chunks,
    "mcap, an index that lists a chunk of 200 MB 10,000 times": _repeated_chunk,
    "mcap, a chunk of eight million empty messages": _tiny_messages,
    "mcap, a type with an array of 500 million texts": _definition,
    "mcap, a type defined in 4 MB of text": _long_definition,
    "mcap, qualities of service nested 100,000 deep": _qualities,
    "`metadata.yaml` whose aliases stand for 10^12 values": _metadata(lambda words: aliases() + words),
    "`metadata.yaml` nested 100,000 deep": _metadata(lambda words: "a: " + "[" * 100_000),
    "`metadata.yaml` of 50 MB": _metadata(lambda words: words + "#" * 50_000_000),
    "sqlite3, a view of endless definitions": _endless_view,
    "sqlite3, a view of endless messages": _endless_messages,
    "sqlite3, a tree of 10 pages with 60^10 rows": _endless_tree,
    "the storage file is a named pipe": _pipe,
    "the storage file is a socket": _socket,
    "the storage file is a link to `/dev/zero`": _linked("/dev/zero"),
    "the storage file is a link out of the bag": _link_out,
    "`metadata.yaml` is a named pipe": _pipe_metadata,
    "`metadata.yaml` is a link to `/dev/zero`": _linked("/dev/zero", "metadata.yaml"),
    "the bag itself is a named pipe": _pipe_bag,
    "mcap of 8 TB, all but 10 kB of it a hole": _sparse,
    "a message a year after the others": _times(START_NS, START_NS + 10**8, START_NS + YEAR_NS),
    "a message every 9 minutes": _times(*(START_NS + index * 540 * 10**9 for index in range(400))),
    "messages of 10 MB of small parts": _many_markers,
    "ROS 1, a chunk of bzip2 that unpacks to 8 GB": _ros1_bz2,
}
"""What is wrong, and how it is made: in a folder, or as a file of that name with an ending."""

OTHERS: dict[str, tuple[Write, tuple[str, ...]]] = {
    "model, `golden.npz` that claims 10^12 numbers": (_golden, ("replay", "bags/handshake", "--model", "{file}")),
    "model, weights that claim 10^12 numbers": (_weights, ("replay", "bags/handshake", "--model", "{file}")),
    "model, `manifest.json` nested 200,000 deep": (_deep_manifest, ("models", "{file}")),
    "parameter file whose aliases stand for 10^12 values": (
        _config(aliases()),
        ("replay", "bags/handshake", "--config", "{file}"),
    ),
    "parameter file nested 100,000 deep": (
        _config("a: " + "[" * 100_000),
        ("replay", "bags/handshake", "--config", "{file}"),
    ),
    "robot file nested 40,000 deep": (
        _robot("a = " + "[" * 40_000),
        ("replay", "bags/handshake", "-p", "robot:={file}"),
    ),
}


def made(name: str, folder: Path) -> Path:
    """Make the file of that name; returns what to open."""
    write = BAGS[name] if name in BAGS else OTHERS[name][0]
    write(folder / "bag")
    found = [path for path in folder.iterdir() if path.stem == "bag"]
    assert len(found) == 1, found
    return found[0]


def command(name: str, file: Path, out: Path, salvage: bool) -> list[str]:
    """The words that open it."""
    if name in BAGS:
        return ["replay", str(file), "--out", str(out), *(["--salvage"] if salvage else [])]
    return [word.replace("{file}", str(file)) for word in OTHERS[name][1]]


@dataclass(frozen=True)
class Outcome:
    """What came of giving a file to a command.

    Attributes:
        name: Of the file.
        salvage: Whether it was to be salvaged.
        code: Exit code; negative for a signal.
        line: The last line on stderr, without paths.
        lines: How many there were.
        seconds: From the start of the process.
        peak_mb: Of its resident memory.
        scratch_mb: The most that lay in the folder for temporary files.
    """

    name: str
    salvage: bool
    code: int
    line: str
    lines: int
    seconds: float
    peak_mb: float
    scratch_mb: float


def _limit() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_BYTES, FILE_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_BYTES, MEMORY_BYTES))


def _size(folder: Path) -> int:
    total = 0
    for place, _, names in os.walk(folder):
        for name in names:
            with suppress(OSError):  # gone meanwhile
                total += os.lstat(os.path.join(place, name)).st_blocks * 512
    return total


def opened(name: str, folder: Path, *, salvage: bool = False) -> Outcome:
    """Make a file and give it to the command line in a process with limits."""
    (folder / "tmp").mkdir(parents=True)
    (folder / "made").mkdir()
    file = made(name, folder / "made")
    words = [*PYTHON, "-m", "mild_ros.command_line.main", *command(name, file, folder / "out", salvage)]
    environment = dict(os.environ, TMPDIR=str(folder / "tmp"), PYTHONSAFEPATH="1")
    begin, scratch = time.monotonic(), 0
    with (folder / "stderr").open("wb") as errors:
        process = subprocess.Popen(
            words,
            cwd=ROOT,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            preexec_fn=_limit,
        )
        while True:
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
            if ended:
                break
            scratch = max(scratch, _size(folder / "tmp"))
            if time.monotonic() - begin > 2 * SECONDS:
                process.kill()
            time.sleep(0.02)
        process.returncode = os.waitstatus_to_exitcode(status)
    said = [line for line in (folder / "stderr").read_text(errors="replace").splitlines() if line.strip()]
    line = said[-1] if said else ""
    for place in (folder / "made", folder / "tmp", folder / "out", folder):
        line = line.replace(f"{place}/", "")
    return Outcome(
        name,
        salvage,
        process.returncode,
        line.removeprefix("mild: "),
        len(said),
        time.monotonic() - begin,
        usage.ru_maxrss / 1000,
        scratch / 1e6,
    )


def table(outcomes: list[Outcome]) -> str:
    """Markdown: one row for each file; with `--salvage` where that says something else."""
    lines = ["| File | Outcome | Seconds | Peak MB | Temporary MB |", "|---|---|---:|---:|---:|"]
    for name in dict.fromkeys(outcome.name for outcome in outcomes):
        found = [outcome for outcome in outcomes if outcome.name == name]
        texts = [f"*{outcome.line or 'read to its end'}*" for outcome in found]
        if len(found) == 2 and texts[0] != texts[1]:
            texts[1] = f"with `--salvage`: {texts[1]}"
        cells = [max(getattr(each, key) for each in found) for key in ("seconds", "peak_mb", "scratch_mb")]
        words = "; ".join(dict.fromkeys(texts)).replace("|", "\\|")
        lines.append(f"| {name} | {words} | {cells[0]:.0f} | {cells[1]:.0f} | {cells[2]:.0f} |")
    return "\n".join(lines) + "\n"


def written(document: str, made_table: str) -> str:
    """The document with another table of files.

    Raises:
        ValueError: It has none, or several.
    """
    found = re.findall(r"(?:^\| File \|.*\n)(?:^\|.*\n)+", document, re.MULTILINE)
    if len(found) != 1:
        raise ValueError(f"the document has {len(found)} tables of files")
    return document.replace(found[0], made_table)


def failures(outcomes: list[Outcome]) -> list[str]:
    """What should not be: a signal, a traceback, more than a line."""
    return [
        f"{each.name}{' --salvage' * each.salvage}: code {each.code}, {each.lines} lines: {each.line}"
        for each in outcomes
        if each.code not in (0, 2) or (each.code == 2 and each.lines != 1)
    ]


def main() -> int:
    """Run and print."""
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    words.add_argument("--only", default="", help="Files whose name holds this.")
    words.add_argument("--plain", action="store_true", help="Without the second run, with --salvage.")
    words.add_argument("--json", action="store_true")
    words.add_argument("--write", action="store_true", help=f"Put the table into {DOCUMENT}; of all files only.")
    given = words.parse_args()
    outcomes = []
    for name in [name for name in (*BAGS, *OTHERS) if given.only in name]:
        for salvage in (False, True) if name in BAGS and not given.plain else (False,):
            with tempfile.TemporaryDirectory(prefix="mild_hostile_") as folder:
                outcomes.append(opened(name, Path(folder) / "f", salvage=salvage))
            print(f"{name}{' --salvage' * salvage}: {outcomes[-1]}", file=sys.stderr)
    print(json.dumps([asdict(each) for each in outcomes], indent=1) if given.json else table(outcomes))
    if given.write and not given.only:
        (ROOT / DOCUMENT).write_text(written((ROOT / DOCUMENT).read_text(), table(outcomes)))
    failed = failures(outcomes)
    print("\n".join(failed), file=sys.stderr)
    return bool(failed)


if __name__ == "__main__":
    raise SystemExit(main())

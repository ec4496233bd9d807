# SPDX-License-Identifier: Apache-2.0
"""Good bags of every kind are read; broken ones give one line that names the thing, the problem and a remedy."""

from __future__ import annotations

import contextlib
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from mild_core.errors import BagError, DataError
from mild_ros.bag_writer import create_bag
from mild_ros.bags import RawMessage, jazzy_types, open_bag, topic_of_type
from mild_ros.encoding import encode

JOINT_STATE = "sensor_msgs/msg/JointState"
COUNT = 50


def joint_state(index: int):
    types = jazzy_types().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](index, 0), "base")
    empty = np.zeros(0)
    return types[JOINT_STATE](header, ["a", "b"], np.array([0.1 * index, -1.0]), empty, empty)


def write_ours(path: Path, count: int = COUNT) -> Path:
    with create_bag(path) as bag:
        for index in range(count):
            bag.write("/joint_states", JOINT_STATE, 10**9 + index * 10**7, encode(joint_state(index)))
            if index % 10 == 9:
                bag.flush()
    return path


def write_foreign(path: Path, storage: StoragePlugin, mode: CompressionMode) -> Path:
    writer = Writer(path, version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topic: Connection = writer.add_connection("/joint_states", JOINT_STATE, typestore=jazzy_types())
        for index in range(COUNT):
            writer.write(topic, 10**9 + index * 10**7, encode(joint_state(index)))
    return path


def positions(path: Path, *, salvage: bool = False) -> list[float]:
    with open_bag(path, salvage=salvage) as bag:
        return [bag.decode(raw).position[0] for raw in bag.messages(["/joint_states"])]


EXPECTED = [0.1 * index for index in range(COUNT)]


def test_what_we_write_we_read(tmp_path):
    bag_path = write_ours(tmp_path / "bag")
    assert positions(bag_path) == EXPECTED
    assert positions(next(bag_path.glob("*.mcap"))) == EXPECTED
    with open_bag(bag_path) as bag:
        assert bag.topics["/joint_states"].count == COUNT
        assert [raw.time_ns for raw in bag.messages()] == [10**9 + index * 10**7 for index in range(COUNT)]


@pytest.mark.parametrize("storage", list(StoragePlugin))
@pytest.mark.parametrize("mode", list(CompressionMode))
def test_other_storages_are_read(tmp_path, storage, mode):
    if storage is StoragePlugin.SQLITE3 and mode is CompressionMode.STORAGE:
        pytest.skip("sqlite3 has no compression of its own")
    assert positions(write_foreign(tmp_path / "bag", storage, mode)) == EXPECTED


def test_equal_messages_have_equal_bytes(tmp_path):
    first, second = write_ours(tmp_path / "a"), write_ours(tmp_path / "b")
    with open_bag(first) as one, open_bag(second) as two:
        assert [raw.data for raw in one.messages()] == [raw.data for raw in two.messages()]


def refused(path: Path, *words: str, salvage: bool = False) -> None:
    with pytest.raises(BagError) as caught:
        positions(path, salvage=salvage)
    line = str(caught.value)
    assert "\n" not in line
    assert path.name in line
    for word in words:
        assert word in line


def test_a_missing_bag_is_named(tmp_path):
    refused(tmp_path / "nowhere", "there is no such bag")


def test_a_folder_without_metadata_is_refused_and_salvaged(tmp_path):
    path = write_ours(tmp_path / "bag")
    (path / "metadata.yaml").unlink()
    refused(path, "has no metadata.yaml", "--salvage")
    assert positions(path, salvage=True) == EXPECTED


def test_an_empty_folder_is_no_bag(tmp_path):
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", "has no metadata.yaml")
    refused(tmp_path / "empty", "no readable message", salvage=True)


@pytest.mark.parametrize("text", ["", "{", "rosbag2_bagfile_information: 3", "\x00\x01", "a: [1, 2", "- x"])
def test_garbage_metadata_is_refused(tmp_path, text):
    path = write_ours(tmp_path / "bag")
    (path / "metadata.yaml").write_text(text)
    refused(path, "metadata")
    assert positions(path, salvage=True) == EXPECTED


@pytest.mark.parametrize("key", ["version", "storage_identifier", "topics_with_message_count", "duration"])
def test_metadata_without_a_key_is_refused(tmp_path, key):
    path = write_ours(tmp_path / "bag")
    text = (path / "metadata.yaml").read_text()
    assert f"  {key}:" in text
    (path / "metadata.yaml").write_text(text.replace(f"  {key}:", f"  {key}_gone:"))
    refused(path, key)


def test_a_truncated_file_is_refused_and_salvaged(tmp_path):
    path = write_ours(tmp_path / "bag")
    file = next(path.glob("*.mcap"))
    whole = file.read_bytes()
    lengths = []
    for end in range(0, len(whole), 97):
        file.write_bytes(whole[:end])
        refused(path)
        try:
            saved = positions(path, salvage=True)
        except BagError:
            saved = []
        assert saved == EXPECTED[: len(saved)]
        lengths.append(len(saved))
    assert lengths[0] == 0
    assert lengths[-1] == COUNT
    assert len(set(lengths)) >= 5, "chunks that are whole are saved one by one"


def test_a_truncated_database_is_refused(tmp_path):
    path = write_foreign(tmp_path / "bag", StoragePlugin.SQLITE3, CompressionMode.NONE)
    file = next(path.glob("*.db3"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    refused(path)


def test_flipped_bytes_never_escape_as_another_error(tmp_path):
    path = write_ours(tmp_path / "bag")
    file = next(path.glob("*.mcap"))
    whole = file.read_bytes()
    generator = np.random.default_rng(0)
    survived = 0
    for _ in range(60):
        broken = bytearray(whole)
        start = int(generator.integers(0, len(whole) - 8))
        broken[start : start + 8] = generator.bytes(8)
        file.write_bytes(bytes(broken))
        for salvage in (False, True):
            with contextlib.suppress(BagError, DataError):
                survived += len(positions(path, salvage=salvage)) <= COUNT
    assert survived > 0, "some flips hit nothing that matters"


def test_wrong_counts_are_noticed(tmp_path):
    path = write_ours(tmp_path / "bag")
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace(f"message_count: {COUNT}", f"message_count: {COUNT + 3}"))
    refused(path, f"{COUNT + 3}", f"{COUNT}")
    assert positions(path, salvage=True) == EXPECTED


@pytest.mark.parametrize("name", ["../other/other.mcap", "/etc/passwd", "a/../../b.mcap"])
def test_a_path_out_of_the_bag_is_refused(tmp_path, name):
    path = write_ours(tmp_path / "bag")
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace("- bag.mcap", f"- {name}"))
    refused(path, "points outside the bag")


def test_garbage_in_one_message_is_told_apart_from_a_broken_bag(tmp_path):
    with create_bag(tmp_path / "bag") as writer:
        writer.write("/joint_states", JOINT_STATE, 1, b"\x00\x01\x00\x00" + b"\xff" * 40)
    with open_bag(tmp_path / "bag") as bag, pytest.raises(DataError, match="undecodable"):
        bag.decode(next(bag.messages()))


def test_the_topic_is_found_by_its_type(tmp_path):
    with open_bag(write_ours(tmp_path / "bag")) as bag:
        assert topic_of_type(bag, JOINT_STATE) == "/joint_states"
        assert topic_of_type(bag, JOINT_STATE, "joint_states") == "/joint_states"
        with pytest.raises(BagError, match="/joint_states"):
            topic_of_type(bag, "geometry_msgs/msg/PoseArray")


def test_an_existing_folder_is_not_overwritten(tmp_path):
    path = write_ours(tmp_path / "bag")
    with pytest.raises(BagError, match="exists already"), create_bag(path):
        pass
    assert positions(path) == EXPECTED


WRITE_UNTIL_STOPPED = """
import os
import sys
from pathlib import Path
from mild_core.errors import BagError
from mild_ros.bag_writer import create_bag
from mild_ros.bags import jazzy_types
from mild_ros.encoding import encode
text = jazzy_types().types["std_msgs/msg/String"]
try:
    with create_bag(Path(sys.argv[1]), durable=True) as bag:
        for index in range(200_000):
            bag.write("/text", "std_msgs/msg/String", index, encode(text(f"message {index} " + os.urandom(1000).hex())))
            if index % int(sys.argv[2]) == 9:
                bag.flush()
            if index == 99:
                print("hundred", flush=True)
except BagError as error:
    print(error, file=sys.stderr)
    sys.exit(2)
"""


def saved_numbers(path: Path, *, salvage: bool = False) -> int:
    with open_bag(path, salvage=salvage) as bag:
        numbers = [int(bag.decode(raw).data.split()[1]) for raw in bag.messages()]
    assert numbers == list(range(len(numbers))), "the first messages, without a hole"
    return len(numbers)


def writer_process(path: Path, flush_every: int = 10, **options) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", WRITE_UNTIL_STOPPED, str(path), str(flush_every)]
    root = Path(__file__).parents[2]
    return subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def test_a_kill_costs_at_most_what_was_not_flushed(tmp_path):
    with writer_process(tmp_path / "bag") as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "hundred\n"
        process.send_signal(signal.SIGKILL)
        process.wait(timeout=30)
    assert saved_numbers(tmp_path / "bag", salvage=True) >= 100


def limit_file_size() -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4 * 2**20, 4 * 2**20))


def test_a_file_that_may_not_grow_is_one_line_and_salvageable(tmp_path):
    # The limit is per file, so the reserve cannot help here: the bag ends without an index.
    with writer_process(tmp_path / "bag", preexec_fn=limit_file_size) as process:
        _, errors = process.communicate(timeout=120)
    assert process.returncode == 2
    assert len(errors.strip().splitlines()) == 1
    assert "--salvage" in errors
    assert saved_numbers(tmp_path / "bag", salvage=True) > 500


@pytest.mark.parametrize("flush_every", [10, 10**9])
def test_a_full_disk_is_one_line_and_keeps_the_bag_whole(tmp_path, flush_every):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = shutil.which("mount")
    size = "size=6m"
    if (
        mount is None
        or subprocess.run([mount, "-t", "tmpfs", "-o", size, "none", disk], capture_output=True).returncode
    ):
        pytest.skip("a small disk can be made by root only")
    try:
        with writer_process(disk / "bag", flush_every) as process:
            _, errors = process.communicate(timeout=120)
        assert process.returncode == 2
        assert len(errors.strip().splitlines()) == 1
        assert "the disk is full" in errors
        kept = saved_numbers(disk / "bag")
        assert kept > 500
        assert f"first {kept} messages are kept" in errors
    finally:
        subprocess.run(["umount", disk], check=True)


def test_a_raw_message_is_a_plain_value():
    assert RawMessage("/a", "t", 1, b"x") == RawMessage("/a", "t", 1, b"x")

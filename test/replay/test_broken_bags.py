# SPDX-License-Identifier: Apache-2.0
"""Broken bags give one line that names the thing, the problem and a remedy, or what can be saved of them."""

from __future__ import annotations

import gzip
import re
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from mild_core.errors import BagError, DataError
from mild_ros.bag import salvage as salvaging
from mild_ros.bag.reader import open_bag
from mild_ros.bag.writer import create_bag
from test.bench import bag_faults
from test.faults.broken_bags import TEXTS, broken_bag
from test.replay.made_bags import (
    COUNT,
    EXPECTED,
    JOINT_STATE,
    positions,
    refused,
    write_foreign,
    write_ours,
)


def test_a_missing_bag_is_named(tmp_path):
    assert refused(tmp_path / "nowhere", "there is no such bag")


def test_a_folder_without_metadata_is_refused_and_salvaged(tmp_path):
    path = write_ours(tmp_path / "bag")
    (path / "metadata.yaml").unlink()
    assert refused(path, "has no metadata.yaml", "--salvage")
    assert positions(path, salvage=True) == EXPECTED


def made(text: bytes, name: str, folder: Path) -> Path:
    (folder / name).write_bytes(text)
    return folder / name


NO_BAGS = [
    (b"", "take.mcap", "is empty: it has 0 bytes; record it again"),
    (b"", "take.db3", "is empty: it has 0 bytes; record it again"),
    (b"", "take.bag", "is empty: it has 0 bytes; record it again"),
    (b"", "take.mcap.zstd", "is empty: it has 0 bytes; record it again"),
    (b"x" * 999, "take.mcap", "is not an mcap file, by how it begins, and no message in it can be read; record it"),
    (b"x" * 999, "take.db3", "is not a database of sqlite3, by how it begins, and no message"),
    (b"x" * 999, "take.bag", "is not a bag of ROS 1, by how it begins, and no message"),
    (b"x" * 999, "take.txt", "is no bag; give the folder that"),
    (bytes(5000), "take.mcap", "begins with zeros, as after a power cut, and no message in it can be read; record it"),
    (
        b"version https://git-lfs.github.com/spec/v1\n",
        "take.mcap",
        "Git LFS, not the file itself; get that with `git",
    ),
    (gzip.compress(b"a bag"), "take.bag", "is packed with gzip; unpack it"),
    (b"\n<!DOCTYPE html>", "take.db3", "is a web page or XML, not a bag; download the file itself"),
    (
        b"SQLite format 3\0" + bytes(84),
        "take.mcap",
        "is a database of sqlite3, by how it begins; let its name end",
    ),
    (b"\x89MCAP0\r\n" + b"\xff" * 90, "take.mcap", "holds no readable message, also none to salvage; record it again"),
]


@pytest.mark.parametrize(("text", "name", "words"), NO_BAGS, ids=[f"{name} {words[:20]}" for _, name, words in NO_BAGS])
def test_salvage_is_not_suggested_where_nothing_can_be_salvaged(tmp_path, text, name, words):
    file = made(text, name, tmp_path)
    for salvage in (False, True):
        assert "--salvage" not in refused(file, words, salvage=salvage)


def test_a_folder_without_messages_is_refused_for_what_it_holds(tmp_path):
    bag = tmp_path / "bag"
    bag.mkdir()
    for words in ("holds no .mcap, .db3 or .bag file; give the folder", "holds old.bag, of ROS 1; give that file"):
        for salvage in (False, True):
            assert "--salvage" not in refused(bag, words, salvage=salvage)
        made(b"#ROSBAG V2.0\n", "old.bag", bag)
    (bag / "old.bag").rename(bag / "metadata.yaml")
    assert refused(bag, "holds metadata.yaml, and no .mcap or .db3 file; copy that beside it too")
    made(b"", "bag.mcap", bag)
    assert refused(bag, "bag.mcap: is empty")


def test_what_can_be_salvaged_is_not_called_lost(tmp_path, monkeypatch):
    bag = broken_bag("sqlite3 cut off", tmp_path)
    assert "--salvage" in refused(bag)
    monkeypatch.setattr(salvaging, "sqlite_messages", lambda *given: iter(()))
    assert "--salvage" not in refused(bag)
    monkeypatch.setattr(salvaging, "GLANCE_BYTES", 100)
    assert "--salvage" in refused(bag), "a large file is not copied for a glance"


@pytest.mark.parametrize("text", ["", "{", "rosbag2_bagfile_information: 3", "\x00\x01", "a: [1, 2", "- x"])
def test_garbage_metadata_is_refused(tmp_path, text):
    path = write_ours(tmp_path / "bag")
    (path / "metadata.yaml").write_text(text)
    assert refused(path, "metadata")
    assert positions(path, salvage=True) == EXPECTED


def test_a_version_of_the_future_is_refused(tmp_path):
    path = write_ours(tmp_path / "bag")
    metadata = path / "metadata.yaml"
    metadata.write_text(re.sub(r"version: \d+", "version: 99", metadata.read_text()))
    assert refused(path, "version 99", "--salvage")
    assert positions(path, salvage=True) == EXPECTED


@pytest.mark.parametrize("key", ["version", "storage_identifier", "topics_with_message_count", "duration"])
def test_metadata_without_a_key_is_refused(tmp_path, key):
    path = write_ours(tmp_path / "bag")
    text = (path / "metadata.yaml").read_text()
    assert f"  {key}:" in text
    (path / "metadata.yaml").write_text(text.replace(f"  {key}:", f"  {key}_gone:"))
    assert refused(path, key)


def test_a_truncated_file_is_refused_and_salvaged(tmp_path):
    path = write_ours(tmp_path / "bag")
    file = next(path.glob("*.mcap"))
    whole = file.read_bytes()
    lengths = []
    for end in range(0, len(whole), 307):
        file.write_bytes(whole[:end])
        assert refused(path)
        try:
            saved = positions(path, salvage=True)
        except BagError:
            saved = []
        assert saved == EXPECTED[: len(saved)]
        lengths.append(len(saved))
    assert lengths[0] == 0
    assert lengths[-1] == COUNT
    assert len(set(lengths)) >= 5, "chunks that are whole are saved one by one"


def test_a_truncated_database_is_refused_and_salvaged(tmp_path):
    path = broken_bag("sqlite3 cut off", tmp_path)
    assert refused(path)
    with open_bag(path, salvage=True) as bag:
        saved = [bag.decode(raw).data for raw in bag.messages()]
    assert saved == TEXTS[: len(saved)] != []
    assert lost(path) == f"{len(TEXTS) - len(saved)} of {len(TEXTS)} messages are lost"
    (path / "metadata.yaml").unlink()
    assert lost(path) == "at least 1 messages are lost", "how many is not known without metadata, but that some are"


def lost(path: Path) -> str:
    with open_bag(path, salvage=True) as bag:
        return bag.lost


def test_what_is_lost_is_counted(tmp_path):
    path = write_ours(tmp_path / "bag")
    file = next(path.glob("*.mcap"))
    assert lost(path) == ""
    data = bytearray(file.read_bytes())
    third = [found.start() for found in re.finditer(b"zstd", data)][2]
    data[third + 20 : third + 28] = b"\xff" * 8
    file.write_bytes(bytes(data))
    assert positions(path, salvage=True) == EXPECTED[:20] + EXPECTED[30:], "the search goes on behind a lost chunk"
    assert lost(path) == f"10 of {COUNT} messages are lost"
    assert lost(file).startswith("at least 10 messages are lost and ")


def test_the_journal_of_a_killed_recorder_is_read(tmp_path):
    whole = write_foreign(tmp_path / "bag", StoragePlugin.SQLITE3, CompressionMode.NONE)
    killed = tmp_path / "killed"
    killed.mkdir()
    with closing(sqlite3.connect(next(whole.glob("*.db3")))) as given:
        copy = sqlite3.connect(killed / "killed.db3")
        given.backup(copy)
    with closing(copy):
        copy.execute("PRAGMA journal_mode=WAL")
        copy.execute("UPDATE messages SET timestamp = timestamp + 1")
        copy.commit()
        for name in ("killed.db3", "killed.db3-wal"):  # as it lies there when it is not closed
            shutil.copyfile(killed / name, tmp_path / name)
    assert refused(killed, "has no metadata.yaml")
    with open_bag(tmp_path / "killed.db3", salvage=True) as bag:
        assert [raw.time_ns for raw in bag.messages()] == [10**9 + index * 10**7 + 1 for index in range(COUNT)]


def test_every_broken_bag_is_one_line_or_salvaged():
    outcomes, failures = bag_faults.run(40, seed=0)
    assert failures == []
    endings = {ending for *_, ending in outcomes}
    assert {"refused, 1 line", "read whole", "salvaged whole", "salvaged, loss reported"} <= endings
    assert all(ending.endswith(" 1 line") for ending in endings if "line" in ending)


def test_wrong_counts_are_noticed(tmp_path):
    path = write_ours(tmp_path / "bag")
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace(f"message_count: {COUNT}", f"message_count: {COUNT + 3}"))
    assert refused(path, f"{COUNT + 3}", f"{COUNT}")
    assert positions(path, salvage=True) == EXPECTED


@pytest.mark.parametrize("name", ["../other/other.mcap", "/etc/passwd", "a/../../b.mcap"])
def test_a_path_out_of_the_bag_is_refused(tmp_path, name):
    path = write_ours(tmp_path / "bag")
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace("- bag.mcap", f"- {name}"))
    assert refused(path, "points outside the bag")


def test_a_name_that_no_disk_can_hold_is_refused_and_salvaged(tmp_path):
    path = write_ours(tmp_path / "bag")
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace("- bag.mcap", f"- bag.mca{'p' * 400}"))
    assert refused(path, "too long")
    assert positions(path, salvage=True) == EXPECTED


def test_garbage_in_one_message_is_distinguished_from_a_broken_bag(tmp_path):
    with create_bag(tmp_path / "bag") as writer:
        writer.write("/joint_states", JOINT_STATE, 1, b"\x00\x01\x00\x00" + b"\xff" * 40)
    with open_bag(tmp_path / "bag") as bag, pytest.raises(DataError, match="undecodable"):
        bag.decode(next(bag.messages()))


def test_the_search_goes_on_behind_a_record_that_makes_no_sense(tmp_path):
    file = next(write_ours(tmp_path / "bag").glob("*.mcap"))
    data = bytearray(file.read_bytes())
    record = [found.start() for found in re.finditer(b"zstd", data)][2] - 41  # its head and the chunk's
    data[record : record + 9] = b"\xff" * 9
    file.write_bytes(bytes(data))
    assert positions(file, salvage=True) == EXPECTED[:20] + EXPECTED[30:]


def test_what_is_left_behind_the_last_whole_record_is_counted(tmp_path):
    file = next(write_ours(tmp_path / "bag").glob("*.mcap"))
    file.write_bytes(file.read_bytes()[:-8] + b"\x05\x00\x00")
    assert positions(file, salvage=True) == EXPECTED
    assert lost(file) == "3 bytes cannot be read"


def test_rows_between_readable_ones_are_counted_without_metadata_too(tmp_path):
    path = broken_bag("sqlite3 with a broken page", tmp_path)
    with open_bag(path, salvage=True) as bag:
        saved = len(list(bag.messages()))
    (path / "metadata.yaml").unlink()
    assert lost(path) == f"at least {len(TEXTS) - saved} messages are lost"

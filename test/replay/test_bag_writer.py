# SPDX-License-Identifier: Apache-2.0
"""What is written stays: a kill or a full disk costs at most what was not flushed."""

from __future__ import annotations

import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader as Rosbag2Reader

from mild_core.errors import BagError
from mild_ros.bag.encoding import encode
from mild_ros.bag.reader import open_bag
from mild_ros.bag.writer import create_bag
from test.replay.made_bags import COUNT, EXPECTED, JOINT_STATE, joint_state, positions, write_ours


def test_an_existing_folder_is_not_overwritten(tmp_path):
    path = write_ours(tmp_path / "bag")
    with pytest.raises(BagError, match="exists already"), create_bag(path):
        pass
    assert positions(path) == EXPECTED


@pytest.mark.parametrize("durable", [False, True])
def test_a_recording_that_ends_before_its_first_message_is_a_whole_bag(tmp_path, durable):
    with create_bag(tmp_path / "bag", durable=durable) as bag:
        bag.add_topic("/joint_states", JOINT_STATE)
        bag.flush()
        bag.add_topic("/elsewhere", JOINT_STATE)
    with open_bag(tmp_path / "bag") as bag:
        assert {topic: one.count for topic, one in bag.topics.items()} == {"/joint_states": 0, "/elsewhere": 0}
        assert list(bag.messages()) == []
        assert bag.lost == ""


def test_a_bag_in_several_files_is_one_bag(tmp_path):
    with create_bag(tmp_path / "bag", split_bytes=2000) as bag:
        for index in range(COUNT):
            bag.write("/joint_states", JOINT_STATE, 10**9 + index * 10**7, encode(joint_state(index)))
            bag.flush()
    files = sorted((tmp_path / "bag").glob("*.mcap"), key=lambda file: int(file.stem.split("_")[1]))
    assert len(files) >= 3
    assert [position for file in files for position in positions(file)] == EXPECTED, "each file is whole by itself"
    assert positions(tmp_path / "bag") == EXPECTED
    with Rosbag2Reader(tmp_path / "bag") as reader:
        assert reader.message_count == COUNT
        described = [(file["path"], file["message_count"]) for file in reader.storage.files]
    assert described == [(file.name, len(positions(file))) for file in files]
    (tmp_path / "bag" / "metadata.yaml").unlink()
    files[1].write_bytes(files[1].read_bytes()[:-300])
    assert positions(tmp_path / "bag", salvage=True) == EXPECTED


WRITE_UNTIL_STOPPED = """
import os
import sys
from pathlib import Path
from mild_core.errors import BagError
from mild_ros.bag.writer import create_bag
from mild_ros.bag.reader import jazzy_types
from mild_ros.bag.encoding import encode
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

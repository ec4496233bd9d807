# SPDX-License-Identifier: Apache-2.0
"""Files that claim, or never stop giving, more than they may are refused in one line and at once."""

from __future__ import annotations

import io
import os
import pickle
import socket
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from mild_core.budgets import SETTINGS_BYTES, parse_json, parse_toml, read_file, read_npz
from mild_core.errors import SetupError
from mild_core.inference.model import load_model
from mild_core.learning.data.trials import read_trials
from mild_core.learning.training.configuration import read_configuration

MEMORY_BYTES = 1 << 30
"""What a reader may take beyond what Python and numpy have taken already."""


def refused(path: Path, largest: int = SETTINGS_BYTES) -> str:
    with pytest.raises(SetupError) as caught:
        read_file(path, largest)
    line = str(caught.value)
    assert str(path) in line
    assert "\n" not in line
    return line


def test_only_regular_files_of_a_bounded_size_are_read(tmp_path: Path) -> None:
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_bytes(b"x" * 100)
    link.symlink_to(file)
    assert read_file(link, 100) == b"x" * 100
    assert "larger than 99 bytes" in refused(file, 99)
    assert "no such file" in refused(tmp_path / "nowhere")
    assert "is a folder" in refused(tmp_path)


def test_what_never_ends_is_not_read(tmp_path: Path) -> None:
    """A pipe without a writer would be waited for; a device never ends; a sparse file costs nothing to make."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zeros").symlink_to("/dev/zero")
    with socket.socket(socket.AF_UNIX) as listener, (tmp_path / "huge").open("wb") as huge:
        listener.bind(str(tmp_path / "s"))
        huge.truncate(1 << 42)
        assert "is a named pipe" in refused(tmp_path / "pipe")
        assert "is a device" in refused(tmp_path / "zeros")
        assert "is a socket" in refused(tmp_path / "s")
        assert "larger than 1.05 MB" in refused(tmp_path / "huge")


@pytest.mark.parametrize("parse", [parse_json, parse_toml])
def test_depth_is_no_crash(parse) -> None:
    with pytest.raises(ValueError, match="nested too deeply"):
        parse(("a = " if parse is parse_toml else "") + "[" * 100_000)


def npy(shape: tuple[int, ...], content: bytes = b"", kind: str = "<f8") -> bytes:
    """A member of an archive that claims a shape."""
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + content


def archive(**members: bytes) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return packed.getvalue()


def lzma_archive() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_LZMA) as file:
        file.writestr("a.npy", npy((1,), bytes(8)))
    return packed.getvalue()


def flipped(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes(64 * [0xFF]) + content[middle + 64 :]


ZEROS = npy((1 << 20,), bytes(8 << 20))
HOSTILE = {
    "10^12 elements": (archive(a=npy((10**12,))), "claims an array"),
    "a length that no computer counts": (archive(a=npy((0, 10**24))), "claims an array"),
    "lengths whose product overflows": (archive(a=npy((2**32, 2**32, 2**32))), "claims an array"),
    "elements without a size": (archive(a=npy((10**12,), kind="|V0")), "claims an array"),
    "more arrays than anyone has": (archive(**{f"a{i}": b"" for i in range(20_001)}), "20001 arrays"),
    "a hundred times as much": (archive(**{f"a{i}": ZEROS for i in range(9)}), "unpacks to 75.5 MB, more than 67.1 MB"),
    "another compression": (lzma_archive(), "packed in a way"),
    "objects": (archive(a=npy((1,), pickle.dumps([1]), "|O")), "holds objects"),
    "no archive": (b"PK\x03\x04" + bytes(100), "no archive"),
    "broken bytes": (flipped(archive(a=ZEROS)), "is no archive"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_archive_of_arrays_is_refused(name: str) -> None:
    content, words = HOSTILE[name]
    with pytest.raises(ValueError, match=words):
        read_npz(content, 64 << 20)


def test_a_good_archive_is_read() -> None:
    packed = io.BytesIO()
    np.savez_compressed(packed, a=np.arange(6.0).reshape(2, 3), empty=np.zeros((0, 3)), number=np.array(3))
    found = read_npz(packed.getvalue(), 64 << 20)
    assert {name: array.shape for name, array in found.items()} == {"a": (2, 3), "empty": (0, 3), "number": ()}


def shared_array(times: int) -> bytes:
    """Objects that are all the same array of a megabyte: three bytes of a pickle for each."""
    objects = np.empty(times, dtype=object)
    one = np.zeros(1 << 17)
    for index in range(times):
        objects[index] = one
    head = f"{{'descr': '|O', 'fortran_order': False, 'shape': ({times},), }}".encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + pickle.dumps(objects, protocol=3)


READERS = {
    "data set, arrays": ("npz", archive(a=npy((10**12,)))),
    "data set, total": ("npz", archive(**{f"a{i}": npy((16 << 20,), bytes(128 << 20)) for i in range(9)})),
    "data set, one array a thousand times": ("npz", archive(a=shared_array(2000))),
    "robot file": ("toml", b"a = " + b"[" * 90_000),
    "robot file, size": ("toml", b"#" * 200_000),
}


@pytest.mark.parametrize("name", READERS)
def test_readers_refuse_within_their_memory(name: str, tmp_path: Path) -> None:
    """In a child that may take a gigabyte more than it has: the refusal must come before the memory does."""
    kind, content = READERS[name]
    file = tmp_path / f"file.{kind}"
    file.write_bytes(content)
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, kind, str(file), str(MEMORY_BYTES)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "file" in done.stdout
    assert len(done.stdout.splitlines()) == 1


PROGRAM = """
import resource, sys
from pathlib import Path
from mild_core.errors import SetupError
from mild_core.learning.data.safe_npz import read_safe_npz
from mild_core.retargeting.robot_file import read_robot
kind, file, memory = sys.argv[1:]
have = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (have + int(memory),) * 2)
try:
    names = [f"a{i}" for i in range(9)] if b"a8.npy" in Path(file).read_bytes() else ["a"]
    read_safe_npz(Path(file), names) if kind == "npz" else read_robot(Path(file))
except SetupError as error:
    print(error)
"""


def test_a_model_folder_with_special_files_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    os.mkfifo(folder / "manifest.json")
    with pytest.raises(SetupError, match="is a named pipe"):
        load_model(folder)


@pytest.mark.parametrize("read", [read_trials, lambda folder: read_configuration(str(folder / "trials.toml"))])
def test_settings_that_are_a_device_or_too_deep_are_refused(read, tmp_path: Path) -> None:
    file = tmp_path / "trials.toml"
    file.symlink_to("/dev/zero")
    with pytest.raises(SetupError, match="is a device"):
        read(tmp_path)
    file.unlink()
    file.write_text("a = " + "[" * 100_000)
    with pytest.raises(SetupError, match="nested too deeply"):
        read(tmp_path)

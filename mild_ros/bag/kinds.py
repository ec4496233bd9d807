# SPDX-License-Identifier: Apache-2.0
"""What stands in place of a bag in which no message can be found, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from mild_core.errors import BagError
from mild_ros.bag.budgets import is_storage

MAGICS = {
    ".mcap": (b"\x89MCAP0\r\n", "an mcap file"),
    ".db3": (b"SQLite format 3\0", "a database of sqlite3"),
    ".bag": (b"#ROSBAG V2.0", "a bag of ROS 1"),
    ".zstd": (b"\x28\xb5\x2f\xfd", "a file packed with zstd"),
    ".zst": (b"\x28\xb5\x2f\xfd", "a file packed with zstd"),
}
"""By the ending of a file: how it begins, and what it is then."""

STRANGERS = (
    (b"version https://git-lfs", "is a pointer of Git LFS, not the file itself", "get that with `git lfs pull`"),
    (b"PK\x03\x04", "is a zip archive", "unpack it, and give the bag in it"),
    (b"\x1f\x8b", "is packed with gzip", "unpack it (gunzip, tar -x), and give the bag in it"),
    (b"\xfd7zXZ", "is packed with xz", "unpack it (unxz, tar -x), and give the bag in it"),
    (b"BZh", "is packed with bzip2", "unpack it (bunzip2, tar -x), and give the bag in it"),
    (b"7z\xbc\xaf", "is a 7z archive", "unpack it, and give the bag in it"),
    (b"<", "is a web page or XML, not a bag", "download the file itself"),
)
"""What people find in place of a bag: how it begins, what it is, what to do."""

WHAT_A_BAG_IS = "give the folder that `ros2 bag record` or `mild record` wrote, or a .mcap, .db3 or .bag file"
RECORD_AGAIN = "record it again, or take another copy"


def storages(path: Path) -> list[Path]:
    """The files of a bag that hold its messages."""
    return sorted(file for file in path.iterdir() if is_storage(file)) if path.is_dir() else [path]


def begins_as(file: Path, ending: str) -> bool:
    """Whether a file begins as those with this ending do."""
    return ending in MAGICS and _head(file).startswith(MAGICS[ending][0])


def nothing_in(path: Path) -> BagError:
    """The line for a bag in which there is no message to be found, with or without salvage.

    Args:
        path: Its folder, or one file.
    """
    files = storages(path)
    if not files and (path / "metadata.yaml").exists():
        return BagError(str(path), "holds metadata.yaml, and no .mcap or .db3 file", "copy that beside it too")
    if not files:
        return BagError(str(path), "holds no .mcap, .db3 or .bag file", WHAT_A_BAG_IS)
    if path.is_dir() and files[0].suffix == ".bag":
        return BagError(str(path), f"holds {files[0].name}, of ROS 1", "give that file")
    if not any(file.stat().st_size for file in files):
        return BagError(str(files[0]), "is empty: it has 0 bytes", RECORD_AGAIN)
    for file in (file for file in files if file.suffix in MAGICS or file == path):
        for problem, remedy in _in_its_place(file):
            return BagError(str(file), problem, remedy)
    return BagError(str(path), "holds no readable message, also none to salvage", RECORD_AGAIN)


def _in_its_place(file: Path) -> Iterator[tuple[str, str]]:
    """What a file is that is not what its ending says, and what to do."""
    head = _head(file)
    if begins_as(file, file.suffix):
        return
    for ending, (magic, kind) in MAGICS.items():
        if head.startswith(magic):
            yield f"is {kind}, by how it begins", f"let its name end in {ending}"
    for magic, problem, remedy in STRANGERS:
        if head.lstrip().startswith(magic):
            yield problem, remedy
    if head and not head.strip(b"\0"):
        yield "begins with zeros, as after a power cut, and no message in it can be read", RECORD_AGAIN
    if file.suffix not in MAGICS:
        yield "is no bag", WHAT_A_BAG_IS
    else:
        yield f"is not {MAGICS[file.suffix][1]}, by how it begins, and no message in it can be read", RECORD_AGAIN


def _head(file: Path) -> bytes:
    with file.open("rb") as opened:
        return opened.read(64)

# SPDX-License-Identifier: Apache-2.0
"""What can be saved of a broken bag: whole records of a cut-off mcap file, and files without their metadata.

An mcap file is a row of records, so a file that was cut off (kill, full disk, copy) is good up to its last whole
record; closing it there with an empty footer makes it a valid file without an index.

Source: MCAP file format specification, https://mcap.dev/spec (records, DataEnd, Footer).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from rosbags.rosbag2.storage_mcap import decompress

from mild_core.errors import BagError

MAGIC = b"\x89MCAP0\r\n"
_DATA_END, _CHUNK = 0x0F, 0x06
_HEADER_BYTES = 9  # one byte of kind, eight of length
_EMPTY_ENDING = (
    struct.pack("<BQI", _DATA_END, 4, 0)
    + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0)  # footer: no summary
    + MAGIC
)


def readable_parts(path: Path, scratch: Path) -> list[Path]:
    """Copies of the storage files of a bag, closed where they break off.

    Args:
        path: The bag's folder or one storage file.
        scratch: An empty folder for the copies.

    Returns:
        Files that rosbags can open by themselves, in order of their names.

    Raises:
        BagError: There is nothing to read.
    """
    files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
    parts = []
    for file in files:
        if file.suffix == ".mcap" and seal_mcap(file, scratch / file.name):
            parts.append(scratch / file.name)
        elif file.suffix == ".db3":
            parts.append(file)
    packed = [file.name for file in files if file.suffix in (".zstd", ".zst")]
    if not parts and packed:
        raise BagError(str(path), f"holds packed files ({packed[0]})", "unpack them with `zstd -d` and try again")
    if not parts:
        raise BagError(str(path), "holds no readable message", "record it again")
    return parts


def seal_mcap(source: Path, target: Path) -> bool:
    """Copy `source` up to its last whole record before any index, and close it; False when nothing is whole."""
    with source.open("rb") as given:
        if given.read(len(MAGIC)) != MAGIC:
            return False
        end = len(MAGIC)
        for kind, stop in _whole_records(given):
            if kind == _DATA_END:
                break
            end = stop
        if end == len(MAGIC):
            return False
        given.seek(0)
        with target.open("wb") as sealed:
            sealed.write(given.read(end))
            sealed.write(_EMPTY_ENDING)
    return True


def _whole_records(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """Kind and end offset of each record that is wholly there, from the file's position on."""
    start = file.tell()
    size = file.seek(0, 2)
    while start + _HEADER_BYTES <= size:
        file.seek(start)
        kind, length = struct.unpack("<BQ", file.read(_HEADER_BYTES))
        stop = start + _HEADER_BYTES + length
        if stop > size or (kind == _CHUNK and not _chunk_is_whole(file)):
            return
        yield kind, stop
        start = stop


def _chunk_is_whole(file: BinaryIO) -> bool:
    """Whether the chunk at the file's position unpacks: a disk may have lost its middle."""
    _, _, unpacked_size, checksum, name_length = struct.unpack("<QQQII", file.read(32))
    compression = file.read(min(name_length, 16)).decode("ascii", "replace")
    (packed_size,) = struct.unpack("<Q", file.read(8))
    try:
        decompress(file.read(packed_size), compression, unpacked_size, checksum)
    except Exception:  # each compression has its own errors
        return False
    return True

# SPDX-License-Identifier: Apache-2.0
"""Budgets for opening files that anyone may have written: what is read, and how large it may become in memory.

A path may name a device, a pipe that never ends or a file of terabytes; a few kilobytes of an archive or a header may
claim as much. Each is refused before it is read, in one line that names the file, the budget and what to do.
"""

from __future__ import annotations

import io
import json
import math
import os
import stat
import tomllib
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from mild_core.errors import SetupError

SETTINGS_BYTES = 1 << 20
"""Largest file of settings (TOML, JSON, YAML) [bytes]; those that we ship have some thousand."""

TABLE_BYTES = 64 << 20
"""Largest file of measured results [bytes]."""

MOST_ARRAYS = 20_000
"""Most members of an archive of arrays."""

MOST_ELEMENTS = 1 << 40
"""Longest side of an array, also of one that is empty."""

ANOTHER = "give another file"


def shown(count: float) -> str:
    """A number of bytes, for people."""
    for unit, size in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count:.0f} bytes"


def kind_of_file(mode: int) -> str:
    """What a file is that is no regular one: "a folder", "a named pipe", ...; "" of a regular file."""
    kinds = {
        stat.S_IFREG: "",
        stat.S_IFDIR: "a folder",
        stat.S_IFIFO: "a named pipe",
        stat.S_IFSOCK: "a socket",
        stat.S_IFCHR: "a device",
        stat.S_IFBLK: "a device",
    }
    return kinds.get(stat.S_IFMT(mode), "no regular file")


def read_file(
    path: Path, largest_bytes: int, remedy: str = ANOTHER, error: type[SetupError] = SetupError, thing: str = ""
) -> bytes:
    """The whole content of a regular file.

    Args:
        path: The file; a link to a regular file will do.
        largest_bytes: More than this is refused unread.
        remedy: What to do about a file that is refused.
        error: What to raise.
        thing: The file as messages name it; its path by default.

    Raises:
        SetupError: (or `error`) It is not there, no regular file, too large or cannot be read.
    """
    thing = thing or str(path)
    try:
        # Without O_NONBLOCK the opening of a pipe would wait for someone to write into it.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            found = os.fstat(descriptor)
            if kind := kind_of_file(found.st_mode):
                raise error(thing, f"is {kind}, not a file", remedy)
            with open(descriptor, "rb", closefd=False) as file:
                # As much memory as the file is long, not as it may be.
                content = file.read(min(found.st_size, largest_bytes) + 1)
        finally:
            os.close(descriptor)
    except FileNotFoundError:
        raise error(thing, "there is no such file", remedy) from None
    except OSError as failed:
        problem = "is a socket, not a file" if _is_socket(path) else f"cannot be read ({failed.strerror})"
        raise error(thing, problem, remedy) from None
    except ValueError as failed:  # a name with a zero in it
        raise error(thing, f"cannot be read ({failed})", remedy) from None
    if max(len(content), found.st_size) > largest_bytes:
        raise error(thing, f"is larger than {shown(largest_bytes)}", remedy)
    return content


def _is_socket(path: Path) -> bool:
    try:
        return stat.S_ISSOCK(path.stat().st_mode)
    except OSError:
        return False


def parse_json(content: bytes | str) -> Any:
    """What a text of JSON says.

    Raises:
        ValueError: It is no JSON, or is nested too deeply for Python.
    """
    try:
        return json.loads(content)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def parse_toml(content: bytes | str) -> dict[str, Any]:
    """What a text of TOML says.

    Raises:
        ValueError: It is no TOML, or is nested too deeply for Python.
    """
    try:
        return tomllib.loads(content if isinstance(content, str) else content.decode())
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


@dataclass(frozen=True)
class ArrayHeader:
    """What the head of a `.npy` member claims: shape, Fortran order, type."""

    shape: tuple[int, ...]
    fortran: bool
    kind: np.dtype[Any]

    @property
    def claimed_bytes(self) -> int:
        """Of its content; Python's own numbers, which do not overflow."""
        return math.prod(self.shape) * self.kind.itemsize


def read_header(stream: IO[bytes]) -> ArrayHeader:
    """The head of a `.npy` stream, which then stands at its content.

    Raises:
        ValueError: There is none.
    """
    version = np.lib.format.read_magic(stream)
    reader = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, kind = reader(stream)
    return ArrayHeader(shape, fortran, kind)


def check_archive(archive: zipfile.ZipFile, largest_bytes: int, names: Iterable[str] | None = None) -> None:
    """Refuse an archive of arrays that would unpack to more than it may.

    Args:
        archive: Opened, nothing of it unpacked yet.
        largest_bytes: Of all members together, as the archive's own list states; more is never unpacked.
        names: Members that count; None for all.

    Raises:
        ValueError: It would.
    """
    entries = archive.infolist()
    if len(entries) > MOST_ARRAYS:
        raise ValueError(f"holds {len(entries)} arrays, more than {MOST_ARRAYS}")
    wanted = None if names is None else set(names)
    for entry in entries:
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or entry.flag_bits & 1:
            raise ValueError("is packed in a way that numpy does not write")  # some take memory that the file names
    size = sum(entry.file_size for entry in entries if wanted is None or entry.filename in wanted)
    if size > largest_bytes:
        raise ValueError(f"unpacks to {shown(size)}, more than {shown(largest_bytes)}")


def read_numbers(stream: IO[bytes], available_bytes: int) -> NDArray[Any]:
    """One `.npy` array of numbers from a stream of a known length.

    Raises:
        ValueError: It is none, holds objects, or claims more elements than the stream has bytes for.
    """
    begin = stream.tell()
    header = read_header(stream)
    if header.kind.hasobject:
        raise ValueError("holds objects, not numbers")
    left = available_bytes - (stream.tell() - begin)
    # Shapes such as (0, 10**24) and elements without a size claim no bytes, and are no less absurd.
    if header.claimed_bytes > left or max(header.shape, default=0) > MOST_ELEMENTS or not header.kind.itemsize:
        raise ValueError(f"claims an array of shape {header.shape}, but holds {shown(available_bytes)}"[:200])
    stream.seek(begin)
    array: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    return array


def read_npz(content: bytes, largest_bytes: int) -> dict[str, NDArray[Any]]:
    """All arrays of an `.npz` of numbers.

    Args:
        content: Of the file.
        largest_bytes: Of all arrays together.

    Raises:
        ValueError: It is none, is broken, holds objects, or would unpack to more.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            check_archive(archive, largest_bytes)
            return {
                entry.filename.removesuffix(".npy"): read_numbers(io.BytesIO(archive.read(entry)), entry.file_size)
                for entry in archive.infolist()
            }
    except (zipfile.BadZipFile, zlib.error, ArithmeticError, LookupError, EOFError, OSError, TypeError) as error:
        raise ValueError(f"is no archive of arrays ({error})") from None

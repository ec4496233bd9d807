# SPDX-License-Identifier: Apache-2.0
"""Reads published `.npz` recordings without running what is in them.

The published files hold object arrays, which numpy stores as pickles, and a pickle may call any function it names.
Here a pickle meets stand-ins: it may only *describe* arrays of numbers or text, nested in arrays of objects. The
arrays are then built from the described bytes. Whatever else it names is refused before anything is called.
"""

from __future__ import annotations

import io
import math
import pickle
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mild_core.budgets import check_archive, read_file, read_header, read_numbers, shown
from mild_core.errors import DatasetError

LARGEST_BYTES = 1 << 30
"""Arrays that unpack to more than this, taken together, are refused unread: a few kB of zip can claim terabytes."""

OBJECT_BYTES = 32
"""What an array of objects takes for each, at least."""

REMEDY = "take the file as its publishers give it, or convert it to arrays of numbers"


class _RefusedError(Exception):
    """What the file asks for is not an array of numbers or text."""


class _DescribedType:
    """Stands in for numpy.dtype: remembers letter, size and byte order."""

    def __init__(self, code: object, align: object = False, copy: object = True) -> None:
        if not isinstance(code, str) or code[:1] not in tuple("biufUO") or not code[1:].isdigit() or len(code) > 8:
            raise _RefusedError(f"an array of type {str(code)[:40]!r}")
        self.code, self.order = code, "<"

    def __setstate__(self, state: object) -> None:
        match state:
            case (_, "<" | "|" | ">" | "=" as order, None, None, None, int(), int(), int()):
                self.order = str(order)
            case _:
                raise _RefusedError("an array of a compound type")

    @property
    def objects(self) -> bool:
        return self.code[0] == "O"


class _Allowance:
    """What may still be built: a pickle can name one array a million times in three megabytes."""

    def __init__(self, size: int) -> None:
        self._left = size

    def spend(self, size: int) -> None:
        self._left -= size
        if self._left < 0:
            raise _RefusedError(f"more than {shown(LARGEST_BYTES)} of arrays")


class _DescribedArray:
    """Stands in for numpy.ndarray: remembers shape, type and content, and is built only when all is checked."""

    content: tuple[tuple[int, ...], _DescribedType, bool, bytes | list[Any]] | None = None

    def __setstate__(self, state: object) -> None:
        match state:
            case (int(), tuple() as shape, _DescribedType() as kind, bool() as fortran, bytes() | list() as data):
                if not all(isinstance(length, int) and length >= 0 for length in shape):
                    raise _RefusedError(f"an array of shape {str(shape)[:40]}")
                self.content = (shape, kind, fortran, data)
            case _:
                raise _RefusedError("an array with an unknown layout")

    def build(self, allowance: _Allowance, depth: int = 0) -> NDArray[Any]:
        if self.content is None or depth > 2:
            raise _RefusedError("an array without content" if self.content is None else "arrays nested too deeply")
        shape, kind, fortran, data = self.content
        if isinstance(data, list) != kind.objects or (kind.objects and len(data) != math.prod(shape)):
            raise _RefusedError("an array whose content does not fit its shape")
        allowance.spend(len(data) * (1 if isinstance(data, bytes) else OBJECT_BYTES))
        order: Literal["F", "C"] = "F" if fortran else "C"
        array: NDArray[Any]
        if isinstance(data, bytes):
            array = np.frombuffer(data, np.dtype(kind.order + kind.code)).copy()
            return np.reshape(array, shape, order=order)
        array = np.empty(len(data), dtype=object)
        for index, value in enumerate(data):
            if not isinstance(value, _DescribedArray | int | float | str):
                raise _RefusedError(f"an object of type {type(value).__name__}")
            array[index] = value.build(allowance, depth + 1) if isinstance(value, _DescribedArray) else value
        return np.reshape(array, shape, order=order)


def _describe_array(kind: object, shape: object, letter: object) -> _DescribedArray:
    """Stands in for numpy's `_reconstruct`."""
    if kind is not _DescribedArray:
        raise _RefusedError("an array of a class of its own")
    return _DescribedArray()


_STAND_INS: Mapping[tuple[str, str], Any] = MappingProxyType(
    {
        ("numpy", "ndarray"): _DescribedArray,
        ("numpy", "dtype"): _DescribedType,
        ("numpy.core.multiarray", "_reconstruct"): _describe_array,  # numpy 1
        ("numpy._core.multiarray", "_reconstruct"): _describe_array,  # numpy 2
    }
)


class _Describer(pickle._Unpickler):
    """Python's own unpickler in Python: the one in C sizes a table by a number that the file names."""

    def find_class(self, module: str, name: str) -> Any:
        try:
            return _STAND_INS[module, name]
        except KeyError:
            raise _RefusedError(f"the function '{module}.{name}', which is not needed to store numbers") from None


def _read_member(archive: zipfile.ZipFile, name: str, allowance: _Allowance) -> NDArray[Any]:
    """One array of the archive."""
    info = archive.getinfo(name)
    stream = io.BytesIO(archive.read(info))
    if not read_header(stream).kind.hasobject:
        stream.seek(0)
        return read_numbers(stream, info.file_size)
    described = _Describer(stream).load()
    if not isinstance(described, _DescribedArray):
        raise _RefusedError(f"'{name}', which is no array")
    return described.build(allowance)


def read_safe_npz(path: Path, names: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Read the named arrays of an `.npz`; object arrays may hold arrays of numbers or text, nothing else.

    Args:
        path: The file.
        names: Arrays that must be in it; others are not looked at.

    Returns:
        The arrays by name.

    Raises:
        DatasetError: The file is absent, truncated, no `.npz`, lacks a name, or asks for anything but arrays.
            Nothing that the file names has been called then.

    Source: the `.npy` format, numpy.lib.format (NEP 1); pickle protocol, PEP 3154.
    """
    thing = f"recording '{path}'"
    if not path.exists():
        raise DatasetError(thing, "there is no such file", "give its path; ./mild data says how to get it")
    content = io.BytesIO(read_file(path, LARGEST_BYTES, REMEDY, DatasetError, thing))
    try:
        with zipfile.ZipFile(content) as archive:
            there = {name.removesuffix(".npy") for name in archive.namelist()}
            absent = [name for name in names if name not in there]
            if absent:
                raise DatasetError(thing, f"has no array '{absent[0]}' (only {', '.join(sorted(there))})", REMEDY)
            check_archive(archive, LARGEST_BYTES, [f"{name}.npy" for name in names])
            allowance = _Allowance(LARGEST_BYTES)
            return {name: _read_member(archive, f"{name}.npy", allowance) for name in names}
    except DatasetError:
        raise
    except _RefusedError as refused:
        raise DatasetError(thing, f"asks for {refused}; nothing of it was run", REMEDY) from None
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError, RuntimeError) as broken:
        raise DatasetError(thing, f"cannot be read ({broken})", "fetch it again: it is broken or no .npz") from None
    except Exception as broken:
        # A pickle is a program: a broken one may fail with any error there is, and none of them is ours.
        problem = f"holds a broken array ({type(broken).__name__}: {broken})"
        raise DatasetError(thing, problem, "fetch it again: it is broken") from None


def numbers(thing: str, what: str, values: Any, columns: int) -> NDArray[np.float64]:
    """`values` as (T, columns) finite numbers, T at least 2.

    Raises:
        DatasetError: They are not; names `thing` and the first bad frame.
    """
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "iufb":
        raise DatasetError(thing, f"its {what} is no array of numbers", REMEDY)
    if values.ndim != 2 or values.shape[1] != columns:
        raise DatasetError(thing, f"its {what} has shape {values.shape}, expected (frames, {columns})", REMEDY)
    if len(values) < 2:
        raise DatasetError(thing, f"its {what} has {len(values)} frames", "leave the trial out")
    if not np.isfinite(values).all():
        frame = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
        raise DatasetError(thing, f"its {what} is not finite in frame {frame}", "leave the trial out, or repair it")
    return values.astype(np.float64)

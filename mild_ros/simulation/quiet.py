# SPDX-License-Identifier: Apache-2.0
"""Keep compiled libraries from writing to the terminal."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quiet_terminal() -> Iterator[None]:
    """Drop what the process writes to its standard output and error meanwhile, by C code too.

    PyBullet greets on import and warns about every link without mass: a program whose output is read by another
    must not show that. Errors come as exceptions all the same.
    """
    flush_c = ctypes.CDLL(None).fflush
    sys.stdout.flush()
    sys.stderr.flush()
    flush_c(None)
    kept = [(stream, os.dup(stream)) for stream in (1, 2)]
    try:
        with open(os.devnull, "wb") as nowhere:
            for stream, _ in kept:
                os.dup2(nowhere.fileno(), stream)
        yield
    finally:
        # What C code has buffered must go while the way out is still closed.
        flush_c(None)
        for stream, copy in kept:
            os.dup2(copy, stream)
            os.close(copy)

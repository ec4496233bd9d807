# SPDX-License-Identifier: Apache-2.0
"""One decorator for numba functions, so that all are compiled by the same rules."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile `function` at its first call and keep the machine code on disk where that is possible.

    Arithmetic stays as written: no fast-math, so one machine gives the same bits every time. numba refuses to
    cache where it can write neither beside the source nor in the user's cache; we then compile once per process.
    The cache only watches the file of the function itself, so a compiled function calls compiled functions of
    its own file only.
    """
    options: dict[str, Any] = {"fastmath": False, "error_model": "numpy", "nogil": True}
    try:
        result: Function = numba.njit(cache=True, **options)(function)
    except RuntimeError:
        result = numba.njit(**options)(function)
    return result

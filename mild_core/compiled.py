# SPDX-License-Identifier: Apache-2.0
"""One decorator for numba functions, so that all are compiled and kept by the same rules."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile `function` at its first call and keep the machine code on disk where that is possible.

    Arithmetic stays as written: no fast-math, so one machine gives the same bits every time.
    """
    return _compiled(function, False)


def compiled_in_any_order(function: Function) -> Function:
    """As `compiled`, but sums may be taken in another order and products be fused into them, as the machine likes it.

    For sums over long rows in learning, several times as fast. One machine still gives the same bits every time.
    """
    return _compiled(function, {"reassoc", "contract"})


def _compiled(function: Function, freedom: Any) -> Function:
    options: dict[str, Any] = {"fastmath": freedom, "error_model": "numpy", "nogil": True}
    folder = _cache_folder()
    if folder is None:
        return cast(Function, numba.njit(**options)(function))
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(folder)  # type: ignore[attr-defined]
    try:
        return cast(Function, numba.njit(cache=True, **options)(function))
    except RuntimeError:  # numba found the folder unusable after all.
        return cast(Function, numba.njit(**options)(function))
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]


@cache
def _cache_folder() -> Path | None:
    """Where machine code is kept: `NUMBA_CACHE_DIR`, beside the sources, or in the user's cache; None if nowhere.

    numba recompiles a function when its own file changed, but not when a function that it calls did, in another
    file. So the folder is named after the content of all files with compiled functions.
    """
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        content = path.read_bytes()
        digest.update(content if b"@compiled" in content or b"numba" in content else b"")
    given, here = os.environ.get("NUMBA_CACHE_DIR"), Path(__file__).parent / "__pycache__"
    users = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "mild_ros"
    for parent in [Path(given)] if given else [here, users]:
        folder = parent / f"kernels-{digest.hexdigest()[:16]}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, RuntimeError):
            continue
        if os.access(folder, os.W_OK | os.X_OK):
            return folder
    return None

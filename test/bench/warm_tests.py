# SPDX-License-Identifier: Apache-2.0
"""Runs quick tests of a tree in forked children of a process that has imported the large libraries once.

    python -P -m test.bench.warm_tests MODULE ...

Each line of standard input is a call (`Call` as JSON), each line of standard output its end (`[exit code or null,
"what was said"]`). Nothing of the tree itself is imported before the fork, so a child sees its files as they are.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

LIBRARIES = ("numpy", "numba", "scipy.stats", "torch", "pinocchio", "pytest")
"""What most tests import, and what takes seconds to import."""


class Call(NamedTuple):
    """One run of pytest.

    Attributes:
        arguments: Of pytest.
        limit_s: Longest time that it may take [s].
        interpreted: Without numba's compiler.
        changed: File of the tree that is faulty; "" for none.
        kernels: Folder with the machine code of the tree without a fault; "" for none.
    """

    arguments: list[str]
    limit_s: float
    interpreted: bool = False
    changed: str = ""
    kernels: str = ""


def importers(changed: str, tree: Path) -> set[str]:
    """Modules of `mild_core` that import a file, directly or not, by name; and the file's own."""
    files = (tree / "mild_core").rglob("*.py")
    texts = {path.relative_to(tree).with_suffix("").as_posix(): path.read_text() for path in files}
    names = {place: place.removesuffix("/__init__").replace("/", ".") for place in texts}
    found, new = set[str](), {changed.removesuffix(".py")}
    while new:
        found |= new
        seen = [names[place].rpartition(".") for place in new if place in names]
        heads = [rf"from {re.escape(a + b + c)} import|from {re.escape(a)} import .*\b{c}\b" for a, b, c in seen]
        head = re.compile("|".join(heads) or "$^")
        new = {place for place, text in texts.items() if head.search(text)} - found
    return {names.get(place, place) for place in found}


def keep_kernels(call: Call, tree: Path) -> Path | None:
    """Give a faulty tree the machine code that its fault does not concern; returns the folder, if it is a new one.

    Machine code is kept by the content of all compiled files together, so one fault would have all of it recompiled.
    """
    if not call.changed or not call.kernels:
        return None
    from mild_core.compiled import _cache_folder

    folder, good = _cache_folder(), Path(call.kernels)
    if folder is None or folder == good:
        return None
    concerned = {name.rpartition(".")[2] for name in importers(call.changed, tree)}
    for kept in good.glob("*/*"):
        if kept.name.partition(".")[0] not in concerned and not kept.name.startswith("test_"):
            copy = folder / kept.relative_to(good)
            copy.parent.mkdir(exist_ok=True)
            with contextlib.suppress(OSError):
                shutil.copy2(kept, copy)
    return folder


def child(call: Call, said: Path) -> None:
    """Run the tests in this process and end it."""
    os.setsid()
    with said.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    if call.interpreted:
        os.environ["NUMBA_DISABLE_JIT"] = "1"
        with contextlib.suppress(ImportError):
            import_module("numba.core.config").reload_config()  # it has read its environment already
    code, made = 2, None
    try:
        made = keep_kernels(call, Path.cwd())
        import pytest

        code = int(pytest.main(call.arguments))
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException as error:
        print(f"Error: {error!r}")
    finally:
        if made is not None:  # the faulty kernels are of no use
            shutil.rmtree(made, ignore_errors=True)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def run(call: Call) -> tuple[int | None, str]:
    """Exit code (None when it takes too long) and output of a call; its processes end with it."""
    with tempfile.TemporaryDirectory(prefix="mild-warm-") as folder:
        said = Path(folder, "said")
        said.touch()
        process = os.fork()
        if process == 0:
            child(call, said)
        code, end, parent = None, time.monotonic() + call.limit_s, os.getppid()
        while time.monotonic() < end and os.getppid() == parent:  # no one waits for an answer any more
            done, status = os.waitpid(process, os.WNOHANG)
            if done:
                code = os.waitstatus_to_exitcode(status)
                break
            time.sleep(0.02)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process, signal.SIGKILL)
        if code is None:
            with contextlib.suppress(ChildProcessError):
                os.waitpid(process, 0)
        return code, said.read_text(errors="replace")


def main() -> None:
    """Answer calls until standard input ends."""
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[variable] = "1"
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for name in sys.argv[1:]:
        with contextlib.suppress(ImportError):
            import_module(name)
    for line in sys.stdin:
        answers.write(json.dumps(run(Call(**json.loads(line)))) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()

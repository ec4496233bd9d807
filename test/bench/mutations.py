# SPDX-License-Identifier: Apache-2.0
"""Plants faults in copies of the tree, one at a time, and lists those that the quick tests of their area do not notice.

    ./mild measure mutations [PART ...] [--jobs 2] [--list] [--remember]

Each fault of `test/mutations` is put into a copy of this checkout, whose tests of the fault's area have passed without
it. One that survives shows a rule that no quick test holds. Outcomes are kept in `.mild/mutations` under the content of
the faulty file and of its tests: a second call goes on where the first one ended.

The test that noticed a fault before (`test/mutations/noticed_by.json`, written by --remember) runs first, the others of
its area only where that one does not notice it any more. Tests run in children of a warm process (`warm_tests`).
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import hashlib
import json
import os
import queue
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from pathlib import Path

from mild_core.errors import SetupError
from test.bench import warm_tests
from test.bench.warm_tests import LIBRARIES, Call
from test.mutations import AREAS, FAULTS
from test.mutations.fault import INTERPRETED, Fault, faulty

ROOT = Path(__file__).resolve().parents[2]
LEFT_OUT = (".git", ".venv", ".mild", "out", "__pycache__", ".pytest_cache", ".ruff_cache", ".mypy_cache", "*.egg-info")
LIMIT_S = 120.0
"""Tests of one area take seconds, compilation included; a run that takes this long hangs, which counts as noticed."""

FAILED, COLLECTED_IN_VAIN = 1, 2
"""Exit codes of pytest with which a fault is noticed: a test failed, or a test file could not even be imported."""

QUICK = "not slow and not talks and not heavy"
NOTICED_BY = "test/mutations/noticed_by.json"
"""Of the checkout: by fault the test that noticed it."""

PROGRAM = """
import contextlib, sys
from pathlib import Path
import mild_core, mild_ros, test
root = Path(sys.argv[1])
wrong = [module.__file__ for module in (mild_core, mild_ros, test) if not Path(module.__file__).is_relative_to(root)]
with contextlib.suppress(ImportError):
    from mild_core.compiled import _cache_folder
    print(_cache_folder() or "")
sys.exit(f"not imported from the copy: {wrong}" if wrong else 0)
"""


@dataclass(frozen=True)
class Outcome:
    """What became of a fault.

    Attributes:
        fault: Its name.
        verdict: `killed`, `hangs` (noticed too), `survived`, or `error`: the tests did not run.
        seconds: How long its tests took.
        said: The last lines of an error; of a killed one, what failed.
        test: Which test noticed it; "" for none.
    """

    fault: str
    verdict: str
    seconds: float
    said: str
    test: str = ""


class Copy:
    """A copy of the tree in which faults are planted, one at a time.

    The folder stays the same from call to call, and so do the times of its files: machine code is kept under both.
    """

    def __init__(self, source: Path, folder: Path) -> None:
        self.tree, self._kernels = folder / "tree", folder / "kernels"
        if self.tree.exists():
            shutil.rmtree(self.tree)
        shutil.copytree(source, self.tree, ignore=shutil.ignore_patterns(*LEFT_OUT), symlinks=True)
        self._environment = {
            **{key: value for key, value in os.environ.items() if not key.startswith(("PYTEST_", "_ROS_WHEELS"))},
            "PYTHONPATH": str(self.tree),
            "NUMBA_CACHE_DIR": str(folder / "kernels"),
        }
        command = [sys.executable, "-P", "-c", PROGRAM, str(self.tree)]
        run_in = {"cwd": self.tree, "env": self._environment}
        done = subprocess.run(command, **run_in, capture_output=True, text=True, timeout=120)
        if done.returncode != 0:
            problem = done.stderr.strip().splitlines()[-1:] or ["cannot be imported"]
            raise SetupError(str(self.tree), problem[0], "run ./mild measure in a checkout")
        self._kernels, self._planted = done.stdout.strip(), 0
        self._warm: subprocess.Popen[str] | None = None

    def __enter__(self) -> Copy:
        return self

    def __exit__(self, *_: object) -> None:
        """End the warm process."""
        if self._warm is not None:
            self._warm.communicate()
            self._warm = None

    def _run(self, call: Call) -> tuple[int | None, str]:
        """Exit code (None when it takes too long) and output."""
        if self._warm is None:
            command = [sys.executable, "-P", str(Path(warm_tests.__file__)), *LIBRARIES]
            self._warm = subprocess.Popen(
                command,
                cwd=self.tree,
                env=self._environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        assert self._warm.stdin is not None
        assert self._warm.stdout is not None
        self._warm.stdin.write(json.dumps(call._asdict()) + "\n")
        self._warm.stdin.flush()
        code, said = json.loads(self._warm.stdout.readline())
        return code, said

    def tested(
        self, tests: Iterable[str], limit_s: float = LIMIT_S, interpreted: bool = False, changed: str = ""
    ) -> tuple[int | None, str]:
        """Run quick tests of the copy as it is.

        Args:
            tests: Files, folders or single tests.
            limit_s: A run that takes longer hangs.
            interpreted: Without numba's compiler.
            changed: The faulty file.
        """
        options = ["-x", "-q", "-rfE", "-m", QUICK, "-p", "no:cacheprovider", "--tb=line", f"--timeout={limit_s:.0f}"]
        return self._run(Call([*options, *tests], limit_s, interpreted, changed, self._kernels))

    def judge(self, fault: Fault, limit_s: float = LIMIT_S, first: str = "") -> Outcome:
        """Plant a fault, run the tests of its area and take it out again.

        Args:
            fault: Which.
            limit_s: A run that takes longer hangs.
            first: The test that may notice it by itself.
        """
        path, start = self.tree / fault.file, time.monotonic()
        good, times = path.read_bytes(), path.stat()
        path.write_text(faulty(fault, self.tree))
        self._planted += 1  # byte code is kept under a file's time and size
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns + self._planted * 1_000_000_000))
        code, said = 0, ""
        try:
            for tests in ((first,) if first else (), fault.tests):
                if tests and code not in (FAILED, COLLECTED_IN_VAIN, None):
                    interpreted = b"@compiled" in good and INTERPRETED.issuperset(t.split("::")[0] for t in tests)
                    code, said = self.tested(tests, limit_s, interpreted, fault.file)
        finally:
            path.write_bytes(good)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        seconds, lines = time.monotonic() - start, said.strip().splitlines()
        if code is None:
            return Outcome(fault.name, "hangs", seconds, f"longer than {limit_s:.0f} s")
        if code in (FAILED, COLLECTED_IN_VAIN):
            test = next((line.split(" ", 1)[1].split(" - ")[0] for line in lines if line.startswith("FAILED ")), "")
            return Outcome(fault.name, "killed", seconds, next((x for x in lines if "Error" in x), "")[:200], test)
        return Outcome(fault.name, "error" if code else "survived", seconds, "" if not code else "\n".join(lines[-5:]))


def noticed_by(root: Path = ROOT) -> Mapping[str, str]:
    """By fault the test that noticed it before."""
    try:
        return dict(json.loads((root / NOTICED_BY).read_text()))
    except FileNotFoundError:
        return {}


def remember(outcomes: Iterable[Outcome], root: Path = ROOT) -> None:
    """Keep which tests noticed faults, for the next time."""
    known = {**noticed_by(root), **{one.fault: one.test for one in outcomes if one.test}}
    there = {name: known[name] for name in sorted(known) if any(name == fault.name for fault in FAULTS)}
    (root / NOTICED_BY).write_text(json.dumps(there, indent=2, ensure_ascii=False) + "\n")


def key(fault: Fault, root: Path) -> str:
    """Changes whenever the fault, the faulty file, or a Python file beside its tests does."""
    digest = hashlib.sha256(json.dumps([fault, faulty(fault, root)]).encode())
    for name in fault.tests:
        place = root / name.split("::")[0]
        folder = place if place.is_dir() else place.parent
        for path in sorted(folder.rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


class Results:
    """Outcomes on disk, one file each: what is interrupted loses only what was under way."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def get(self, name: str) -> Outcome | None:
        """What was kept under `name`; None when there is nothing that can be read."""
        try:
            return Outcome(**json.loads((self._folder / f"{name}.json").read_text()))
        except (OSError, ValueError, TypeError):
            return None

    def put(self, name: str, outcome: Outcome) -> None:
        """Keep an outcome, all of it or nothing."""
        written = self._folder / f"{name}.{os.getpid()}-{threading.get_ident()}"
        written.write_text(json.dumps(asdict(outcome)))
        written.replace(self._folder / f"{name}.json")


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Lock these copies against a second run.

    Raises:
        SetupError: Another run holds it, or the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = open(folder / "lock", "w")  # noqa: SIM115  # held until the end
    except OSError as error:
        raise SetupError(str(folder), f"cannot be written: {error.strerror}", "use a checkout of yours") from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise SetupError("measure mutations", f"another one runs in {folder}", "wait for its end") from None
        yield


def passing(copies: Sequence[Copy], faults: Sequence[Fault], results: Results) -> None:
    """Show that the tests of all these faults pass where there is no fault, which compiles them too, in every copy.

    Raises:
        SetupError: They do not.
    """
    tests = sorted({test for fault in faults for test in fault.tests})
    folders = [test for test in tests if not any(test.startswith(f"{other}/") for other in tests)]
    digest = hashlib.sha256("\0".join([*folders, str(len(copies))]).encode())
    copy = copies[0]
    for top in ("mild_core", "mild_ros", "test"):
        for path in sorted((copy.tree / top).rglob("*.py")):
            digest.update(path.relative_to(copy.tree).as_posix().encode() + b"\0" + path.read_bytes())
    name = f"unmutated-{digest.hexdigest()}"
    if results.get(name) is not None:
        return
    print("the tests without a fault: ", end="", flush=True)
    start, uncompiled = time.monotonic(), sorted(INTERPRETED.intersection(tests))

    def passed(copy: Copy) -> tuple[int | None, str]:
        code, said = copy.tested(folders, 10 * LIMIT_S)
        if code == 0 and uncompiled:
            code, said = copy.tested(uncompiled, 3 * LIMIT_S, interpreted=True)
        return code, said

    with ThreadPoolExecutor(len(copies)) as pool:
        for code, said in pool.map(passed, copies):
            if code != 0:
                last = " / ".join(said.strip().splitlines()[-3:]) if code is not None else "they hang"
                raise SetupError("the tests without a fault", f"do not pass: {last}", "mend them first: ./mild check")
    results.put(name, Outcome("", "passed", time.monotonic() - start, ""))
    print(f"pass, {time.monotonic() - start:.0f} s", flush=True)


def run(faults: Sequence[Fault], jobs: int, folder: Path, source: Path = ROOT) -> list[Outcome]:
    """Judge every fault and report each.

    Args:
        faults: Which.
        jobs: Copies of the tree, each with one fault at a time.
        folder: Of copies and outcomes.
        source: The checkout.

    Raises:
        SetupError: The tests do not pass without a fault, or a fault does not fit the code.
    """
    results = Results(folder / "results")
    try:
        keys = {fault.name: key(fault, source) for fault in faults}
    except ValueError as error:
        raise SetupError("measure mutations", str(error), "see test/mutations") from None
    found = {fault.name: kept for fault in faults if (kept := results.get(keys[fault.name])) is not None}
    todo = [fault for fault in faults if fault.name not in found]
    if found:
        print(f"{len(found)} of {len(faults)} are known from before")
    if todo:
        with contextlib.ExitStack() as stack:
            hints, free = noticed_by(source), queue.SimpleQueue[Copy]()
            copies = [stack.enter_context(Copy(source, folder / f"copy-{n}")) for n in range(min(jobs, len(todo)))]
            passing(copies, todo, results)
            for copy in copies:
                free.put(copy)

            def judged(fault: Fault) -> Outcome:
                copy = free.get()
                try:
                    return copy.judge(fault, first=hints.get(fault.name, ""))
                finally:
                    free.put(copy)

            start = time.monotonic()
            with ThreadPoolExecutor(len(copies)) as pool:
                running = {pool.submit(judged, fault): fault for fault in todo}
                for done, future in enumerate(as_completed(running), 1):
                    outcome = future.result()
                    found[outcome.fault] = outcome
                    if outcome.verdict != "error":
                        results.put(keys[outcome.fault], outcome)
                    left_s = (time.monotonic() - start) / done * (len(todo) - done)
                    line = f"[{done}/{len(todo)}, {left_s / 60:.0f} min left] {outcome.verdict:8}"
                    print(f"{line} {outcome.seconds:5.1f} s  {outcome.fault}", flush=True)
    return [found[fault.name] for fault in faults]


def chosen(parts: Sequence[str]) -> list[Fault]:
    """The faults of the named parts; all for none.

    Args:
        parts: Names of areas or of faults, or parts of the names of faulty files.

    Raises:
        SetupError: A part names no fault.
    """

    def belongs(fault: Fault, part: str) -> bool:
        return fault in AREAS.get(part, ()) or part == fault.name or part in fault.file

    for part in parts:
        if not any(belongs(fault, part) for fault in FAULTS):
            raise unknown_part(part)
    return [fault for fault in FAULTS if not parts or any(belongs(fault, part) for part in parts)]


def unknown_part(part: str) -> SetupError:
    """One line for a part that names no fault: with areas rather than hundreds of faults, and the likeliest name."""
    close = get_close_matches(part, [*AREAS, *(fault.name for fault in FAULTS)], n=1)
    hint = f"did you mean '{close[0]}'? " if close else ""
    wanted = f"{hint}name an area ({', '.join(AREAS)}), a part of a file's name, or a fault of --list"
    return SetupError("measure mutations", f"no fault belongs to '{part}'", wanted)


def report(faults: Sequence[Fault], outcomes: Sequence[Outcome]) -> str:
    """What survived, and how many did not."""
    lines = []
    for fault, outcome in zip(faults, outcomes, strict=True):
        if outcome.verdict in ("survived", "error"):
            lines.append(f"{outcome.verdict.upper()} {fault.name} ({fault.file}): {fault.breaks}")
            lines += [f"    {line}" for line in outcome.said.splitlines()]
    counts = {kind: sum(one.verdict == kind for one in outcomes) for kind in ("killed", "hangs", "survived", "error")}
    files = len({fault.file for fault in faults})
    lines.append(
        f"{len(faults)} faults in {files} files: {counts['killed'] + counts['hangs']} noticed, "
        f"{counts['survived']} survived, {counts['error']} could not be judged"
    )
    return "\n".join(lines)


def main() -> int:
    """Run and print; 1 where a fault survived or could not be judged."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument(
        "part",
        nargs="*",
        help=f"an area ({', '.join(AREAS)}), a part of a faulty file's name, or a fault's name; all by default",
    )
    words.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="faults at a time (%(default)s)")
    words.add_argument("--list", action="store_true", help="only list the faults")
    words.add_argument("--remember", action="store_true", help=f"write down in {NOTICED_BY} which tests noticed them")
    given = words.parse_args()
    faults = chosen(given.part)
    if given.list:
        print("\n".join(f"{fault.name} ({fault.file}): {fault.breaks}" for fault in faults))
        return 0
    folder = ROOT / ".mild" / "mutations"
    with alone(folder):
        outcomes = run(faults, max(1, given.jobs), folder)
    if given.remember:
        remember(outcomes)
    print(report(faults, outcomes))
    return int(any(one.verdict in ("survived", "error") for one in outcomes))


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""Broken bags by the thousand: each must be read, be refused in one line, or be salvaged with a count of what is lost.

    ./mild measure bag_faults [--mutations 10000] [--seed 0] [--json]

A good bag of every kind is harmed at random and opened, once plainly and once with salvage. Anything but a `BagError`
of one line (or, for a single message, a `DataError`) is a failure, and so is an opening that takes too long.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from test.faults.broken_bags import COUNT, opened, write_foreign, write_ours, write_ros1

PATIENCE_S = 20
"""Reading one of these takes hundredths of a second; a busy machine may pause."""

MEMORY_BYTES = 4 * 2**30
"""A length that was made huge must not be believed."""

KINDS: dict[str, Callable[[Path], None]] = {
    "mcap, ours": write_ours,
    "mcap": write_foreign(StoragePlugin.MCAP, CompressionMode.NONE),
    "mcap, zstd per file": write_foreign(StoragePlugin.MCAP, CompressionMode.FILE),
    "mcap, zstd per message": write_foreign(StoragePlugin.MCAP, CompressionMode.MESSAGE),
    "sqlite3": write_foreign(StoragePlugin.SQLITE3, CompressionMode.NONE),
    "sqlite3, zstd per file": write_foreign(StoragePlugin.SQLITE3, CompressionMode.FILE),
    "sqlite3, zstd per message": write_foreign(StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    "ROS 1": write_ros1,
}


def flip_bits(data: bytearray, generator: np.random.Generator) -> bytearray:
    """One to sixteen bits turned over."""
    for at in generator.integers(0, len(data), generator.integers(1, 17)):
        data[at] ^= 1 << int(generator.integers(0, 8))
    return data


def overwrite(data: bytearray, generator: np.random.Generator) -> bytearray:
    """A block of noise, zeros or ones: a lost sector, or a length that is huge."""
    start, length = int(generator.integers(0, len(data))), int(generator.choice([1, 4, 8, 64, 512]))
    length = min(length, len(data) - start)
    noise = (generator.bytes(length), bytes(length), b"\xff" * length)[generator.integers(0, 3)]
    data[start : start + length] = noise
    return data


def truncate(data: bytearray, generator: np.random.Generator) -> bytearray:
    """Cut off anywhere, the empty file included."""
    return data[: int(generator.integers(0, len(data)))]


def cut_out(data: bytearray, generator: np.random.Generator) -> bytearray:
    """A piece in the middle is gone."""
    start, stop = np.sort(generator.integers(0, len(data), 2))
    return data[:start] + data[stop:]


def repeat(data: bytearray, generator: np.random.Generator) -> bytearray:
    """A piece comes twice."""
    start, stop = np.sort(generator.integers(0, len(data), 2))
    return data[:stop] + data[start:]


def garbage(data: bytearray, generator: np.random.Generator) -> bytearray:
    """Something else altogether, perhaps behind the right beginning."""
    return data[: int(generator.choice([0, 8, 16]))] + generator.bytes(int(generator.integers(0, 2000)))


FAULTS = (flip_bits, flip_bits, flip_bits, overwrite, overwrite, truncate, cut_out, repeat, garbage)
LINE_WORDS = ("99", "-1", "''", "[]", "{}", "null", "../../x", "9" * 30, "nan", "sqlite3", "mcap", "zstd", "&a [*a]")


def spoil_line(text: str, generator: np.random.Generator) -> str:
    """One line of metadata is gone, doubled, moved or says something else."""
    lines = text.splitlines()
    at = int(generator.integers(0, len(lines)))
    fault = generator.integers(0, 4)
    if fault == 0:
        del lines[at]
    elif fault == 1:
        lines.insert(int(generator.integers(0, len(lines))), lines[at])
    elif fault == 2:
        lines[at] = "  " * int(generator.integers(0, 4)) + lines[at].strip()
    else:
        lines[at] = lines[at].split(":")[0] + ": " + str(generator.choice(LINE_WORDS))
    return "\n".join(lines)


def harm(folder: Path, generator: np.random.Generator) -> str:
    """Do something to a bag; says what."""
    files = sorted(folder.iterdir())
    if len(files) > 1 and generator.random() < 0.05:
        generator.choice(np.array(files, dtype=object)).unlink()
        return "file gone"
    file = files[int(generator.integers(0, len(files)))]
    if file.suffix == ".yaml" and generator.random() < 0.7:
        file.write_text(spoil_line(file.read_text(), generator))
        return "metadata line"
    fault = FAULTS[int(generator.integers(0, len(FAULTS)))]
    file.write_bytes(fault(bytearray(file.read_bytes()), generator))
    return f"{'metadata ' if file.suffix == '.yaml' else ''}{fault.__name__}"


def outcome(path: Path, *, salvage: bool) -> str:
    """What comes of opening and reading everything.

    Raises:
        Exception: Whatever should not be.
    """
    found = opened(path, salvage=salvage)
    if found.error is not None:
        return f"{'broke off' if found.read else 'refused'}, {len(str(found.error).splitlines())} line"
    if found.undecodable:
        return "read, messages undecodable"
    if salvage:
        return "salvaged, loss reported" if found.lost else "salvaged" if found.read < COUNT else "salvaged whole"
    return "read whole" if found.read == COUNT else "read"


@contextmanager
def deadline(seconds: int) -> Iterator[None]:
    """Raises TimeoutError in what takes longer."""

    def too_long(*_: object) -> None:
        raise TimeoutError(f"longer than {seconds} s")

    before = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def run(mutations: int, seed: int) -> tuple[Counter[tuple[str, str, str, str]], list[str]]:
    """Harm and open so many bags; outcomes by kind of bag, fault and way of opening, and the failures as texts."""
    generator, outcomes, failures = np.random.default_rng(seed), Counter[tuple[str, str, str, str]](), list[str]()
    with tempfile.TemporaryDirectory(prefix="mild_faults_") as scratch:
        for name, write in KINDS.items():
            write(Path(scratch, name))
        for index in range(mutations):
            name = list(KINDS)[index % len(KINDS)]
            bag = Path(scratch, "broken")
            shutil.copytree(Path(scratch, name), bag)
            fault = harm(bag, generator)
            path = bag / "old.bag" if name == "ROS 1" else bag
            for salvage in (False, True):
                try:
                    with deadline(PATIENCE_S):
                        found = outcome(path, salvage=salvage)
                except Exception:
                    found = "FAILED"
                    failures.append(f"{index} {name}, {fault}, salvage {salvage}\n{traceback.format_exc(limit=-4)}")
                outcomes[name, fault, "salvage" if salvage else "plain", found] += 1
            shutil.rmtree(bag)
    return outcomes, failures


def table(outcomes: Counter[tuple[str, str, str, str]], place: int, title: str) -> str:
    """Markdown: outcomes by the kind of bag (place 0) or by the fault (place 1)."""
    sums = Counter[tuple[str, str, str]]()
    for key, count in outcomes.items():
        sums[key[place], key[2], key[3]] += count
    lines = [f"| {title} | opened | outcomes |", "|---|---|---|"]
    for name, way in sorted({key[:2] for key in sums}):
        found = sorted(((n, end) for (a, b, end), n in sums.items() if (a, b) == (name, way)), reverse=True)
        lines.append(f"| {name} | {way} | {'; '.join(f'{n} {end}' for n, end in found)} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Run and print."""
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    words.add_argument("--mutations", type=int, default=10_000)
    words.add_argument("--seed", type=int, default=0)
    words.add_argument("--json", action="store_true")
    given = words.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    outcomes, failures = run(given.mutations, given.seed)
    if given.json:
        rows = [{"bag": a, "fault": b, "opened": c, "outcome": d, "count": n} for (a, b, c, d), n in outcomes.items()]
        print(json.dumps({"mutations": given.mutations, "failures": failures, "outcomes": rows}, indent=1))
    else:
        for place, title in enumerate(("bag", "fault")):
            print(table(outcomes, place, title))
        print(f"{given.mutations} mutations, {len(failures)} failures")
        print("\n".join(failures[:10]), file=sys.stderr)
    return bool(failures)


if __name__ == "__main__":
    raise SystemExit(main())

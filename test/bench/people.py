# SPDX-License-Identifier: Apache-2.0
"""How safe the robot is around people, by an independent judge.

`python -m test.bench.people` lets people do what people do around the real pipeline, in simulated time, and judges what
the robot does by other bodies, another kinematics and other distances than the package's own (PyBullet). It prints a
table; `--json FILE` keeps every run, resumes there when called again with the same code, and is what
`--write docs/safety.md` makes the page from. Exit code 1: a promise is broken.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mild_core.errors import SetupError, unknown_name
from test.bench.around_people.judge import FALSE_START_M, SPEED_M_S, Judgement, judge
from test.bench.around_people.run import Expectation, play
from test.bench.around_people.scenes import SCENES

ROOT = Path(__file__).resolve().parents[2]
START_BEFORE_S = {
    "handshake": 0.10,
    "rocket": 0.10,
    "parachute": 0.07,
    "hand_wave": 0.09,
    "left_arm": 0.09,
    "pepper_handshake": 0.10,
}
"""From a hand that has left its rest to a robot that moves, before evidence was asked for: medians of this bench."""

LATER_S, CONTACT_M = 0.31, 0.04
"""Greetings start at most so much later than before, to a command; hands that meet are so near at the median."""

UNWANTED = {"turned_away": 0.0}
FEW = 1.0 / 7.0
"""Share of the runs of a scene without a greeting for the robot in which it may start, where not named above."""

FIELDS = set(Judgement.__dataclass_fields__)


@dataclass(frozen=True)
class Result:
    """One run of one scene."""

    scene: str
    seed: int
    expectation: Expectation
    judgement: Judgement
    wall_s: float

    def as_mapping(self) -> dict[str, Any]:
        """For a file."""
        return {**asdict(self), "judgement": self.judgement.as_mapping()}

    @staticmethod
    def of(values: dict[str, Any]) -> Result:
        """What `as_mapping` made."""
        expectation = Expectation(**values["expectation"])
        judgement = Judgement(**{key: value for key, value in values["judgement"].items() if key in FIELDS})
        return Result(values["scene"], values["seed"], expectation, judgement, values["wall_s"])


@dataclass(frozen=True)
class Verdict:
    """One promise in one scene.

    Attributes:
        promise: `distance`, `speed`, `towards`, `start`, `contact` or `limits`.
        kept: Whether it is.
        figure: What was measured, in words.
    """

    promise: str
    kept: bool
    figure: str


def run_one(job: tuple[str, int]) -> Result:
    """Play and judge one scene by one seed; the same seed gives the same result."""
    name, seed = job
    started_s = time.perf_counter()
    setting = SCENES[name].make(np.random.default_rng([seed, sum(name.encode())]))
    judgement = judge(setting, play(setting, seed))
    return Result(name, seed, setting.expectation, judgement, time.perf_counter() - started_s)


def nearest_m(results: Iterable[Result], part: str) -> float:
    """Least distance to heads, trunks or limbs in these runs; infinite where none was within 0.3 m."""
    kept = [value for result in results for kind, value in result.judgement.clearance_m.items() if kind.endswith(part)]
    return min(kept, default=np.inf)


def verdicts(results: Sequence[Result]) -> list[Verdict]:
    """What is promised of a scene, and whether its runs keep it."""
    found, expected = [], results[0].expectation
    judged = [result.judgement for result in results]
    broken = [
        (least - result.expectation.keep_m, least, result)
        for result in results
        if result.expectation.keep_m is not None
        and (least := min(result.judgement.clearance_m.values(), default=np.inf)) < result.expectation.keep_m
    ]
    if any(result.expectation.keep_m is not None for result in results):
        if broken:
            _, least, worst = min(broken, key=lambda each: each[0])
            kind = min(worst.judgement.clearance_m, key=worst.judgement.clearance_m.__getitem__)
            at = worst.judgement.clearance_at[kind]
            figure = f"{len(broken)} of {len(results)}, {100 * least:.1f} cm, {at}, seed {worst.seed}"
            found.append(Verdict("distance", False, figure))
        else:
            found.append(Verdict("distance", True, f"{100 * nearest_m(results, ''):.1f} cm"))
    fastest = max(results, key=lambda each: max(each.judgement.still_m_s))
    speed = max(fastest.judgement.still_m_s)
    figure = f"{speed:.3f} m/s"
    if speed > SPEED_M_S + 1e-3:
        figure += f": {fastest.judgement.still_at}, seed {fastest.seed}"
    found.append(Verdict("speed", speed <= SPEED_M_S + 1e-3, figure))
    over, commands = sum(each.towards_over for each in judged), sum(each.commands for each in judged)
    worst = max(results, key=lambda each: each.judgement.towards_m_s)
    figure = f"{100 * over / max(commands, 1):.2f} % of commands"
    if over:
        figure += f", {worst.judgement.towards_m_s:.2f} m/s over: {worst.judgement.towards_at}, seed {worst.seed}"
    found.append(Verdict("towards", over == 0, figure))
    if expected.starts == "unwanted":
        starts = [result for result in results if result.judgement.moved_m > FALSE_START_M]
        allowed = int(UNWANTED.get(results[0].scene, FEW) * len(results))
        figure = f"{len(starts)} of {len(results)} false starts"
        found.append(Verdict("start", len(starts) <= allowed, figure))
    elif expected.starts == "wanted":
        delays = [each.start_s for each in judged if each.start_s is not None]
        missed, late = len(judged) - len(delays), float(np.median(delays)) if delays else np.inf
        most = START_BEFORE_S.get(results[0].scene, np.inf) + LATER_S
        figure = f"{late:.2f} s" + (f", {missed} of {len(judged)} never" if missed else "")
        found.append(Verdict("start", not missed and late <= most, figure))
    apart = [each.contact_m for each in judged if each.contact_m is not None]
    if apart:
        middle = float(np.median(apart))
        found.append(Verdict("contact", middle <= CONTACT_M, f"{100 * middle:.1f} cm"))
    limits = sorted({what for each in judged for what in each.limits})
    found.append(Verdict("limits", not limits, ", ".join(limits) or "kept"))
    return found


def table(results: Sequence[Result]) -> list[list[str]]:
    """Rows of cells, the head first: one row for each scene."""
    bands = ("<0.1", "<0.15", "<0.25", "<0.3")
    rows = [["scene", "runs", "head", "trunk", "limbs"]]
    rows[0] += [f"{who} {band}" for who in ("still", "moving") for band in bands]
    rows[0] += ["over %", "peak", "false starts", "broken"]
    for name in dict.fromkeys(result.scene for result in results):
        own = [result for result in results if result.scene == name]
        judged = [result.judgement for result in own]
        cells = [name, str(len(own))]
        cells += [_cm(nearest_m(own, part)) for part in ("head", "trunk", "limbs")]
        for speeds in ([each.still_m_s for each in judged], [each.moving_m_s for each in judged]):
            cells += [f"{speed:.2f}" if speed else "" for speed in np.max(speeds, axis=0).tolist()]
        over, commands = sum(each.towards_over for each in judged), sum(each.commands for each in judged)
        cells += [f"{100 * over / max(commands, 1):.2f}", f"{max(each.towards_m_s for each in judged):.2f}"]
        unwanted = own[0].expectation.starts == "unwanted"
        cells.append(str(sum(each.moved_m > FALSE_START_M for each in judged)) if unwanted else "")
        cells.append(", ".join(each.promise for each in verdicts(own) if not each.kept) or "-")
        rows.append(cells)
    return rows


def _cm(metres: float) -> str:
    return f"{100 * metres:.1f}" if np.isfinite(metres) else ""


def printed(rows: Sequence[Sequence[str]]) -> str:
    """The table for a terminal."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = []
    for row in rows:
        first, *rest = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        lines.append("  ".join([first.strip().ljust(widths[0]), *rest]).rstrip())
    return "\n".join(lines)


def code_digest() -> str:
    """Changes with all code that a result depends on."""
    digest = hashlib.sha256()
    files = [
        *sorted((ROOT / "mild_core").rglob("*.py")),
        ROOT / "test/bench/people.py",
        *sorted((ROOT / "test/bench/around_people").glob("*.py")),
    ]
    for path in [*files, *sorted((ROOT / "mild_ros/assembly").glob("*.py"))]:
        if "learning" not in path.parts:
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _kept(path: Path | None, digest: str) -> list[Result]:
    """Results of an earlier call with the same code."""
    if path is None or not path.exists():
        return []
    try:
        known = json.loads(path.read_text())
        return [Result.of(each) for each in known["runs"]] if known["code"] == digest else []
    except (ValueError, KeyError, TypeError) as error:
        raise SetupError(str(path), f"holds no results ({error!r})", "give another file") from error


def _keep(path: Path | None, digest: str, results: Sequence[Result]) -> None:
    if path is not None:
        written = path.with_suffix(f".{os.getpid()}")
        runs = [result.as_mapping() for result in results]
        written.write_text(json.dumps({"code": digest, "runs": runs}, default=float) + "\n")
        written.replace(path)


def measured(jobs: Sequence[tuple[str, int]], processes: int, path: Path | None, quiet: bool = False) -> list[Result]:
    """Results of all jobs, in their order; what an earlier call has left in the file is not done again."""
    digest = code_digest()
    known = {(each.scene, each.seed): each for each in _kept(path, digest)}
    waiting = [job for job in jobs if job not in known]
    started_s = kept_s = time.monotonic()

    def took(result: Result, number: int) -> None:
        nonlocal kept_s
        known[result.scene, result.seed] = result
        if not quiet:
            left_s = (time.monotonic() - started_s) / number * (len(waiting) - number)
            least = _cm(min(result.judgement.clearance_m.values(), default=np.inf)) or "-"
            speed = max(result.judgement.still_m_s)
            line = f"[{number}/{len(waiting)}] {result.scene} seed {result.seed}: {least} cm, {speed:.2f} m/s"
            print(f"{line}; {left_s / 60:.1f} min left", file=sys.stderr, flush=True)
        if time.monotonic() - kept_s > 10.0 or number == len(waiting):
            _keep(path, digest, list(known.values()))
            kept_s = time.monotonic()

    if processes > 1 and len(waiting) > 1:
        with multiprocessing.get_context("spawn").Pool(min(processes, len(waiting))) as pool:
            for number, result in enumerate(pool.imap_unordered(run_one, waiting), 1):
                took(result, number)
    else:
        for number, job in enumerate(waiting, 1):
            took(run_one(job), number)
    return [known[job] for job in jobs]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print, write; 0 when every promise is kept, 1 when one is not, 2 for a wrong call."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--scene", nargs="+", default=[], metavar="NAME", help="only these; see --list")
    parser.add_argument("--seed", type=int, default=0, help="of the first run of each scene (0)")
    parser.add_argument("--count", type=int, default=7, help="runs of each scene (7)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at once (all cores)")
    parser.add_argument("--quick", action="store_true", help="a few scenes, one run each: under a minute")
    parser.add_argument("--json", type=Path, metavar="FILE", help="keep every run here, and resume from it")
    parser.add_argument(
        "--write", type=Path, metavar="FILE", help="bring the measured part of docs/safety.md up to date"
    )
    parser.add_argument("--list", action="store_true", help="name the scenes and end")
    given = parser.parse_args(argv)
    try:
        if given.list:
            print("\n".join(f"{each.name:28} {each.what}" for each in SCENES.values()))
            return 0
        names = given.scene or [name for name, each in SCENES.items() if each.quick or not given.quick]
        for name in names:
            if name not in SCENES:
                raise unknown_name("scene", name, list(SCENES))
        if given.count < 1 or given.jobs < 1:
            raise SetupError("people", "--count and --jobs must be 1 or more", "give a number above 0")
        count = 1 if given.quick else given.count
        jobs = [(name, seed) for name in names for seed in range(given.seed, given.seed + count)]
        results = measured(jobs, given.jobs, given.json)
    except SetupError as error:
        print(error, file=sys.stderr)
        return 2
    print(printed(table(results)))
    print("\ndistances in cm, speeds in m/s by distance in m; over: commands towards a moving person, not braking\n")
    by_scene = {name: verdicts([each for each in results if each.scene == name]) for name in names}
    for name, judged in by_scene.items():
        for each in judged:
            if not each.kept:
                print(f"broken: {name}: {each.promise}: {each.figure}")
    promises = sum(len(judged) for judged in by_scene.values())
    broken = sum(not each.kept for judged in by_scene.values() for each in judged)
    print(f"{len(results)} runs of {len(names)} scenes, {promises} promises, {broken} broken")
    if given.write is not None:
        from test.bench.around_people.page import page

        try:
            given.write.write_text(page(given.write.read_text(), results))
        except (OSError, SetupError) as error:
            print(error, file=sys.stderr)
            return 2
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())

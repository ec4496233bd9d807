# SPDX-License-Identifier: Apache-2.0
"""Output of the commands that run nodes: numbers, pictures and a page of one recorded run."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from mild_core.errors import MildError, SetupError
from mild_core.printable import printable
from mild_core.shapes import FloatArray
from mild_ros.assembly.perception import make_perception, manifest_of, skeleton_source
from mild_ros.assembly.robot import make_robot_to_draw
from mild_ros.command_line.console import Console
from mild_ros.replay.demo import RunOptions, run_nodes
from mild_ros.replay.recorded import RecordedRun, read_run
from mild_ros.viewing.filmstrip import draw_filmstrip
from mild_ros.viewing.page import write_page
from mild_ros.viewing.plots import draw_plots
from mild_ros.viewing.report import Report, make_report
from mild_ros.viewing.staging import Staged, stage

FILMSTRIP, PLOTS, PAGE, NUMBERS = "filmstrip.png", "plots.png", "page.html", "report.json"


@dataclass(frozen=True)
class Shown:
    """What was left of a run.

    Attributes:
        report: The numbers.
        files: What to look at, in order.
        run: What they are of.
        problems: Why a picture is missing, a line each.
    """

    report: Report
    files: tuple[Path, ...]
    run: RecordedRun
    problems: tuple[str, ...] = ()


def run_with_progress(bag: Path, out: Path, options: RunOptions, console: Console, *, paused: bool = False) -> Path:
    """Run the nodes on a bag behind a progress bar, after Enter when `paused`; returns the recorded bag.

    Raises:
        SetupError: As `run_nodes`, or there is no terminal to press Enter in.
    """
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=1.0)

        def wait_for_enter() -> None:
            progress.stop()
            try:
                console.input(f"Everything is at work. Press Enter to begin {bag.name}: ")
            except EOFError:
                raise SetupError("--paused", "there is no terminal to press Enter in", "leave it out") from None
            progress.start()

        def show_progress(what: str, share: float) -> None:
            if not console.is_terminal and what != progress.tasks[0].description:
                progress.console.print(what)  # without a terminal there is no bar
            progress.update(task, description=what, completed=share)

        return run_nodes(bag, out, options, show_progress, wait_for_enter if paused else lambda: None)


def leave(recorded: Path, out: Path, options: RunOptions, title: str, console: Console) -> Shown:
    """Measure a recorded run and draw it. A picture that fails costs neither the numbers nor the other pictures.

    Args:
        recorded: The bag.
        out: Folder for the pictures, the page and the numbers.
        options: How it was run.
        title: Of the pictures.
        console: Where to print progress.

    Raises:
        SetupError: The bag cannot be read.
    """
    title = printable(title)  # the bag's name may hold what no font and no page can
    parameters = options.pipeline
    robot = make_robot_to_draw(parameters.robot, parameters.robot_description)
    source = skeleton_source(parameters)
    run = read_run(recorded, source, salvage=options.salvage)
    report, manifest = make_report(run, robot), manifest_of(parameters.model)
    (out / NUMBERS).write_text(json.dumps(as_data(run, report), indent=1) + "\n")
    staged: list[Staged] = []
    drawings: tuple[tuple[str, Callable[[], None]], ...] = (
        (PLOTS, lambda: draw_plots(run, report, robot.joint_names, out / PLOTS, title)),
        ("scene", lambda: staged.append(stage(run, make_perception(parameters, manifest), manifest, robot))),
        (FILMSTRIP, lambda: draw_filmstrip(staged[0], robot, out / FILMSTRIP, title)),
        (PAGE, lambda: write_page(staged[0], robot, out / PAGE, title)),
    )
    made, problems = [recorded], []
    with console.status("drawing"):
        for name, draw in drawings:
            (out / name).unlink(missing_ok=True)  # of an earlier run
            if name in (FILMSTRIP, PAGE) and not staged:
                continue
            try:
                draw()
            except Exception as error:  # drawn by libraries from files of the user: anything may come of that
                problems.append(f"no {name}: {_reason(error)}")
            else:
                made += [out / name] * (name != "scene")
    return Shown(report, (*made, out / NUMBERS), run, tuple(problems))


def _reason(error: Exception) -> str:
    """What went wrong, in one line."""
    text = " ".join(str(error).split())
    return text if isinstance(error, MildError) else f"{type(error).__name__}: {text}"


def print_summary(shown: Shown, title: str, console: Console) -> None:
    """The numbers of a run as a table, then where its files are."""
    table = Table(title=title, title_justify="left", show_header=False, title_style="bold")
    for name, value in _lines(shown.report):
        table.add_row(name, value)
    console.print(table)
    for path in shown.files:
        console.print(f"  {path}", highlight=False, soft_wrap=True)
    for problem in shown.problems:
        console.print(f"  {problem}", style="yellow", highlight=False, markup=False, soft_wrap=True)


def _lines(report: Report) -> list[tuple[str, str]]:
    """Rows printed of a run: a name and a value each."""
    lines = [("skeleton stamp → command sent", _ages_text(report.sent_ages_ms))]
    none = "unknown" if report.commands else "no command"
    lines.append(("skeleton stamp → first command received", _percentiles(report.answer_ages_ms, none)))
    lines.append(("age of the skeleton behind any command", _percentiles(report.command_ages_ms, none)))
    lines.append(("rates", ", ".join(f"{name} {rate:.1f} Hz" for name, rate in report.rates_hz.items())))
    lines.append(("tracker messages", ", ".join(f"{number} {name}" for name, number in report.outcomes.items()) or "-"))
    lines.append(("dropped before perception", "unknown" if report.dropped is None else str(report.dropped)))
    if report.unrecorded:
        lines.append(("seen, but not recorded", str(report.unrecorded)))
    if report.limits is not None:
        used = report.limits
        shares = f"position {used.position:.0%}, velocity {used.velocity:.0%}, acceleration {used.acceleration:.0%}"
        lines.append(("limits", f"{'kept' if used.kept else 'BROKEN'}: at most {shares} of each was used"))
    for name, error in (("predicted", report.predicted_error_deg), ("commanded", report.error_deg)):
        if error is not None:
            lines.append((f"{name} joints less true ones", f"{error:.1f}° RMS"))
    if report.error_deg is None:
        lines.append(("error", "the true motion is unknown: a synthetic scene has none"))
    return lines


def _ages_text(ages_ms: tuple[float, float, float] | None) -> str:
    if ages_ms is None:
        return "unknown"
    return "median {:.1f} ms, 99 % below {:.1f} ms, greatest {:.1f} ms".format(*ages_ms)


def _percentiles(ages_ms: FloatArray, none: str) -> str:
    if not len(ages_ms):
        return none
    middle, high, top = np.percentile(ages_ms, [50, 99, 100])
    return _ages_text((float(middle), float(high), float(top)))


def as_data(run: RecordedRun, report: Report) -> dict[str, Any]:
    """The numbers as JSON can hold them."""

    def ages(values: FloatArray) -> list[float] | None:
        return [float(value) for value in np.percentile(values, [50, 99, 100])] if len(values) else None

    limits = report.limits
    return {
        "duration_s": run.duration_s,
        "commands": 0 if run.commands is None else len(run.commands.stamps_ns),
        "sent_age_ms": report.sent_ages_ms,
        "answer_age_ms": ages(report.answer_ages_ms),
        "command_age_ms": ages(report.command_ages_ms),
        "rates_hz": dict(report.rates_hz),
        "outcomes": dict(report.outcomes),
        "dropped": report.dropped,
        "unrecorded": report.unrecorded,
        "limits": None if limits is None else {**vars(limits), "kept": limits.kept},
        "error_deg": report.error_deg,
        "predicted_error_deg": report.predicted_error_deg,
        "jumps": report.jumps,
    }

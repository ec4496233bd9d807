# SPDX-License-Identifier: Apache-2.0
"""`mild faults`: everything that may go wrong is done to real nodes, and the robot is watched."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from mild_core.errors import SetupError, unknown_name
from mild_ros.command_line.console import Console
from mild_ros.command_line.measure import enter_checkout

if TYPE_CHECKING:
    from test.faults.trial import Outcome


def faults(
    only: Annotated[list[str] | None, typer.Argument(metavar="[FAULT]...", help="Only these; all by default.")] = None,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where the page and the nodes' logs go.")] = Path(
        "out/faults"
    ),
) -> None:
    """Injects faults around real nodes and checks the commands.

    Trackers that stop, stutter, flood, send NaN or another person, clocks that jump, a robot that falls silent or is
    pushed, processes that are killed: each for a second or two, one after the other, without a restart in between.
    Every command is judged by the robot's limits. Takes about two minutes, and leaves a page, `faults.md`.

        mild faults

        mild faults "tracker stops" NaN

    Ends with exit code 2 where something was not survived.
    """
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # as for the nodes; read when ROS starts
    enter_checkout("faults")
    from test.faults.page import page
    from test.faults.table import FAULTS
    from test.faults.trial import all_tried

    for name in only or ():
        if name not in FAULTS:
            raise unknown_name("fault", name, FAULTS)
    wanted = [FAULTS[name] for name in only or FAULTS]
    console = Console(highlight=False)
    outcomes: dict[str, Outcome] = {}
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("starting nodes", total=len(wanted))
        for outcome in all_tried(wanted, out / "log"):
            outcomes[outcome.fault.name] = outcome
            progress.update(task, description=outcome.fault.name, advance=1)
    ordered = [outcomes[fault.name] for fault in wanted]
    console.print(_table(ordered))
    (out / "faults.md").write_text(page(ordered))
    console.print(f"{out / 'faults.md'}: the same, to read")
    if broken := [outcome.fault.name for outcome in ordered if outcome.wrong]:
        raise SetupError("faults", f"not survived: {', '.join(broken)}", f"see {out / 'log'}; please report it")


def _table(outcomes: list[Outcome]) -> Table:
    """What came of each fault."""
    table = Table("fault", "the robot", "at rest after", "follows again after", "commands judged", "", box=None)
    for one in outcomes:
        rested = "" if one.rest_s is None else f"{one.rest_s:.2f} s"
        again = "" if one.recovery_s is None else f"{one.recovery_s:.2f} s"
        verdict = Text("; ".join(one.wrong), "red") if one.wrong else Text("survived", "green")
        table.add_row(one.fault.name, one.fault.answer, rested, again, str(one.commands), verdict)
    return table

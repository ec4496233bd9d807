# SPDX-License-Identifier: Apache-2.0
"""`mild doctor`: is this machine fit, and if not, what to do."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer
from rich.text import Text

from mild_core.printable import printable_lines
from mild_ros.command_line.console import Console
from mild_ros.environment.doctor import examinations

UNWELL = 1


def doctor(
    machines: Annotated[
        bool, typer.Option("--machines", help="Also: is a doctor on another machine heard? Run it on both at once.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="The findings as one JSON array.")] = False,
) -> None:
    """Checks this machine's Python, ROS 2 and network and says what to do.

    Each line names a check and its finding; a line with a cross is followed by what to do about it:

        mild doctor

    Nodes that run in the domain of this terminal are asked too: a rate that is too low, a tf frame or a topic that is
    not there, a second commander are reported from their diagnostics. Between machines, at the same time on both:

        mild doctor --machines

    Ends with exit code 1 where something is not well.
    """
    console = Console(highlight=False)
    findings = []
    with examinations(machines=machines) as asked:
        for examination in asked:
            finding = examination()
            findings.append(finding)
            if not as_json:
                mark = ("✓", "green") if finding.well else ("✗", "red")
                line = Text.assemble(mark, f" {printable_lines(f'{finding.subject}: {finding.seen}')}")
                console.print(line, soft_wrap=True)
                if not finding.well:
                    console.print(f"    {finding.remedy}", style="bold", soft_wrap=True)
    if as_json:
        print(json.dumps([asdict(finding) for finding in findings], indent=1))
    if not all(finding.well for finding in findings):
        raise typer.Exit(UNWELL)

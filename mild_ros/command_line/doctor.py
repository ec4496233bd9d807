# SPDX-License-Identifier: Apache-2.0
"""`mild doctor`: is this machine fit, and if not, what to do."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer
from rich.console import Console

from mild_ros.doctor import examine

UNWELL = 1


def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="The findings as one JSON array.")] = False,
) -> None:
    """Checks this machine's Python, ROS 2 and network and says what to do.

    Each line tells what was looked at and seen; a line with a cross is followed by what to do about it:

        mild doctor

    Ends with exit code 1 where something is not well.
    """
    console = Console(highlight=False)
    findings = []
    for finding in examine():
        findings.append(finding)
        if not as_json:
            console.print(f"{'[green]✓[/]' if finding.well else '[red]✗[/]'} {finding.subject}: {finding.seen}")
            if not finding.well:
                console.print(f"    [bold]{finding.remedy}[/]")
    if as_json:
        print(json.dumps([asdict(finding) for finding in findings], indent=1))
    if not all(finding.well for finding in findings):
        raise typer.Exit(UNWELL)

# SPDX-License-Identifier: Apache-2.0
"""`mild status`, `hold`, `enable`, `reset`, `pause` and `label`: what an operator does to running nodes."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mild_core.errors import SetupError
from mild_core.printable import printable, printable_lines
from mild_ros.command_line.console import Console

if TYPE_CHECKING:
    from mild_ros.command_line.operator_client import NodeStatus

Namespace = Annotated[str, typer.Option(metavar="NAME", help="Only nodes in this namespace [default: all].")]

UNWELL = 1
STYLES = {"ok": "green", "warning": "yellow", "ERROR": "bold red", "stale": "red"}


def status(
    watch: Annotated[bool, typer.Option("--watch", help="Again and again, until control-C.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Everything the nodes report, as one JSON array.")] = False,
) -> None:
    """One screen of what runs: nodes, mode, rates, latency and alarms.

        mild status

    Reads `/diagnostics` in the ROS domain of this terminal. Ends with exit code 1 where a node reports an error, and
    with 2 where no node reports at all.
    """
    from mild_ros.command_line.operator_client import START_ONE, operator_client
    from mild_ros.node_kit.dds_variables import domain_id, heard_remedy

    with operator_client() as client:
        found = client.statuses()
        if not found:
            raise SetupError("status", f"no node reports in ROS domain {domain_id()}", heard_remedy(START_ONE))
        if as_json:
            print(json.dumps([asdict(one) for one in found], indent=1))
        elif watch:
            with Live(_screen(found), console=Console(highlight=False)) as live:
                while True:
                    live.update(_screen(client.statuses()))
        else:
            Console(highlight=False).print(_screen(found))
    if any(one.level in ("ERROR", "stale") for one in found):
        raise typer.Exit(UNWELL)


def hold(
    release: Annotated[bool, typer.Option("--release", help="Let it go on.")] = False, namespace: Namespace = ""
) -> None:
    """Stops every robot smoothly at once; it stays until it is released.

        mild hold

        mild hold --release

    The command of that very moment is the first of the stop. No person, tracker or model is needed.
    """
    _call("hold", namespace, not release)


def enable(
    off: Annotated[bool, typer.Option("--off", help="Stop smoothly, then send nothing.")] = False,
    namespace: Namespace = "",
) -> None:
    """Lets every robot follow again, or with `--off` stops it smoothly and sends no more commands.

        mild enable --off

    A robot that another node commands too stays still, and the answer says so.
    """
    _call("enable", namespace, not off)


def reset(namespace: Namespace = "") -> None:
    """Forgets the person and the calibration; the robot stops smoothly and goes home.

    mild reset
    """
    _call("reset", namespace, None)


def pause(off: Annotated[bool, typer.Option("--off", help="Let it go on.")] = False, namespace: Namespace = "") -> None:
    """Stops a replay that runs, or with `--off` lets it go on; one with `paused:=true` begins so.

    mild pause

    mild pause --off
    """
    _call("pause", namespace, not off)


def label(
    text: Annotated[str, typer.Argument(metavar="NAME", help="Of the interaction.")],
    topic: Annotated[str, typer.Option(metavar="TOPIC", help="Where it is said.")] = "/label",
) -> None:
    """Says which interaction begins now, while bags to learn from are recorded.

        mild label handshake

    Waits for a subscriber, such as `mild record`. Then: `mild demonstrations --label topic:/label`.
    """
    from mild_ros.command_line.operator_client import operator_client

    with operator_client() as client:
        listeners = client.say(topic, text)
    Console(highlight=False).print(f"{topic}: '{text}' to {listeners}")


def _call(name: str, namespace: str, data: bool | None) -> None:
    from mild_ros.command_line.operator_client import operator_client

    begin_s = time.monotonic()
    with operator_client() as client:
        answers = client.call(name, namespace, data)
    console = Console(highlight=False)
    for answer in answers:
        mark = Text("✓", style="green") if answer.success else Text("✗", style="red")
        console.print(mark, Text(f"{answer.service}: {answer.message}"))
    if not all(answer.success for answer in answers):
        raise SetupError(name, f"refused after {time.monotonic() - begin_s:.1f} s", "see ./mild status")


def _screen(found: list[NodeStatus]) -> Group:
    """Nodes one below the other, what needs attention first."""
    table = Table("node", "state", "what", "rates", "latency", box=None, title_justify="left")
    order = {"ERROR": 0, "stale": 1, "warning": 2, "ok": 3}
    for one in sorted(found, key=lambda each: order[each.level]):
        rates = [
            f"{key.removesuffix(' rate [Hz]')} {value}" for key, value in one.values.items() if key.endswith("[Hz]")
        ]
        ages = [f"{key.removesuffix(' [ms]')} {value} ms" for key, value in one.values.items() if "p50 [ms]" in key]
        table.add_row(
            Text(printable(one.name)),
            Text(one.level, style=STYLES[one.level]),
            Text(printable(one.message)),
            Text(printable_lines("\n".join(f"{rate} Hz" for rate in rates))),
            Text(printable_lines("\n".join(ages))),
        )
    modes = {one.name: one.values["mode"] for one in found if "mode" in one.values}
    lines = [Text(printable(f"{name}: {mode}"), style="bold") for name, mode in modes.items()]
    return Group(*lines, table)

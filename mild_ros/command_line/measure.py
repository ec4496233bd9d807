# SPDX-License-Identifier: Apache-2.0
"""`mild measure`: the benches behind the figures that README and docs print.

They live beside the tests, which are not installed: only a checkout has them.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Annotated, Protocol

import typer
from rich.table import Table

from mild_core.errors import SetupError, unknown_name
from mild_ros.command_line.console import Console

CHECKOUT = Path(__file__).resolve().parents[2]
CONTEXT_SETTINGS = {"measure": {"allow_interspersed_args": False}}
"""What follows the name belongs to the bench, `--help` included."""


class Bench(Protocol):
    """What the table says of a bench."""

    summary: str
    minutes: float
    needs: str


def enter_checkout(command: str, checkout: Path = CHECKOUT) -> None:
    """Make importable what lies beside the tests: `test.bench`, `test.faults`.

    Raises:
        SetupError: `checkout` has none: the package was installed without its tests.
    """
    if not (checkout / "test" / "bench" / "__init__.py").is_file():
        raise SetupError(
            command, f"{checkout} has no test/bench", f"tests are not installed: run `./mild {command}` in a checkout"
        )
    if sys.path[:1] != [str(checkout)]:
        sys.path.insert(0, str(checkout))  # first: Python has a package named test of its own


def benches(checkout: Path = CHECKOUT) -> Mapping[str, Bench]:
    """The table of benches by name; afterwards their modules can be imported.

    Raises:
        SetupError: `checkout` has none: the package was installed without its tests.
    """
    enter_checkout("measure", checkout)
    # By name and late: the shell never depends on tests.
    table: Mapping[str, Bench] = import_module("test.bench").BENCHES
    return table


def duration(minutes: float) -> str:
    """Roughly how long a bench takes, for people."""
    return f"{60 * minutes:.0f} s" if minutes < 1 else f"{minutes:.0f} min"


def measure(
    bench: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME [OPTIONS]", help="A bench and its options; without one, the list of them."),
    ] = None,
) -> None:
    """Run a bench, or list them; `--help` shows `_help()` in place of this line."""
    if not bench:
        _print(benches())
        return
    name, *options = bench
    if name not in (known := benches()):
        raise unknown_name("bench", name, known)
    sys.argv = [f"mild measure {name}", *options]
    raise SystemExit(import_module(f"test.bench.{name}").main())


def _print(known: Mapping[str, Bench]) -> None:
    table = Table("bench", "takes about", "measures", "needs", box=None)
    for name, one in known.items():
        table.add_row(name, duration(one.minutes), one.summary, one.needs)
    console = Console(highlight=False)
    console.print(table)
    console.print("`mild measure NAME` runs one; `mild measure NAME --help` lists its options")


def _help(checkout: Path = CHECKOUT) -> str:
    """What `--help` says: the benches of this checkout, one a line."""
    text = (
        "Runs the benches behind the figures that README and docs print.\n\n"
        "Without a name it lists them. What follows the name goes to the bench:\n\n"
        "    mild measure contact --every 2\n\n"
        "    mild measure soak --help\n\n"
    )
    try:
        known = benches(checkout)
    except SetupError as error:
        return f"{text}{error}"
    lines = (
        f"- `{name}` ({duration(one.minutes)}{'; needs ' + one.needs if one.needs else ''}): {one.summary}"
        for name, one in known.items()
    )
    return text + "\n".join(lines)


measure.__doc__ = _help()

# SPDX-License-Identifier: Apache-2.0
"""What the command line prints of foreign names is text, whatever they hold."""

from __future__ import annotations

import ast
import io
from pathlib import Path

from rich.console import Group
from rich.table import Table
from rich.text import Text

from mild_ros.command_line.console import Console

ROOT = Path(__file__).parents[2]
HOSTILE = "\x1b]0;owned\x07[red]bag[/red]\u202e[/nosuch]"


def printed(*shown: object) -> str:
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=200, highlight=False)
    for one in shown:
        console.print(one)
    return out.getvalue()


def test_neither_escapes_nor_markup_of_a_name_are_obeyed() -> None:
    table = Table(title=HOSTILE, show_header=False)
    table.add_row(HOSTILE, Text(HOSTILE, "green"))
    for shown in (HOSTILE, Text(HOSTILE), table):
        text = printed(shown)
        assert "\x1b]" not in text
        assert "\x07" not in text
        assert "\u202e" not in text
        assert "[red]bag[/red]" in text


def test_a_style_that_is_meant_is_shown() -> None:
    assert "\x1b[" in printed(Text("survived", "green"))


def test_the_command_line_has_no_other_console() -> None:
    for path in (ROOT / "mild_ros" / "command_line").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module == "rich.console" and path.name != "console.py":
                assert "Console" not in {name.name for name in node.names}, path


def test_a_narrow_terminal_costs_no_word_of_a_table() -> None:
    table = Table("model", "error")
    table.add_row("yumi_buetepage_ahead", "0.0447 ± 0.0001 m²")
    for shown in (table, Group(table)):
        out = io.StringIO()
        console = Console(file=out, width=20)
        console.print(shown)
        assert {"yumi_buetepage_ahead", "0.0447", "0.0001"} <= set(out.getvalue().split())

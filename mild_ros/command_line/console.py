# SPDX-License-Identifier: Apache-2.0
"""The console of the command line: names out of bags and folders neither command the terminal nor are markup."""

from __future__ import annotations

from typing import Any

from rich.console import Console as RichConsole
from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from mild_core.printable import printable, printable_lines


class Console(RichConsole):
    """A console that prints text as it is; styles are given as `style` or as `Text`, never as markup."""

    def print(self, *objects: Any, **options: Any) -> None:
        """As of rich, with text made printable, and tables rather wider than the terminal than without their words."""
        shown = [_safe(one) for one in objects]
        whole = [_keep_words(one) for one in shown]
        super().print(*shown, **{"markup": False, "crop": not any(whole), **options})


def _keep_words(shown: Any) -> bool:
    """Let no column of a table be narrower than its words; whether something is a table."""
    if isinstance(shown, Group):
        kept = [_keep_words(one) for one in shown.renderables]  # each of them
        return any(kept)
    if not isinstance(shown, Table):
        return False
    for column in shown.columns:
        column.min_width = max(column.min_width or 0, *map(len, _kept_whole(column)), 1)
    return True


def _kept_whole(column: Column) -> list[str]:
    """What is not to be cut: the words of a column, its lines where they do not wrap."""
    cells = [str(cell) for cell in (column.header, *column.cells)]
    return [part for cell in cells for part in (cell.splitlines() if column.no_wrap else cell.split())]


def _safe(shown: Any) -> Any:
    if isinstance(shown, str):
        return printable_lines(shown)
    if isinstance(shown, Text):
        plain = printable_lines(shown.plain)
        return shown if plain == shown.plain else Text(plain)
    if isinstance(shown, Table):
        for column in shown.columns:
            cells = [Text(printable(cell)) if isinstance(cell, str) else _safe(cell) for cell in column.cells]
            column._cells[:] = cells
        if isinstance(shown.title, str):
            shown.title = Text(printable(shown.title), shown.title_style or "")
    return shown

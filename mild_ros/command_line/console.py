# SPDX-License-Identifier: Apache-2.0
"""The console of the command line: names out of bags and folders neither command the terminal nor are markup."""

from __future__ import annotations

from typing import Any

from rich.console import Console as RichConsole
from rich.table import Table
from rich.text import Text

from mild_core.printable import printable, printable_lines


class Console(RichConsole):
    """A console that prints text as it is; styles are given as `style` or as `Text`, never as markup."""

    def print(self, *objects: Any, **options: Any) -> None:
        """As of rich, with text made printable."""
        super().print(*[_safe(one) for one in objects], **{"markup": False, **options})


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

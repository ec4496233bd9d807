# SPDX-License-Identifier: Apache-2.0
"""Errors for people and for machines: tables, JSON, Markdown."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.table import Table

from mild_ros.command_line.console import Console
from mild_ros.viewing.figures.tables import STARS, star

if TYPE_CHECKING:
    from mild_core.learning.data.units import Unit
    from mild_core.learning.evaluation.comparison import Relative, Row
    from mild_core.learning.evaluation.errors import Errors


def errors_as_data(errors: Errors, unit: Unit) -> dict[str, Any]:
    """Errors as plain data; a figure that does not exist is None. Keys of plain errors end in their unit."""

    def scaled(error: float | None) -> float | None:
        return None if error is None else error * unit.scale

    rows = {
        name: {
            "mse": row.mse,
            "mse_std": row.mse_std,
            f"mean_absolute_{unit.key}": scaled(row.mean_absolute),
            "windows": row.windows,
            "trials": row.trials,
        }
        for name, row in errors.interactions.items()
    }
    return {
        "macro": {"mse": errors.macro_mse, "interval": errors.macro_interval},
        "interactions": rows,
        f"rmse_{unit.key}": scaled(errors.pooled_rmse),
        f"mean_absolute_{unit.key}": scaled(errors.mean_absolute),
        "windows": errors.windows,
        "trials": errors.trials,
        "unit": unit.squared,
    }


def print_json(head: Mapping[str, Any], errors: Errors, unit: Unit) -> None:
    """One object on standard output."""
    print(json.dumps({**head, **errors_as_data(errors, unit)}, indent=1))


def print_model(head: Mapping[str, Any], errors: Errors, unit: Unit) -> None:
    """A table of one model's errors."""
    console = Console()
    if errors.macro_mse is None:
        console.print(f"{head['model']}: {head['note']} (0 windows)", highlight=False, soft_wrap=True)
        return
    title = f"{head['model']}: protocol {head['protocol']}, {head['split']} trials, labels {head['labels']}"
    table = Table("interaction", title=title)
    for column in (f"error, {unit.squared_shown}", "± over windows", "mean", "windows", "trials"):
        table.add_column(column, justify="right")
    for name, row in errors.interactions.items():
        cells = (_number(row.mse), _number(row.mse_std), unit.plain(row.mean_absolute))
        table.add_row(name, *cells, str(row.windows), str(row.trials))
    table.add_section()
    table.add_row("macro", _number(errors.macro_mse), "", "", str(errors.windows), str(errors.trials))
    console.print(table)
    low, high = errors.macro_interval or (math.nan, math.nan)
    macro = f"macro {_number(errors.macro_mse)} {unit.squared_shown}"
    lines = [f"{macro}, 95 % of draws of trials within {low:.4f} to {high:.4f}"]
    lines += [f"all windows: RMSE {unit.plain(errors.pooled_rmse)}, mean {unit.plain(errors.mean_absolute)}"]
    if head["recognised_share"] is not None:
        lines += [f"the right interaction in {head['recognised_share']:.1%} of the windows"]
    console.print("\n".join([*lines, *([head["note"]] if head["note"] else [])]), highlight=False, soft_wrap=True)


def rows_as_data(rows: Sequence[Row], unit: Unit) -> list[dict[str, Any]]:
    """A comparison as plain data."""
    return [
        {
            "method": row.method,
            "title": row.title,
            "labels": row.labels,
            "seeds": row.seeds,
            "macro_mean": row.macro_mean,
            "macro_std": row.macro_std,
            "relative": {
                name: {"change": relative.change, "interval": relative.interval, "p_value": relative.p_value}
                for name, relative in row.relative.items()
            },
            "seconds": row.seconds,
            "residual_covariance": None if row.errors.covariance is None else row.errors.covariance.tolist(),
            **_with_papers(errors_as_data(row.errors, unit), row, unit),
        }
        for row in rows
    ]


def _with_papers(data: dict[str, Any], row: Row, unit: Unit) -> dict[str, Any]:
    """Errors with what the MILD paper's tables show beside them: its unit, and a test against Bütepage et al."""
    for name, one in data["interactions"].items():
        if unit.paper_scale is not None and one["mse"] is not None:
            one |= {"paper_mse": one["mse"] * unit.paper_scale, "paper_mse_std": one["mse_std"] * unit.paper_scale}
        if name in row.p_against_buetepage:
            one["p_against_buetepage"] = row.p_against_buetepage[name]
    return data


def overall_cells(rows: Sequence[Row], unit: Unit) -> list[list[str]]:
    """Header and lines of the comparison over all interactions, for `rich` and Markdown alike."""
    bars = list(dict.fromkeys(name for row in rows for name in row.relative))
    titles = {row.method: row.title for row in rows}
    heads = ("method", "labels", f"macro, {unit.squared_shown}", "95 %", "RMSE", "mean")
    lines = [[*heads, *(f"vs {titles[name]}" for name in bars)]]
    for row in rows:
        low, high = row.errors.macro_interval or (math.nan, math.nan)
        spread = "" if row.macro_std is None else f" ± {row.macro_std:.4f}"
        against = [_against(row.relative[name]) if name in row.relative else "" for name in bars]
        macro = f"{row.macro_mean:.4f}{spread}"
        plain = (unit.plain(row.errors.pooled_rmse), unit.plain(row.errors.mean_absolute))
        lines.append([row.title, row.labels, macro, f"{low:.4f} to {high:.4f}", *plain, *against])
    return lines


def _against(relative: Relative) -> str:
    """Change against a bar, and how easily chance alone would bring it about."""
    p_value = "< .001" if relative.p_value < 0.001 else f"{relative.p_value:.3f}".lstrip("0")
    return f"{relative.change:+.0%} (p {p_value})"


def interaction_cells(rows: Sequence[Row], spread: bool) -> list[list[str]]:
    """Header and lines of the comparison interaction by interaction; `spread`: with the deviation over windows."""
    names = list(rows[0].errors.interactions)
    lines = [["method", "labels", *names]]
    for row in rows:
        each = ((name, row.errors.interactions[name]) for name in names)
        cells = (
            _number(one.mse)
            + (f" ± {_number(one.mse_std)}" if spread else "")
            + star(row.p_against_buetepage.get(name))
            for name, one in each
        )
        lines.append([row.title, row.labels, *cells])
    return lines


def print_comparison(title: str, rows: Sequence[Row], unit: Unit) -> None:
    """Tables of all methods, the best first."""
    print_cells(title, overall_cells(rows, unit), 2)
    print_cells(
        f"by interaction{'; ' + STARS if any(row.p_against_buetepage for row in rows) else ''}",
        interaction_cells(rows, spread=False),
        2,
    )


def print_cells(title: str, lines: Sequence[Sequence[str]], named: int) -> None:
    """A table of a header and lines, none for no lines; the first `named` columns are names."""
    if not lines:
        return
    table = Table(title=title)
    for place, column in enumerate(lines[0]):
        table.add_column(column, justify="left" if place < named else "right", no_wrap=place == named)
    for line in lines[1:]:
        table.add_row(*line)
    Console().print(table)


def markdown(rows: Sequence[Row], unit: Unit) -> str:
    """The same tables in Markdown."""
    return "\n".join(
        markdown_table(lines, 2) for lines in (overall_cells(rows, unit), interaction_cells(rows, spread=True))
    )


def markdown_table(lines: Sequence[Sequence[str]], named: int) -> str:
    """The same as `print_cells`."""
    if not lines:
        return ""
    rule = [*["---"] * named, *["---:"] * (len(lines[0]) - named)]
    return "".join(f"| {' | '.join(line)} |\n" for line in (lines[0], rule, *lines[1:]))


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"

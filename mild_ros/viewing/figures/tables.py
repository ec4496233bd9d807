# SPDX-License-Identifier: Apache-2.0
"""Tables of errors by interaction and method, for papers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mild_ros.viewing.style import counted, spoken

PLUS_MINUS = r"$\pm$"
UNITS = {"rad^2": ("rad²", r"rad$^2$"), "m^2": ("m²", r"m$^2$")}
SIGNIFICANT = 0.05
STARS = "*: p < .05 against Bütepage et al., Wilcoxon's signed-rank test over the interaction's trials"
PAPERS_UNIT = "in brackets the same times 100, which the paper calls cm"


def star(p_value: float | None) -> str:
    """What marks an error that differs from that of Bütepage et al. by more than chance would have it."""
    return "*" if p_value is not None and p_value < SIGNIFICANT else ""


def _cells(table: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Names of the columns, and a line per method; its last column is over all interactions."""
    rows = table["methods"]
    lines = [
        [
            f"{row['title']}, {row['labels']}",
            *map(_interaction, row["interactions"].values()),
            _error(row["macro_mean"], row["macro_std"]),
        ]
        for row in rows
    ]
    return [*map(spoken, rows[0]["interactions"]), "all (± over seeds)"], lines


def _interaction(one: Mapping[str, Any]) -> str:
    """The error of one interaction as the paper prints it, beside its right unit."""
    text = _error(one["mse"], one["mse_std"]) + star(one.get("p_against_buetepage"))
    return f"{text} ({one['paper_mse']:.2f} ± {one['paper_mse_std']:.2f})" if "paper_mse" in one else text


def _error(mean: float | None, spread: float | None) -> str:
    return "-" if mean is None else f"{mean:.4f}" + ("" if spread is None else f" ± {spread:.4f}")


def _caption(table: Mapping[str, Any]) -> str:
    cells = [one for row in table["methods"] for one in row["interactions"].values()]
    notes = [PAPERS_UNIT] if any("paper_mse" in one for one in cells) else []
    notes += [STARS] if any("p_against_buetepage" in one for one in cells) else []
    said = (
        f"{table['dataset']}, protocol {table['protocol']}: mean squared error ± deviation over windows, "
        f"{table['folds']} folds over the training trials, {counted(table['seeds'], 'seed')}, {table['date']}"
    )
    return "; ".join([said, *notes])


def as_markdown(table: Mapping[str, Any]) -> str:
    """A Markdown table; the errors' unit stands in its first cell."""
    columns, lines = _cells(table)
    head = [f"[{UNITS[table['unit']][0]}]", *columns]
    rows = [head, ["---", *["---:"] * len(columns)], *lines]
    return _caption(table) + "\n\n" + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def as_latex(table: Mapping[str, Any]) -> str:
    """A `table` over both columns of a page, in the manner of booktabs."""
    columns, lines = _cells(table)
    body = [" & ".join([f"[{UNITS[table['unit']][1]}]", *map(_escaped, columns)]) + r" \\ \midrule"]
    body += [" & ".join(map(_escaped, line)) + r" \\" for line in lines]
    head = [r"\begin{table*}", r"\centering\small", rf"\caption{{{_escaped(_caption(table))}}}"]
    head += [rf"\begin{{tabular}}{{l{'r' * len(columns)}}}", r"\toprule"]
    return "\n".join([*head, *body, r"\bottomrule", r"\end{tabular}", r"\end{table*}", ""])


def _escaped(text: str) -> str:
    return text.replace("_", r"\_").replace("%", r"\%").replace("&", r"\&").replace("±", PLUS_MINUS)


LAYOUTS: Mapping[str, Callable[[Mapping[str, Any]], str]] = {".tex": as_latex, ".md": as_markdown}
"""By the ending of the file."""

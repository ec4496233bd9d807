# SPDX-License-Identifier: Apache-2.0
"""Figures of errors: of all methods of a cross-validation side by side, and against what was said of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from mild_ros.viewing.style import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    PAGE_IN,
    VERMILION,
    counted,
    figure,
    rule,
    spoken,
)

OURS, BAR = "mild", "kernel_ridge"
BAR_DASHES = (0, (3, 2))
UNITS = {"rad^2": "rad²", "m^2": "m²"}


def draw_comparison(table: Mapping[str, Any], path: Path) -> None:
    """Write the figure of one table.

    Args:
        table: What `mild evaluate --cv` writes as JSON: one protocol, its methods with the best first.
        path: Of the figure.
    """
    rows = list(reversed(table["methods"]))
    names = list(rows[0]["interactions"])
    title = f"{table['dataset']}, protocol {table['protocol']}: {table['folds']} folds, "
    title += counted(table["seeds"], "seed")
    with figure(PAGE_IN, 0.95 + 0.19 * len(rows), path, title) as made:
        panels = made.subplots(1, 1 + len(names), sharey=True, width_ratios=(2.6, *[1.0] * len(names)))
        for axes, name in zip(panels, ("", *names), strict=True):
            for place, row in enumerate(rows):
                colour = BLUE if row["method"] == OURS else GREY
                (_dot if name else _interval)(axes, row, name, place, colour)
            rule(axes, "x")
            axes.set_xlim(0.0, axes.get_xlim()[1] * (1.05 if name else 1.12))
            axes.set_ylim(-0.6, len(rows) - 0.4)
            axes.xaxis.set_major_locator(MaxNLocator(2 if name else 4))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.set_title(spoken(name) or f"mean over interactions [{UNITS[table['unit']]}]")
            axes.tick_params(axis="y", length=0)
            _mark_bar(axes, rows, name)
        panels[0].set_yticks(range(len(rows)), [_name(row) for row in rows])
        made.legend(handles=_legend(), loc="outside lower right", ncols=3)
        for label, row in zip(panels[0].get_yticklabels(), rows, strict=True):
            label.set_fontweight("bold" if row["method"] == OURS else "normal")


def _legend() -> list[Line2D]:
    """What the lines mean."""
    return [
        Line2D([], [], color=GREY, lw=1.0, label="95 % over draws of trials"),
        Line2D([], [], color=GREY, lw=3.5, alpha=0.45, label="± a deviation over seeds"),
        Line2D([], [], color=VERMILION, lw=0.8, ls=BAR_DASHES, label=f"{spoken(BAR)}, given"),
    ]


LABELS = {
    "given": "given",
    "recognised": "recognising",
    "unknown": "not given",
    "given, start pose": "given, start pose",
}
"""What a method knows, by its labels in `cross_validation`."""


def _name(row: Mapping[str, Any]) -> str:
    """Of a row; a title may already say what the method knows."""
    known = f", {LABELS[row['labels']]}"
    return str(row["title"]).removesuffix(known) + known


def _interval(axes: Axes, row: Mapping[str, Any], name: str, place: int, colour: str) -> None:
    """Macro error: 95 % over draws of trials as a thin line, deviation over seeds as a thick one."""
    low, high = row["macro"]["interval"]
    mean, spread = row["macro_mean"], row["macro_std"] or 0.0
    axes.plot([low, high], [place, place], color=colour, lw=1.0)
    axes.plot([mean - spread, mean + spread], [place, place], color=colour, lw=3.5, solid_capstyle="butt", alpha=0.45)
    axes.plot(mean, place, "o", color=colour)
    axes.annotate(f"{mean:.4f}", (high, place), (4, 0), textcoords="offset points", va="center", fontsize=6, color=INK)


def _dot(axes: Axes, row: Mapping[str, Any], name: str, place: int, colour: str) -> None:
    error = row["interactions"][name]["mse"]
    if error is not None:
        axes.plot([0.0, error], [place, place], color=colour, lw=0.6, alpha=0.5)
        axes.plot(error, place, "o", color=colour)


def _mark_bar(axes: Axes, rows: list[Mapping[str, Any]], name: str) -> None:
    """A line at the method that a learned model must not lose to."""
    for row in rows:
        if row["method"] == BAR:
            error = row["interactions"][name]["mse"] if name else row["macro_mean"]
            if error is not None:
                axes.axvline(error, color=VERMILION, lw=0.8, ls=BAR_DASHES, zorder=0)


PANELS_A_ROW = 4


def draw_reliability(found: Mapping[str, Any], path: Path, title: str) -> None:
    """A panel per interaction: regions of all values at once, and of one value at a time.

    Args:
        found: Of one method in `run_time` of what `mild evaluate --cv` writes as JSON.
        path: Of the figure.
        title: Above it.
    """
    curves, levels = found["reliability"], [0.0, *found["levels"]]
    columns = min(PANELS_A_ROW, len(curves))
    rows = -(-len(curves) // columns)
    with figure(PAGE_IN, 0.55 + 2.0 * rows, path, title) as made:
        panels = made.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
        for axes in panels[len(curves) :]:
            axes.set_axis_off()
        for axes, (name, one) in zip(panels, curves.items(), strict=False):
            axes.plot([0, 1], [0, 1], color=GREY, lw=0.8, ls=(0, (3, 2)), label="as it should be")
            axes.vlines(0.9, 0.85, 0.95, color=GREY, lw=4, alpha=0.35)
            for kind, colour, marker, what in (
                ("joint", BLUE, "o", "all values at once"),
                ("marginal", ORANGE, "s", "each value by itself"),
            ):
                axes.plot(levels, [0.0, *one[f"{kind}_unscaled"]], color=colour, lw=0.7, alpha=0.5, ls=(0, (1, 1)))
                axes.plot(levels, [0.0, *one[kind]], color=colour, marker=marker, ms=2.5, label=what)
            axes.set_title(spoken(name))
            axes.set_aspect("equal")
            axes.set_xlim(0, 1)
            axes.set_ylim(0, 1)
            axes.set_xticks([0, 0.5, 0.9])
            axes.set_yticks([0, 0.5, 0.9])
            axes.set_xlabel("share it should hold")
            rule(axes)
        panels[0].plot([], [], color=GREY, lw=0.7, ls=(0, (1, 1)), label="without scale")
        panels[0].set_ylabel("share of true values in region")
        handles, labels = panels[0].get_legend_handles_labels()
        made.legend(handles, labels, loc="outside lower center", ncols=4)

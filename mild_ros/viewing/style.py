# SPDX-License-Identifier: Apache-2.0
"""The style of all figures: column widths of a paper, colours for any colour vision, thin axes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mild_ros.viewing.plots import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION

__all__ = ["BLUE", "COLUMN_IN", "GREEN", "GREY", "INK", "ORANGE", "PAGE_IN", "PURPLE", "SERIES", "SKY", "VERMILION"]

COLUMN_IN, PAGE_IN = 3.5, 7.16
"""Widths [inches] of one column and of two, in the journals of IEEE."""

SERIES = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY)

LOOK: Any = {  # matplotlib lists the keys one by one in its type
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.axisbelow": True,
    "grid.color": "#e6e8eb",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "legend.frameon": False,
    "legend.fontsize": 7.0,
    "text.color": INK,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,
}


@contextmanager
def figure(width_in: float, height_in: float, path: Path, title: str = "") -> Iterator[Figure]:
    """A figure in the common look, written to `path` (.png, .pdf or .svg) when the block ends well."""
    with matplotlib.rc_context(LOOK):
        made = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="white")
        if title:
            made.suptitle(title, x=0.01, ha="left", fontsize=9, fontweight="bold")
        yield made
        path.parent.mkdir(parents=True, exist_ok=True)
        made.savefig(path)


def counted(number: int, noun: str) -> str:
    """One seed, or three seeds."""
    return f"{number} {noun}" + "s" * (number != 1)


def spoken(name: str) -> str:
    """A name of the code as people write it: `hand_wave` is "hand wave"."""
    return name.replace("_", " ")


def rule(axes: Axes, axis: str = "both") -> None:
    """Fine lines to read values by."""
    axes.grid(True, axis=axis)  # type: ignore[arg-type]

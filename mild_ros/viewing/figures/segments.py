# SPDX-License-Identifier: Apache-2.0
"""How a bag was cut into trials, to be checked at a glance: what was looked at, the limits, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mild_core.shapes import FloatArray
from mild_ros.viewing.style import GREY, INK, PAGE_IN, SERIES, VERMILION, figure, rule, spoken

SHOWN_S = 60.0
"""A page's width shows about so much; longer bags get a wider picture."""

WIDEST = 6.0
"""Pages."""


@dataclass(frozen=True)
class ShownMovement:
    """A movement in the picture; times since the bag's first message [s].

    Attributes:
        begin_s: Of the trial.
        onset_s: When the hand leaves its rest.
        back_s: When both rest again.
        end_s: Of the trial.
        interaction: What it shows; "" when unlabelled.
        fault: Why it is left out; "" for a trial.
        number: What people call it; 0 for nothing.
    """

    begin_s: float
    onset_s: float
    back_s: float
    end_s: float
    interaction: str
    fault: str
    number: int


@dataclass(frozen=True)
class Curve:
    """One row of the picture.

    Attributes:
        name: What it is, with its unit.
        values: (T,) or (T, N).
        limit: Below it the hand rests; None for no such limit.
    """

    name: str
    values: FloatArray
    limit: float | None = None


def colours_of(interactions: Sequence[str]) -> Mapping[str, str]:
    """A colour for each interaction, the same in all pictures; from the seventh on they come again."""
    return {name: SERIES[place % len(SERIES)] for place, name in enumerate(interactions)}


def draw_segments(
    times_s: FloatArray,
    curves: Sequence[Curve],
    movements: Sequence[ShownMovement],
    colours: Mapping[str, str],
    path: Path,
    title: str,
) -> None:
    """Write the picture.

    Args:
        times_s: (T,) of the frames.
        curves: From top to bottom.
        movements: In order of time.
        colours: Of the interactions.
        path: Of the picture.
        title: Above it.
    """
    width = PAGE_IN * min(WIDEST, max(1.0, float(times_s[-1] - times_s[0]) / SHOWN_S))
    breaks = np.flatnonzero(np.diff(times_s) > 1.5 * np.median(np.diff(times_s))) + 1
    with figure(width, 1.0 + 1.15 * len(curves), path, title) as made:
        rows = made.subplots(len(curves), 1, sharex=True, squeeze=False)[:, 0]
        for axes, curve in zip(rows, curves, strict=True):
            for movement in movements:
                _shade(axes, movement, colours)
            values = np.insert(curve.values, breaks, np.nan, axis=0)  # no line is drawn across a gap
            axes.plot(np.insert(times_s, breaks, np.nan), values, color=INK, lw=0.8)
            if curve.limit is not None:
                axes.axhline(curve.limit, color=VERMILION, lw=0.8, ls=(0, (4, 2)))
                axes.set_ylim(0.0, max(3.0 * curve.limit, 1.1 * float(np.nanmax(curve.values))))
            axes.set_ylabel(curve.name)
            rule(axes, "y")
        rows[0].margins(x=0.0)
        rows[-1].set_xlabel("time since the bag's first message [s]")
        _name(rows[0], movements)
        made.legend(handles=_legend(movements, colours), loc="outside lower center", ncols=6)


def _shade(axes: Axes, movement: ShownMovement, colours: Mapping[str, str]) -> None:
    """A trial in its colour, its rest paler; what is left out is hatched."""
    if movement.fault:
        axes.axvspan(movement.onset_s, movement.back_s, facecolor="none", edgecolor=GREY, hatch="////", lw=0, alpha=0.6)
        return
    colour = colours[movement.interaction]
    axes.axvspan(movement.begin_s, movement.end_s, color=colour, alpha=0.13, lw=0)
    axes.axvspan(movement.onset_s, movement.back_s, color=colour, alpha=0.28, lw=0)
    for edge in (movement.begin_s, movement.end_s):
        axes.axvline(edge, color=colour, lw=0.7)


def _name(axes: Axes, movements: Sequence[ShownMovement]) -> None:
    """Number and name above each movement; above what is left out, why."""
    for movement in movements:
        words = spoken(movement.fault or movement.interaction)
        axes.annotate(
            f"{movement.number}\n{words}" if movement.number else words,
            (0.5 * (movement.onset_s + movement.back_s), 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=6,
            rotation=0 if movement.number else 90,  # what is left out may be as short as a twitch
            color=GREY if movement.fault else INK,
        )


def _legend(movements: Sequence[ShownMovement], colours: Mapping[str, str]) -> list[Artist]:
    seen = {movement.interaction for movement in movements if not movement.fault}
    found: list[Artist] = [
        Patch(color=colour, alpha=0.4, label=spoken(name)) for name, colour in colours.items() if name in seen
    ]
    if any(movement.fault for movement in movements):
        found.append(Patch(facecolor="none", edgecolor=GREY, hatch="////", lw=0, label="left out"))
    return [*found, Line2D([], [], color=VERMILION, lw=0.8, ls=(0, (4, 2)), label="at rest below both")]

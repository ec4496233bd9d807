# SPDX-License-Identifier: Apache-2.0
"""The person's arm and the other's arm, recorded and predicted, from the side and from above at moments of a trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from mild_core.shapes import FloatArray
from mild_ros.viewing.style import BLUE, GREY, ORANGE, PAGE_IN, figure, rule

SIDE = (0, 2)
VIEWS = {"side\nup [m]": SIDE, "top\nleft [m]": (0, 1)}
"""Which axes are seen: x is from the person towards the other."""


@dataclass(frozen=True, eq=False)
class Moment:
    """One moment, all in one frame.

    Attributes:
        time_s: Since the trial began.
        person: (J, 3) the person's arm [m], from the shoulder outwards.
        recorded: (M, 3) the other's arm [m].
        predicted: (M, 3) the same as the model predicts it.
    """

    time_s: float
    person: FloatArray
    recorded: FloatArray
    predicted: FloatArray


def draw_skeletons(trials: Mapping[str, Sequence[Moment]], path: Path, title: str) -> None:
    """Write the figure: a column per moment; a row per view of one trial, or per trial, from the side.

    Args:
        trials: Moments of each trial, as many of all, by what the row is called.
        path: Of the figure.
        title: Above it.
    """
    views = VIEWS if len(trials) == 1 else dict.fromkeys(trials, SIDE)
    rows = [next(iter(trials.values()))] * len(views) if len(trials) == 1 else list(trials.values())
    points = np.concatenate([np.concatenate([m.person, m.recorded, m.predicted]) for row in rows for m in row])
    low, high = points.min(axis=0) - 0.06, points.max(axis=0) + 0.06
    spans = [high[up] - low[up] for _, up in views.values()]
    width = 0.86 * (PAGE_IN - 0.6) / len(rows[0])  # without ticks and gaps
    height = sum(spans) / (high[0] - low[0]) * width + 1.0 + 0.15 * len(rows)
    with figure(PAGE_IN, float(height), path, title) as made:
        panels = made.subplots(len(rows), len(rows[0]), sharex=True, sharey="row", height_ratios=spans, squeeze=False)
        for row, moments, (view, axes_seen) in zip(panels, rows, views.items(), strict=True):
            for axes, moment in zip(row, moments, strict=True):
                _arms(axes, moment, list(axes_seen))
                axes.set_xlim(low[0], high[0])
                axes.set_ylim(low[axes_seen[1]], high[axes_seen[1]])
                axes.set_aspect("equal")
                rule(axes)
            row[0].set_ylabel(view)
        made.supxlabel("from the person towards the other [m]", x=0.01, ha="left", fontsize=8)
        for axes, moment in zip(panels[0], rows[0], strict=True):
            axes.set_title(f"{moment.time_s:.1f} s")
        handles, labels = panels[0][0].get_legend_handles_labels()
        made.legend(handles, labels, loc="outside lower right", ncols=3)


def _arms(axes: Axes, moment: Moment, seen: list[int]) -> None:
    for arm, colour, width, label in (
        (moment.recorded, GREY, 3.2, "the other, recorded"),
        (moment.predicted, ORANGE, 1.6, "the other, predicted"),
        (moment.person, BLUE, 1.6, "the person"),
    ):
        axes.plot(*arm[:, seen].T, "o-", color=colour, lw=width, ms=2.5, label=label, solid_capstyle="round")

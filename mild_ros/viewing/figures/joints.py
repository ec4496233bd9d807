# SPDX-License-Identifier: Apache-2.0
"""Predicted beside true motion of each joint over a trial, with the region that shall hold nine in ten."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mild_core.shapes import FloatArray
from mild_ros.viewing.style import BLUE, INK, PAGE_IN, SKY, figure, rule, spoken

NINE_IN_TEN = 1.645
"""Deviations to either side of a normal that hold 90 %."""

COLUMNS = (3, 4)
"""Panels beside each other: the first that leaves none empty, or else the last."""


@dataclass(frozen=True, eq=False)
class Motion:
    """What is compared.

    Attributes:
        names: (V,) what each value is.
        true_s: (T,) times of the recorded frames.
        true: (T, V).
        predicted_s: (N,) times that the predictions are for.
        predicted: (N, V).
        deviation: (N, V).
        unit: For people.
    """

    names: tuple[str, ...]
    true_s: FloatArray
    true: FloatArray
    predicted_s: FloatArray
    predicted: FloatArray
    deviation: FloatArray
    unit: str


def draw_joints(motion: Motion, path: Path, title: str) -> None:
    """Write the figure, a panel per value."""
    columns = next((count for count in COLUMNS if len(motion.names) % count == 0), COLUMNS[-1])
    rows = -(-len(motion.names) // columns)
    with figure(PAGE_IN, 0.8 + 1.2 * rows, path, title) as made:
        panels = made.subplots(rows, columns, sharex=True, squeeze=False).ravel()
        for column, (axes, name) in enumerate(zip(panels, motion.names, strict=False)):
            middle, spread = motion.predicted[:, column], NINE_IN_TEN * motion.deviation[:, column]
            region = (middle - spread, middle + spread)
            axes.fill_between(motion.predicted_s, *region, color=SKY, alpha=0.35, lw=0, label="90 % region")
            axes.plot(motion.true_s, motion.true[:, column], color=INK, lw=1.0, label="recorded")
            axes.plot(motion.predicted_s, middle, color=BLUE, label="predicted")
            axes.set_title(spoken(name))
            axes.set_ylim(*_limits(motion.true[:, column], middle))
            axes.set_xlim(float(motion.true_s[0]), float(motion.true_s[-1]))
            rule(axes)
        for axes in panels[len(motion.names) :]:
            axes.set_visible(False)
        for axes in panels[-columns:]:
            axes.set_xlabel("time [s]")
        for axes in panels[::columns]:
            axes.set_ylabel(f"[{motion.unit}]")
        handles, labels = panels[0].get_legend_handles_labels()
        made.legend(handles, labels, loc="outside lower right", ncols=3)


def _limits(*curves: FloatArray) -> tuple[float, float]:
    """Room for the curves; a wide region may leave the panel."""
    low, high = min(float(c.min()) for c in curves), max(float(c.max()) for c in curves)
    room = 0.25 * max(high - low, 1e-6)
    return low - room, high + room

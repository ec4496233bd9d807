# SPDX-License-Identifier: Apache-2.0
"""Reliability curves: how many true values lie within regions of the published covariance that should hold so many."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mild_ros.viewing.style import BLUE, GREY, ORANGE, PAGE_IN, figure, rule, spoken

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

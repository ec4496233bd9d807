# SPDX-License-Identifier: Apache-2.0
"""How the error grows over the window that a model predicts, beside another method's."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mild_core.shapes import FloatArray
from mild_ros.viewing.style import GREY, PAGE_IN, SERIES, figure, rule, spoken

DRAWS = 1000
COLUMNS = 4
LEAST_TRIALS = 5
"""Fewer say nothing of how others would spread."""


def draw_over_window(
    errors: Mapping[str, Mapping[str, FloatArray]],
    times_s: FloatArray,
    unit: tuple[str, float],
    path: Path,
    title: str,
) -> None:
    """Write the figure: root mean squared error at each frame of the window, a panel per interaction.

    Args:
        errors: (trials, W) mean squared error by interaction, by method. A band shows 95 % over draws of trials,
            where there are enough.
        times_s: (W,) time of each frame, relative to the newest that the model has seen.
        unit: Of the plain error, and what radians or metres are multiplied with for it.
        path: Of the figure.
        title: Above it.
    """
    name, scale = unit
    interactions = list(next(iter(errors.values())))
    columns = min(COLUMNS, len(interactions))
    rows = -(-len(interactions) // columns)
    rng = np.random.default_rng(0)
    with figure(PAGE_IN, 0.9 + 1.7 * rows, path, title) as made:
        panels = made.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
        for axes, interaction in zip(panels, interactions, strict=False):
            for colour, (method, found) in zip(SERIES, errors.items(), strict=False):
                squared = found[interaction]
                axes.plot(times_s, np.sqrt(squared.mean(axis=0)) * scale, color=colour, label=method)
                if len(squared) < LEAST_TRIALS:
                    continue
                drawn = squared[rng.integers(len(squared), size=(DRAWS, len(squared)))].mean(axis=1)
                low, high = np.quantile(np.sqrt(drawn), [0.025, 0.975], axis=0) * scale
                axes.fill_between(times_s, low, high, color=colour, alpha=0.13, lw=0)
            if times_s[0] <= 0.0 <= times_s[-1]:
                axes.axvline(0.0, color=GREY, lw=0.7, ls=(0, (3, 2)))
            axes.set_title(f"{spoken(interaction)} ({len(squared)} trials)")
            axes.set_xlim(float(times_s[0]), float(times_s[-1]))
            rule(axes)
        panels[0].set_ylim(bottom=0.0)  # of all: only now is it known how far up they go
        for axes in panels[len(interactions) :]:
            axes.set_visible(False)
        made.supxlabel("time after the newest frame seen [s]", fontsize=8)
        made.supylabel(f"root mean squared error [{name}]", fontsize=8)
        handles, labels = panels[0].get_legend_handles_labels()
        made.legend(handles, labels, ncols=len(errors), loc="outside upper right")

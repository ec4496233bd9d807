# SPDX-License-Identifier: Apache-2.0
"""How the error grows over the window that a model predicts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mild_core.shapes import FloatArray
from mild_ros.viewing.style import COLUMN_IN, GREY, INK, SERIES, figure, rule, spoken

DRAWS = 1000


def draw_over_window(
    errors: Mapping[str, FloatArray], times_s: FloatArray, unit: tuple[str, float], path: Path, title: str
) -> None:
    """Write the figure: root mean squared error at each frame of the window, with 95 % over draws of trials.

    Args:
        errors: (trials, W) mean squared error by interaction.
        times_s: (W,) time of each frame, relative to the newest that the model has seen.
        unit: Of the plain error, and what radians or metres are multiplied with for it.
        path: Of the figure.
        title: Above it.
    """
    name, scale = unit
    rng = np.random.default_rng(0)
    with figure(COLUMN_IN, 2.9, path, title) as made:
        axes = made.subplots()
        for colour, (interaction, squared) in zip(SERIES, errors.items(), strict=False):
            drawn = squared[rng.integers(len(squared), size=(DRAWS, len(squared)))].mean(axis=1)
            low, high = np.quantile(np.sqrt(drawn), [0.025, 0.975], axis=0) * scale
            axes.fill_between(times_s, low, high, color=colour, alpha=0.13, lw=0)
            axes.plot(times_s, np.sqrt(squared.mean(axis=0)) * scale, color=colour, label=spoken(interaction))
        together = np.sqrt(np.mean([squared.mean(axis=0) for squared in errors.values()], axis=0)) * scale
        axes.plot(times_s, together, color=INK, lw=1.8, label="mean over interactions")
        if times_s[0] <= 0.0 <= times_s[-1]:
            axes.axvline(0.0, color=GREY, lw=0.7, ls=(0, (3, 2)))
        axes.set_xlim(float(times_s[0]), float(times_s[-1]))
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("time after the newest frame seen [s]")
        axes.set_ylabel(f"root mean squared error [{name}]")
        rule(axes)
        made.legend(ncols=2, loc="outside lower center")

# SPDX-License-Identifier: Apache-2.0
"""Encounters of the benchmark over time: how far hands are apart, and what the robot took the person to do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mild_ros.viewing.style import BLUE, GREEN, ORANGE

if TYPE_CHECKING:
    from mild_ros.benchmark.jobs import EncounterJob
    from mild_ros.benchmark.summary import Judgement


def draw_encounters(jobs: Sequence[EncounterJob], results: Sequence[Judgement], path: Path) -> None:
    """Play encounters again and draw one panel for each.

    Args:
        jobs: Which.
        results: What came of each.
        path: The picture.
    """
    from matplotlib.figure import Figure

    from mild_ros.benchmark.jobs import play
    from mild_ros.benchmark.run import TICK_S

    figure = Figure(figsize=(8.0, 2.2 * len(jobs)), layout="constrained")
    for axes, job, result in zip(figure.subplots(len(jobs), squeeze=False)[:, 0], jobs, results, strict=True):
        _, trace = play(job)
        times = np.arange(len(trace.modes)) * TICK_S
        axes.plot(
            times, 100 * np.linalg.norm(trace.tool_m - trace.hand_m, axis=1), color=BLUE, label="hands apart [cm]"
        )
        axes.plot(times, 100 * np.linalg.norm(trace.tool_m - trace.tool_m[0], axis=1), color=ORANGE, label="robot away")
        for at_s, what in ((trace.timeline.offered_s, "offered"), (trace.timeline.withdrawn_s, "withdrawn")):
            if math.isfinite(at_s):
                axes.axvline(at_s, color=GREEN, linewidth=1.0)
                axes.text(at_s, axes.get_ylim()[1], what, fontsize=7, va="top")
        words = [name or state for name, state in zip(trace.named, trace.states, strict=True)]
        for tick, word in enumerate(words):
            if word and (tick == 0 or word != words[tick - 1]):
                axes.text(times[tick], 0.0, word, fontsize=6, rotation=60, color="0.3")
        axes.set_title(
            f"{result.causes[0]}: {result.kind.replace('_', ' ')}, seed {result.seed}", fontsize=9, loc="left"
        )
    figure.axes[0].legend(fontsize=7, loc="upper right")
    figure.axes[-1].set_xlabel("time [s]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)

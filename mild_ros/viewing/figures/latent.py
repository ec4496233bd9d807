# SPDX-License-Identifier: Apache-2.0
"""Latent spaces with the fitted components: where trials run and what the prior has made of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Ellipse
from matplotlib.patheffects import withStroke

from mild_core.shapes import FloatArray
from mild_ros.viewing.style import INK, PAGE_IN, VERMILION, figure, spoken

DEVIATIONS = 2.0
"""Size of the ellipses: 86 % of a component's mass in the plane that is shown."""


@dataclass(frozen=True, eq=False)
class LatentSpace:
    """One agent's latents of one interaction.

    Attributes:
        tracks: Each (N, Q): one trial.
        means: (K, Q) of the components, in their order.
        covariances: (K, Q, Q).
    """

    tracks: Sequence[FloatArray]
    means: FloatArray
    covariances: FloatArray


def draw_latent_spaces(agents: Mapping[str, Mapping[str, LatentSpace]], path: Path, title: str) -> None:
    """Write the figure: a row per agent, a column per interaction.

    Args:
        agents: By what the row is called, then by interaction. All panels of a row show the same plane, the one in
            which that agent's latents vary most: by their first two principal directions.
        path: Of the figure.
        title: Above it.
    """
    columns = len(next(iter(agents.values())))
    with figure(PAGE_IN, 0.55 + 0.98 * PAGE_IN / columns * len(agents), path, title) as made:
        panels = made.subplots(len(agents), columns, squeeze=False, sharex="row", sharey="row")
        for axes, interaction in zip(panels[0], next(iter(agents.values())), strict=True):
            axes.set_title(spoken(interaction))
        for row, (agent, spaces) in zip(panels, agents.items(), strict=True):
            origin, plane = _plane([track for space in spaces.values() for track in space.tracks])
            for axes, space in zip(row, spaces.values(), strict=True):
                drawn = _panel(axes, space, origin, plane)
            row[0].set_ylabel(f"{agent}: second direction")
        for axes in panels[-1]:
            axes.set_xlabel("first direction")
        bar = made.colorbar(drawn, ax=panels, aspect=40, pad=0.01)
        bar.set_label("share of the trial")
        bar.outline.set_visible(False)


def _plane(tracks: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """(Q,) mean and (Q, 2) first two principal directions."""
    latents = np.concatenate(tracks)
    origin = latents.mean(axis=0)
    _, vectors = np.linalg.eigh(np.cov((latents - origin).T))
    return origin, vectors[:, : -3 if vectors.shape[1] > 2 else None : -1]


def _panel(axes: Axes, space: LatentSpace, origin: FloatArray, plane: FloatArray) -> LineCollection:
    """Trials as lines coloured by time, components as numbered ellipses."""
    segments, shares = [], []
    for track in space.tracks:
        points = (track - origin) @ plane
        segments.append(np.stack([points[:-1], points[1:]], axis=1))
        shares.append(np.linspace(0.0, 1.0, len(points) - 1))
    lines = LineCollection(list(np.concatenate(segments)), cmap="cividis", lw=0.5, alpha=0.7, rasterized=True)
    lines.set_array(np.concatenate(shares))
    axes.add_collection(lines)
    for number, (mean, covariance) in enumerate(zip(space.means, space.covariances, strict=True), 1):
        values, vectors = np.linalg.eigh(plane.T @ covariance @ plane)
        width, height = 2 * DEVIATIONS * np.sqrt(np.maximum(values, 0.0))
        at = (mean - origin) @ plane
        angle = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
        axes.add_patch(Ellipse((at[0], at[1]), width, height, angle=angle, fill=False, ec=VERMILION, lw=0.9))
        label = axes.annotate(str(number), at, ha="center", va="center", fontsize=6.5, fontweight="bold", color=INK)
        label.set_path_effects([withStroke(linewidth=1.6, foreground="white")])
    axes.autoscale_view()
    axes.set_xticks([])
    axes.set_yticks([])
    return lines

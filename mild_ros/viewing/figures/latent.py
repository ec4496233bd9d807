# SPDX-License-Identifier: Apache-2.0
"""Latent spaces in three dimensions with the fitted components: where trials run, and what the prior makes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from matplotlib import colormaps
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]  # matplotlib types only what is flat
from mpl_toolkits.mplot3d.art3d import Line3DCollection  # type: ignore[import-untyped]

from mild_core.shapes import FloatArray
from mild_ros.viewing.style import INK, PAGE_IN, VERMILION, figure, spoken

DEVIATIONS = 1.5
"""Size of the ellipsoids."""

SHOWN = 3
"""Dimensions that are drawn."""

MERIDIANS = 14


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
        agents: By what the row is called, then by interaction. All panels of a row show the same space, the one in
            which that agent's latents vary most: by their first three principal directions.
        path: Of the figure.
        title: Above it.
    """
    columns = len(next(iter(agents.values())))
    with figure(PAGE_IN, 0.6 + 0.85 * PAGE_IN / columns * len(agents), path, title) as made:
        panels = made.subplots(len(agents), columns, squeeze=False, subplot_kw={"projection": "3d"})
        for axes, interaction in zip(panels[0], next(iter(agents.values())), strict=True):
            axes.set_title(spoken(interaction))
        for row, (agent, spaces) in zip(panels, agents.items(), strict=True):
            origin, directions = _space([track for space in spaces.values() for track in space.tracks])
            shown = [_Shown(space, origin, directions) for space in spaces.values()]
            points = np.concatenate([track for one in shown for track in one.tracks])
            low, high = points.min(axis=0), points.max(axis=0)
            for axes, one in zip(row, shown, strict=True):
                drawn = one.draw(cast(Axes3D, axes))
                axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
            row[0].text2D(-0.06, 0.5, agent, transform=row[0].transAxes, rotation=90, va="center", fontweight="bold")
        bar = made.colorbar(drawn, ax=panels, aspect=40, pad=0.01, shrink=0.8)
        bar.set_label("share of the trial")
        bar.outline.set_visible(False)


def _space(tracks: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """(Q,) mean and (Q, 3) first three principal directions; further ones are zero where Q is smaller."""
    latents = np.concatenate(tracks)
    origin = latents.mean(axis=0)
    _, vectors = np.linalg.eigh(np.atleast_2d(np.cov((latents - origin).T)))
    found = vectors[:, ::-1][:, :SHOWN]
    return origin, np.pad(found, ((0, 0), (0, SHOWN - found.shape[1])))


class _Shown:
    """One panel's space in the three directions."""

    def __init__(self, space: LatentSpace, origin: FloatArray, directions: FloatArray) -> None:
        self.tracks = [(track - origin) @ directions for track in space.tracks]
        self.means = (space.means - origin) @ directions
        self.covariances = directions.T @ space.covariances @ directions

    def draw(self, axes: Axes3D) -> Line3DCollection:
        """Trials as lines coloured by time, components as numbered ellipsoids."""
        segments = [np.stack([track[:-1], track[1:]], axis=1) for track in self.tracks]
        shares = np.concatenate([np.linspace(0.0, 1.0, len(part)) for part in segments])
        lines = Line3DCollection(list(np.concatenate(segments)), cmap="cividis", lw=0.7, alpha=0.8)
        lines.set_array(shares)
        axes.add_collection3d(lines)
        around, up = np.meshgrid(np.linspace(0, 2 * np.pi, MERIDIANS), np.linspace(0, np.pi, MERIDIANS // 2))
        ball = np.stack([np.cos(around) * np.sin(up), np.sin(around) * np.sin(up), np.cos(up)], axis=-1)
        for number, (mean, covariance) in enumerate(zip(self.means, self.covariances, strict=True), 1):
            values, vectors = np.linalg.eigh(covariance)
            surface = mean + DEVIATIONS * ball @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
            axes.plot_wireframe(*np.moveaxis(surface, -1, 0), color=VERMILION, lw=0.25, alpha=0.6)
            axes.text(*mean, str(number), ha="center", va="center", fontsize=6.5, fontweight="bold", color=INK)
        for name in "xyz":
            getattr(axes, f"set_{name}ticks")([])
            getattr(axes, f"{name}axis").pane.set_facecolor(colormaps["Greys"](0.03))
        return lines

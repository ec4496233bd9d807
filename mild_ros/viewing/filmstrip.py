# SPDX-License-Identifier: Apache-2.0
"""Moments of a run side by side: the whole robot and the whole person, face to face."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray
from mild_core.signals import OFFERED, RESTING
from mild_ros.viewing.body import body_parts
from mild_ros.viewing.plots import INK
from mild_ros.viewing.renderer import Viewpoint, open_renderer
from mild_ros.viewing.staging import Staged
from mild_ros.viewing.style import PAGE_IN

MOMENTS = 6
PANEL_WIDTH = 600
"""Pixels of one picture."""

DPI = MOMENTS * PANEL_WIDTH / PAGE_IN
"""The strip is as wide as a page, so that its letters are as large there as they are meant to be."""

TITLE_IN, LINE_IN = 0.24, 0.135
"""Heights of the title and of a line below it [inches]."""

SMALL, GREY = 6.5, "#4a525c"

TURNED_DEG, RAISED_DEG, OPENING_DEG = 194.0, 11.0, 26.0
"""The camera stands at the robot's left: between the two arms that meet."""

MARGIN = 1.1
"""Room around robot and person."""

BEHIND_M, BEYOND_M, SKULL_M = 0.42, 0.3, 0.18
"""What is seen behind the robot's base, behind the middle of the person's head and above it."""


def whole_view(staged: Staged, robot_top_m: float) -> tuple[Viewpoint, tuple[int, int]]:
    """A camera that sees the person from head to foot, and the robot; and the pixels that this takes."""
    heads = np.stack([at["head"] for at in staged.bodies])
    low, high = staged.floor_m, max(float(heads[:, 2].max()) + SKULL_M, robot_top_m)
    near, far = -BEHIND_M, float(heads[:, 0].max()) + BEYOND_M
    panel = (PANEL_WIDTH, round(PANEL_WIDTH * (high - low) / (far - near)))
    distance = 0.5 * MARGIN * (high - low) / np.tan(np.radians(OPENING_DEG / 2)) + 0.3
    target = (0.5 * (near + far), 0.0, 0.5 * (low + high))
    return Viewpoint(target, float(distance), TURNED_DEG, RAISED_DEG, OPENING_DEG), panel


def chosen_moments(staged: Staged, number: int = MOMENTS) -> FloatArray:
    """Times [s] of the phases of an interaction: at rest, on the way, hands at their nearest, and back.

    The hand's way from rest says when something happens; what is nearest to the closest approach is moved onto it.
    """
    hand, times = staged.hand_m, staged.times_s
    away = np.linalg.norm(hand - hand[0], axis=1)
    busy = times[away > 0.25 * away.max()]
    if not busy.size or away.max() < 0.05:
        return np.linspace(times[0], times[-1], number)
    begin, end = busy[0], busy[-1]
    moments = np.array([max(times[0], begin - 1.0), *np.linspace(begin, end, number - 2), min(times[-1], end + 1.8)])
    nearest, _ = staged.nearest()
    if begin < nearest < end:
        moments[1 + int(np.argmin(np.abs(moments[1:-1] - nearest)))] = nearest
    return moments


def draw_filmstrip(staged: Staged, robot: RobotModel, path: Path, title: str) -> None:
    """Write the filmstrip of a run (.png, .pdf or .svg); each time comes with what the model believed and the gap."""
    with open_renderer(robot, staged.floor_m) as renderer:
        view, panel = whole_view(staged, renderer.top_m)
        header, height = TITLE_IN + 3.2 * LINE_IN, panel[1] / DPI
        figure = Figure(figsize=(PAGE_IN, height + header), dpi=DPI, facecolor="white")
        renderer.add_person(body_parts(staged.bodies))

        def write(x: float, below_in: float, text: str, **style: Any) -> None:
            figure.text(x, 1.0 - below_in / (height + header), text, va="top", **style)

        write(0.008, 0.05, title, fontsize=9, fontweight="bold", color=INK)
        for index, moment in enumerate(chosen_moments(staged)):
            frame = staged.frame_at(moment)
            renderer.place(staged.joints_at(moment), staged.bodies[frame])
            axes = figure.add_axes((index / MOMENTS, 0.0, 1.0 / MOMENTS, height / (height + header)))
            axes.imshow(np.asarray(renderer.picture(view, *panel)))
            axes.set_axis_off()
            middle, apart = (index + 0.5) / MOMENTS, f"hands {100 * staged.gap_m[frame]:.0f} cm apart"
            write(middle, TITLE_IN, f"{moment:.1f} s", ha="center", fontsize=8, color=INK)
            for line, said in enumerate((caption(staged, moment), apart), start=1):
                write(middle, TITLE_IN + line * LINE_IN, said, ha="center", fontsize=SMALL, color=GREY)
    figure.savefig(path)


def caption(staged: Staged, moment: float) -> str:
    """What the model believed then."""
    before = [motion for motion in staged.motions if staged.seconds(motion.stamp_ns) <= moment]
    if not before:
        return ""
    newest = before[-1]
    if newest.state in (RESTING, OFFERED):
        return {RESTING: "resting", OFFERED: "a hand is offered"}[newest.state]
    if not newest.interaction or newest.out_of_distribution > 1.0:
        return "unknown motion"
    return f"{newest.interaction.replace('_', ' ')} {100 * newest.probability:.0f} %"

# SPDX-License-Identifier: Apache-2.0
"""Moments of a run side by side: the whole robot and the whole person, face to face."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mild_core.retargeting.robot import RobotModel
from mild_core.shapes import FloatArray
from mild_ros.viewing.body import body_parts
from mild_ros.viewing.renderer import View, open_renderer
from mild_ros.viewing.staging import Staged

MOMENTS = 6
PANEL = (600, 760)
"""Pixels of one picture."""

DPI, HEADER = 200, 0.85
"""Dots per inch; inches above the pictures."""

INK, GREY = "#222831", "#5b6470"

TURNED_DEG, RAISED_DEG, OPENING_DEG = 194.0, 11.0, 26.0
"""The camera stands at the robot's left: between the two arms that meet."""

MARGIN = 1.1
"""Room around robot and person."""


def whole_view(staged: Staged) -> View:
    """A camera that sees the person from head to foot, and the robot."""
    heads = np.stack([at["head"] for at in staged.bodies])
    low, high = staged.floor_m, float(heads[:, 2].max()) + 0.2
    near, far = -0.45, float(heads[:, 0].max()) + 0.3
    wanted = max(high - low, (far - near) * PANEL[1] / PANEL[0])
    distance = 0.5 * MARGIN * wanted / np.tan(np.radians(OPENING_DEG / 2)) + 0.3
    target = (0.5 * (near + far), 0.0, 0.5 * (low + high))
    return View(target, float(distance), TURNED_DEG, RAISED_DEG, OPENING_DEG)


def chosen_moments(staged: Staged, number: int = MOMENTS) -> FloatArray:
    """Times [s] that tell the story: at rest, on the way, hands at their nearest, and back.

    The hand's way from rest says when something happens; what is nearest to the closest approach is moved onto it.
    """
    hand, times = staged.hand_m, staged.times_s
    away = np.linalg.norm(hand - hand[0], axis=1)
    busy = times[away > 0.25 * away.max()]
    if not busy.size or away.max() < 0.05:
        return np.linspace(times[0], times[-1], number)
    begin, end = busy[0], busy[-1]
    moments = np.array([max(times[0], begin - 1.0), *np.linspace(begin, end, number - 2), min(times[-1], end + 1.8)])
    nearest = times[int(np.argmin(staged.gap_m))]
    if begin < nearest < end:
        moments[1 + int(np.argmin(np.abs(moments[1:-1] - nearest)))] = nearest
    return moments


def draw_filmstrip(staged: Staged, robot: RobotModel, path: Path, title: str) -> None:
    """Write the filmstrip of a run as a PNG."""
    view = whole_view(staged)
    width, height = PANEL[0] / DPI, PANEL[1] / DPI
    figure = Figure(figsize=(MOMENTS * width, height + HEADER), dpi=DPI, facecolor="white")
    with open_renderer(robot, staged.floor_m) as renderer:
        renderer.add_person(body_parts(staged.bodies))
        for index, moment in enumerate(chosen_moments(staged)):
            renderer.place(staged.joints_at(moment), staged.bodies[staged.frame_at(moment)])
            axes = figure.add_axes((index / MOMENTS, 0.0, 1.0 / MOMENTS, height / (height + HEADER)))
            axes.imshow(np.asarray(renderer.picture(view, *PANEL)))
            axes.set_axis_off()
            middle = (index + 0.5) / MOMENTS
            figure.text(middle, 1.0 - 0.52 / (height + HEADER), f"{moment:.1f} s", ha="center", fontsize=11, color=INK)
            said = caption(staged, moment)
            figure.text(middle, 1.0 - 0.72 / (height + HEADER), said, ha="center", fontsize=8.5, color=GREY)
    at_top = 1.0 - 0.26 / (height + HEADER)
    figure.text(0.012, at_top, title, fontsize=13, fontweight="bold", color=INK)
    figure.savefig(path)


def caption(staged: Staged, moment: float) -> str:
    """What the model believed then."""
    before = [motion for motion in staged.motions if staged.seconds(motion.stamp_ns) <= moment]
    if not before:
        return ""
    newest = before[-1]
    if not newest.interaction or newest.out_of_distribution > 1.0:
        return "unknown motion"
    return f"{newest.interaction.replace('_', ' ')} {100 * newest.probability:.0f} %"

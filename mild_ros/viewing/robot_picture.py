# SPDX-License-Identifier: Apache-2.0
"""A robot file to look at: the robot at home from two sides, with its base frame, shoulder, elbow and tool."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mild_core.retargeting.contact import shoulder_and_reach_m
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_ros.simulation.backend import SimulatedScene
from mild_ros.viewing.plots import INK
from mild_ros.viewing.renderer import Viewpoint, open_renderer

PANEL = (720, 720)
SIDES = {"from ahead, to its left": (150.0, 14.0), "from its right": (0.0, 8.0)}
"""How the camera is turned and raised [degrees]."""

OPENING_DEG, DPI = 26.0, 160
MARKS = {"shoulder": "#1b7f3b", "elbow": "#b25d00", "tool": "#c0143c"}
AXES = (("x ahead", "#c0143c"), ("y left", "#1b7f3b"), ("z up", "#1f4fc4"))


def draw_robot(robot: RobotModel, path: Path) -> None:
    """Write the picture of a robot at home (.png, .pdf or .svg)."""
    shoulder, elbow = robot.arm_links or ("", "")
    links = {"shoulder": shoulder, "elbow": elbow, "tool": robot.tool_link}
    places = {
        role: forward_kinematics(robot, robot.home_rad, link)[:3, 3] * np.ones(3)
        for role, link in links.items()
        if link
    }
    _, reach_m = shoulder_and_reach_m(robot)
    low = 0.0 if robot.floor_m is None else robot.floor_m
    floor_m = SimulatedScene.floor_m if robot.on_table and robot.floor_m is None else low
    figure = Figure(figsize=(2 * PANEL[0] / DPI, (PANEL[1] + 60) / DPI), dpi=DPI, facecolor="white")
    with open_renderer(robot, floor_m) as renderer:
        high = max(renderer.top_m, *(float(place[2]) for place in places.values()))
        far = max(0.5 * (high - floor_m), 0.6 * reach_m)
        target = (0.3 * reach_m, 0.0, 0.5 * (high + floor_m))
        distance = float(1.35 * far / np.tan(np.radians(OPENING_DEG / 2)) + 0.2)
        length = 0.25 * far
        for column, (title, (turned, raised)) in enumerate(SIDES.items()):
            view = Viewpoint(target, distance, turned, raised, OPENING_DEG)
            axes = figure.add_axes((column / 2, 0.0, 0.5, PANEL[1] / (PANEL[1] + 60)))
            axes.imshow(np.asarray(renderer.picture(view, *PANEL)))
            axes.set_axis_off()
            axes.set_xlim(0, PANEL[0])
            axes.set_ylim(PANEL[1], 0)
            axes.set_title(title, fontsize=7, color=INK, pad=2)
            start = renderer.pixel(view, *PANEL, np.zeros(3))
            for axis, (label, colour) in enumerate(AXES):
                end = renderer.pixel(view, *PANEL, np.eye(3)[axis] * length)
                axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.2})
                axes.text(*end, label, fontsize=5.5, color=colour)
            for role, place in places.items():
                at = renderer.pixel(view, *PANEL, place)
                axes.plot(*at, "o", ms=4, mfc=MARKS[role], mec="white", mew=0.7)
                axes.text(at[0] + 8, at[1] - 6, f"{role}: {links[role]}", fontsize=5.5, color=MARKS[role])
    figure.text(0.008, 0.985, f"{robot.name}: home", va="top", fontsize=8, fontweight="bold", color=INK)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)

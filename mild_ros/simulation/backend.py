# SPDX-License-Identifier: Apache-2.0
"""What a simulation shows and where a robot stands in it, for every physics engine."""

from __future__ import annotations

from dataclasses import dataclass

from mild_core.retargeting.robot_model.robot import RobotModel

Point = tuple[float, float, float]
"""x, y, z in the robot's base frame [m]."""


@dataclass(frozen=True)
class RenderCamera:
    """Where a picture is taken from.

    Attributes:
        eye_m: The camera's place in the robot's base frame.
        target_m: What it looks at.
        field_of_view_deg: Vertical opening angle.
        width: Pixels.
        height: Pixels.
        smoothing: Pictures are drawn this many times larger and averaged, against jagged edges.
        shadow: Whether bodies throw shadows; takes twice the time.
    """

    eye_m: Point = (1.5, -1.6, 0.9)
    target_m: Point = (0.25, 0.0, 0.15)
    field_of_view_deg: float = 38.0
    width: int = 640
    height: int = 480
    smoothing: int = 2
    shadow: bool = False


@dataclass(frozen=True)
class SimulatedScene:
    """What stands around the robot.

    Attributes:
        table: Whether the robot stands on a table.
        floor_m: Height of the floor in the robot's base frame; the table's legs end there.
    """

    table: bool = True
    floor_m: float = -0.85


def scene_of(robot: RobotModel) -> SimulatedScene:
    """A table for a robot that needs one, and the floor."""
    floor_m = SimulatedScene.floor_m if robot.floor_m is None else robot.floor_m
    return SimulatedScene(table=robot.on_table, floor_m=floor_m)

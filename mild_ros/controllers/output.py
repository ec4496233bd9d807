# SPDX-License-Identifier: Apache-2.0
"""What every kind of message for a controller has in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.trajectory_stream import Trajectory
from mild_core.signals import JointCommand


@dataclass(frozen=True)
class Outgoing:
    """A command on its way to a controller, with the robot's names of its joints.

    Attributes:
        command: What to do now.
        robot: Whose limits these are, in the order of the command.
        position_order: Names of joints as a controller of bare numbers has them.
        previous: The command in the message before; None in the first.
        trajectory: For an output with `plays_trajectories`: what has been promised, and a stop.
    """

    command: JointCommand
    robot: RobotModel
    position_order: tuple[str, ...]
    previous: JointCommand | None = None
    trajectory: Trajectory | None = None


@dataclass(frozen=True)
class ControllerOutput:
    """A kind of message for a controller.

    Attributes:
        topic: Where it is published.
        type_name: Of its messages; the package may be absent.
        controller: Who takes it, for the documents.
        meaning: What is in it, for the documents.
        message: Fills one, given its class.
        period_s: No two within this time; 0 sends one with every command.
        plays_trajectories: Whether its controller splices each message onto what it plays. Commands are then made
            ahead of time: see `mild_core.retargeting.trajectory_stream`, which also decides when messages are due.
    """

    topic: str
    type_name: str
    controller: str
    meaning: str
    message: Callable[[Any, Outgoing], Any]
    period_s: float = 0.0
    plays_trajectories: bool = False

# SPDX-License-Identifier: Apache-2.0
"""The judge of commands: inside every limit, finite, and without a jump even where time itself jumps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mild_core.retargeting.limit_check import exceeded_limits
from mild_core.retargeting.robot_model.robot import RobotModel

LONGEST_GAP_NS = 300_000_000
"""After a longer silence the robot has come to rest, and commands start again from there (`max_gap_s`)."""

STEP_S = 0.05
"""Where commands start again, one or two of the newest before may have been overtaken on their way."""

MOVING_RAD_S = 1e-6
"""Slower than this is rest: an encoder needs an hour to see it."""


class Command(NamedTuple):
    """One command as it was heard: its stamp, positions [rad] and velocities [rad/s] of J joints."""

    stamp_ns: int
    positions_rad: tuple[float, ...]
    velocities_rad_s: tuple[float, ...]

    @property
    def moves(self) -> bool:
        """Whether a joint is to move."""
        return max(map(abs, self.velocities_rad_s)) > MOVING_RAD_S


def problems(robot: RobotModel, commands: Sequence[Command]) -> list[str]:
    """What is wrong with commands, in the order in which they came; empty when nothing is."""
    found = []
    for run in _runs(commands):
        stamps_ns = np.array([command.stamp_ns for command in run])
        positions = np.array([command.positions_rad for command in run])
        velocities = np.array([command.velocities_rad_s for command in run])
        if positions.shape != (len(run), len(robot.joint_names)) or velocities.shape != positions.shape:
            found.append("a command does not have one position and one velocity for each joint")
            continue
        found += exceeded_limits(robot, stamps_ns, positions, velocities)
    for before, after in pairwise(commands):
        if _restarts(before, after):
            found += _jump(robot, before, after)
    return found


def _restarts(before: Command, after: Command) -> bool:
    """Whether time went back between two commands, or so much of it has passed that the robot rests."""
    return not 0 <= after.stamp_ns - before.stamp_ns <= LONGEST_GAP_NS


def _runs(commands: Sequence[Command]) -> Iterator[list[Command]]:
    """Commands that follow each other without a break."""
    run: list[Command] = []
    for command in commands:
        if run and _restarts(run[-1], command):
            yield run
            run = []
        run.append(command)
    if run:
        yield run


def _jump(robot: RobotModel, before: Command, after: Command) -> list[str]:
    """What is wrong with a new beginning: it is where the robot was; after a silence it begins from rest."""
    moved = np.abs(np.subtract(after.positions_rad, before.positions_rad))
    found = ["a command jumps"] if (moved > robot.velocity_rad_s * STEP_S).any() else []
    faster = np.abs(np.subtract(after.velocities_rad_s, before.velocities_rad_s))
    if after.stamp_ns > before.stamp_ns:
        return [*found, "after a silence a command begins at speed"] if after.moves else found
    return [*found, "a speed jumps"] if (faster > robot.acceleration_rad_s2 * STEP_S).any() else found

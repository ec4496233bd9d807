# SPDX-License-Identifier: Apache-2.0
"""Whether commands stay inside every limit, seen from outside: from their stamps, positions and velocities alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mild_core.retargeting.robot import RobotModel
from mild_core.shapes import FloatArray
from mild_core.signals import JointCommand

ROUNDING_RAD = 1e-14
"""Of a position of a few radians after some thousand steps of float arithmetic; one step's is 4e-16."""

VELOCITY_ROUNDING_RAD_S = 1e-9
"""The planner reaches its limits up to this."""


def derivatives(times_s: FloatArray, positions_rad: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Divided differences times order!, (N - order, J), and how much rounding each (N - order, 1) may hold.

    Where a curve has `order` derivatives these are averages of the last one over the times they span, so a bound
    on the derivative bounds them exactly, whatever the spacing: no tolerance is needed but for rounding.

    Source: mean value theorem for divided differences.
    """
    table, noise = positions_rad, np.full((len(times_s), 1), ROUNDING_RAD)
    for degree in range(1, order + 1):
        spans = (times_s[degree:] - times_s[:-degree])[:, None]
        table = (table[1:] - table[:-1]) / spans
        noise = (noise[1:] + noise[:-1]) / spans
    factorial = float(np.prod(np.arange(1, order + 1)))
    return table * factorial, noise * factorial


def check_limits(robot: RobotModel, commands: Sequence[JointCommand]) -> None:
    """Assert that one unbroken run of commands keeps the position, velocity, acceleration and jerk limits."""
    stamps_ns = np.array([command.stamp_ns for command in commands])
    times_s = (stamps_ns - stamps_ns[0]) * 1e-9
    positions = np.array([command.positions_rad for command in commands])
    velocities = np.array([command.velocities_rad_s for command in commands])
    assert np.isfinite(positions).all()
    assert np.isfinite(velocities).all()
    assert (np.diff(stamps_ns) > 0).all()
    assert (positions >= robot.lower_rad - ROUNDING_RAD).all()
    assert (positions <= robot.upper_rad + ROUNDING_RAD).all()
    assert (np.abs(velocities) <= robot.velocity_rad_s + VELOCITY_ROUNDING_RAD_S).all()
    bounds = (robot.velocity_rad_s, robot.acceleration_rad_s2, robot.jerk_rad_s3)
    for order, bound in enumerate(bounds, start=1):
        if len(commands) > order:
            found, noise = derivatives(times_s, positions, order)
            excess = np.abs(found) - bound * (1 + 1e-9) - noise
            assert excess.max() <= 0, f"derivative {order} breaks its limit by {excess.max()}"
    if len(commands) > 1:
        # The velocities are those of the positions: over a step they differ by what the acceleration limit allows.
        steps_s = np.diff(times_s)[:, None]
        apart = np.abs(positions[1:] - positions[:-1] - velocities[:-1] * steps_s)
        assert (apart <= robot.acceleration_rad_s2 * steps_s**2 / 2 + 10 * ROUNDING_RAD).all()
        changes = np.abs(np.diff(velocities, axis=0))
        assert (changes <= robot.acceleration_rad_s2 * steps_s + VELOCITY_ROUNDING_RAD_S).all()

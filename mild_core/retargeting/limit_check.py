# SPDX-License-Identifier: Apache-2.0
"""Whether commands stay inside every limit, seen from outside: from their stamps, positions and velocities alone."""

from __future__ import annotations

import math

import numpy as np

from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray

ROUNDING_RAD = 1e-14
"""Of a position of a few radians after some thousand steps of float arithmetic; one step's is 4e-16."""

VELOCITY_ROUNDING_RAD_S = 1e-9
"""The planner reaches its limits up to this."""

DERIVATIVES = ("velocity", "acceleration", "jerk")


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
    return table * math.factorial(order), noise * math.factorial(order)


def exceeded_limits(
    robot: RobotModel, stamps_ns: FloatArray, positions_rad: FloatArray, velocities_rad_s: FloatArray
) -> tuple[str, ...]:
    """What one unbroken run of commands breaks of the limits of position, velocity, acceleration and jerk.

    Args:
        robot: Whose limits.
        stamps_ns: (N,) integers; commands in between may be missing.
        positions_rad: (N, J).
        velocities_rad_s: (N, J) as the commands say them.

    Returns:
        One line for each that is broken; empty when all are kept.
    """
    if not (np.isfinite(positions_rad).all() and np.isfinite(velocities_rad_s).all()):
        return ("a command is not finite",)
    if not (np.diff(stamps_ns) > 0).all():
        return ("a command's stamp is not later than the one before",)
    outside = np.maximum(robot.lower_rad - positions_rad, positions_rad - robot.upper_rad).max()
    found = [("position", outside - ROUNDING_RAD)]
    said = np.abs(velocities_rad_s)
    found.append(("velocity as said", (said - robot.velocity_rad_s).max() - VELOCITY_ROUNDING_RAD_S))
    times_s = (stamps_ns - stamps_ns[0]) * 1e-9
    bounds = (robot.velocity_rad_s, robot.acceleration_rad_s2, robot.jerk_rad_s3)
    for order, (name, bound) in enumerate(zip(DERIVATIVES, bounds, strict=True), start=1):
        if len(stamps_ns) > order:
            value, noise = derivatives(times_s, positions_rad, order)
            found.append((name, (np.abs(value) - bound * (1 + 1e-9) - noise).max()))
    if len(stamps_ns) > 1:
        # The velocities are those of the positions: over a step they differ by what the acceleration limit allows.
        steps_s = np.diff(times_s)[:, None]
        most = robot.acceleration_rad_s2 * steps_s
        apart = np.abs(np.diff(positions_rad, axis=0) - velocities_rad_s[:-1] * steps_s)
        found.append(("position after velocity", (apart - most * steps_s / 2 - 10 * ROUNDING_RAD).max()))
        changes = np.abs(np.diff(velocities_rad_s, axis=0))
        found.append(("acceleration as said", (changes - most - VELOCITY_ROUNDING_RAD_S).max()))
    return tuple(f"the limit of {name} is broken by {excess:.3g}" for name, excess in found if excess > 0.0)

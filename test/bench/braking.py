# SPDX-License-Identifier: Apache-2.0
"""Whether a joint brakes at its limits, seen from outside: by the velocities of its commands alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FULL = 0.9
"""A joint that brakes with this share of its limits brakes with all: velocities are averages over a step."""

AT_REST_RAD_S = 1e-6

SHARE = 0.1
"""A joint that brings a point nearer by less than this share of all joints' does not matter to it."""


def braking_joints(
    times_s: NDArray[np.float64],
    velocities_rad_s: NDArray[np.float64],
    acceleration_rad_s2: NDArray[np.float64],
    jerk_rad_s3: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """(N, J) whether each joint rests or brakes at its limits at each of N commands.

    The fastest stop builds the greatest deceleration up with the greatest jerk, keeps it, and lets it go with the
    greatest jerk. Steps in which it goes from one to the next show a part of each: a command counts by its own step,
    the one before and the one after.

    Args:
        times_s: (N,) of the commands.
        velocities_rad_s: (N, J) at them.
        acceleration_rad_s2: (J,) limits.
        jerk_rad_s3: (J,) limits.
    """
    hard = np.zeros(velocities_rad_s.shape, dtype=bool)
    if len(times_s) < 3:
        return hard
    steps = np.maximum(np.diff(times_s), 1e-6)[:, None]
    way = np.sign(velocities_rad_s)
    acceleration = np.diff(velocities_rad_s, axis=0) / steps
    jerk = np.zeros_like(acceleration)
    jerk[1:] = np.diff(acceleration, axis=0) / (0.5 * (steps[1:] + steps[:-1]))
    slowing, jerking = -way[:-1] * acceleration / acceleration_rad_s2, -way[:-1] * jerk / jerk_rad_s3
    own = (slowing > FULL) | (jerking > FULL) | ((slowing > 0.0) & (jerking < -FULL))
    hard[1:] |= own
    hard[2:] |= own[:-1]
    hard[:-1] |= own
    return hard | (np.abs(velocities_rad_s) < AT_REST_RAD_S)

# SPDX-License-Identifier: Apache-2.0
"""What a guard has to see of a robot's poses, compiled in one: how far it is from itself and the person, how fast."""

from __future__ import annotations

import numpy as np

from mild_core.compiled import compiled
from mild_core.retargeting.chain import frames_of, least_clearance, place_capsules, tool_jacobian
from mild_core.shapes import FloatArray

LOOK_M, LOOK_SELF_M = 0.6, 0.06
"""Distances to the person and to itself beyond these count as these: the nearer, the faster it is looked."""


@compiled
def look(
    positions_rad: FloatArray,
    velocities_rad_s: FloatArray,
    columns: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    tool_m: FloatArray,
    mounted: FloatArray,
    ends_m: FloatArray,
    sizes_m: FloatArray,
    pairs: FloatArray,
    meetings: FloatArray,
    body_m: FloatArray,
    body_sizes_m: FloatArray,
    hand_m: FloatArray,
    keep_m: FloatArray,
) -> FloatArray:
    """(S, 4) what is seen at poses (S, J) that move at (S, J): see `SELF` and the others.

    Comparisons with NaN are false, so that who is not seen is nowhere near.
    """
    found = np.empty((len(positions_rad), 4))
    placed, jacobian = np.empty((len(mounted), 3, 3)), np.zeros((3, positions_rad.shape[1]))
    for row in range(len(positions_rad)):
        frames = frames_of(positions_rad[row], columns, offsets, axes)
        place_capsules(frames, mounted, ends_m, placed)
        found[row, 0] = least_clearance(placed, sizes_m, placed, sizes_m, pairs, LOOK_SELF_M) - keep_m[0]
        person = least_clearance(placed, sizes_m, body_m, body_sizes_m, meetings, LOOK_M)
        found[row, 1] = person - keep_m[1]
        last, apart = frames[-1], 0.0
        for i in range(3):
            tool = last[i, 0] * tool_m[0] + last[i, 1] * tool_m[1] + last[i, 2] * tool_m[2] + last[i, 3]
            apart += (tool - hand_m[i]) ** 2
        found[row, 2] = np.fmin(np.sqrt(apart), person if person < LOOK_M else np.inf)  # which passes over NaN
        tool_jacobian(frames, columns, axes, tool_m, jacobian)
        speed = 0.0
        for i in range(3):
            part = 0.0
            for joint in range(positions_rad.shape[1]):
                part += jacobian[i, joint] * velocities_rad_s[row, joint]
            speed += part * part
        found[row, 3] = np.sqrt(speed)
    return found

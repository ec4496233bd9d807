# SPDX-License-Identifier: Apache-2.0
"""What a robot's own report may come to: pure functions of what it would say.

A fault takes what the robot says, what it said when the fault began, and the time since then [s], and gives what
is heard instead; None for nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mild_core.signals import JointMeasurement

RobotFault = Callable[[JointMeasurement, JointMeasurement, float], JointMeasurement | None]

BY_HAND_RAD, BY_HAND_S = 0.8, 0.3
"""How far somebody pushes the first joint, and how long that takes."""


def truthful(measured: JointMeasurement, _first: JointMeasurement, _: float) -> JointMeasurement | None:
    """No fault."""
    return measured


def mute(_measured: JointMeasurement, _first: JointMeasurement, _: float) -> JointMeasurement | None:
    """Nothing is said."""
    return None


def not_a_number(measured: JointMeasurement, _first: JointMeasurement, _: float) -> JointMeasurement | None:
    """All joints are NaN."""
    return replace(measured, positions_rad=np.full(len(measured.joint_names), np.nan))


def by_hand(measured: JointMeasurement, first: JointMeasurement, since_s: float) -> JointMeasurement | None:
    """Somebody takes the arm, pushes it aside and holds it there, whatever is commanded."""
    pushed = np.array(first.positions_rad)
    pushed[0] += BY_HAND_RAD * min(since_s / BY_HAND_S, 1.0)
    return replace(measured, positions_rad=pushed)

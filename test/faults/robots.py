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

VOICES_RAD, VOICES_HZ = 1.2, 50.0
"""How far apart two publishers place the first joint, and how often they take turns."""

BY_HAND_RAD, BY_HAND_S = 0.8, 0.3
"""How far a person pushes the first joint [rad], and how long that takes [s]."""


def truthful(measured: JointMeasurement, _first: JointMeasurement, _: float) -> JointMeasurement | None:
    """No fault."""
    return measured


def mute(_measured: JointMeasurement, _first: JointMeasurement, _: float) -> JointMeasurement | None:
    """Nothing is said."""
    return None


def not_a_number(measured: JointMeasurement, _first: JointMeasurement, _: float) -> JointMeasurement | None:
    """All joints are NaN."""
    return replace(measured, positions_rad=np.full(len(measured.joint_names), np.nan))


def gripper_not_a_number(measured: JointMeasurement, _first: JointMeasurement, _: float) -> JointMeasurement | None:
    """A joint that is not ours is NaN, beside all of ours."""
    names, positions = (*measured.joint_names, "gripper"), np.append(measured.positions_rad, np.nan)
    return JointMeasurement(measured.stamp_ns, names, positions)


def two_voices(measured: JointMeasurement, first: JointMeasurement, since_s: float) -> JointMeasurement | None:
    """Every other message says that the first joint is elsewhere, as a second publisher would."""
    if round(since_s * VOICES_HZ) % 2 == 0:
        return measured
    elsewhere = np.array(measured.positions_rad)
    elsewhere[0] = first.positions_rad[0] - VOICES_RAD
    return replace(measured, positions_rad=elsewhere)


def by_hand(measured: JointMeasurement, first: JointMeasurement, since_s: float) -> JointMeasurement | None:
    """A person pushes the arm aside and holds it there against every command."""
    pushed = np.array(first.positions_rad)
    pushed[0] -= BY_HAND_RAD * min(since_s / BY_HAND_S, 1.0)  # away from the person, so that nothing holds it back
    return replace(measured, positions_rad=pushed)

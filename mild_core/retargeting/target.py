# SPDX-License-Identifier: Apache-2.0
"""Where the controlled joints shall be at a time: a checked motion window, interpolated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mild_core.errors import DataError
from mild_core.retargeting.limiter import Joints
from mild_core.retargeting.robot import RobotModel
from mild_core.shapes import FloatArray
from mild_core.signals import ARM_JOINTS, MotionWindow


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion window that the robot may follow.

    Attributes:
        stamp_ns: Of the motion window.
        received_ns: When it came.
        start_ns: Time of row 0.
        period_ns: Time between rows.
        rows: (W, J) positions in the robot's joint order [rad], or (W, 3, 3) a partner's shoulder, elbow and hand [m].
        interaction: What it is about.
        covariance: Of the window's joint angles [rad^2], or of the partner's joints [m^2].
    """

    stamp_ns: int
    received_ns: int
    start_ns: int
    period_ns: int
    rows: FloatArray
    interaction: str
    covariance: FloatArray

    def at(self, time_ns: int) -> FloatArray:
        """(J,) or (3, 3) at `time_ns`, linear between rows; before the first or after the last row that row."""
        last = len(self.rows) - 1
        row, rest_ns = divmod(time_ns - self.start_ns, self.period_ns)
        if row < 0 or row >= last:
            end: FloatArray = self.rows[0 if row < 0 else last]
            return end
        before, after = self.rows[row], self.rows[row + 1]
        between: FloatArray = before + (after - before) * (rest_ns / self.period_ns)
        return between


def checked_plan(motion: MotionWindow, robot: RobotModel, now_ns: int) -> Plan:
    """The plan that `motion` makes for the robot.

    Args:
        motion: From inference or from another machine: nothing in it is trusted. It may give joints in any order.
        robot: Who shall follow.
        now_ns: When it came.

    Raises:
        DataError: `wrong_joints`, `wrong_shape` or `not_finite`.
    """
    names, is_arm = motion.joint_names, motion.positions.ndim == 3
    fits = names == ARM_JOINTS and robot.follows_arms if is_arm else sorted(names) == sorted(robot.joint_names)
    if not fits:
        raise DataError("wrong_joints", f"got {names}, expected {ARM_JOINTS if is_arm else robot.joint_names}")
    if len(motion.positions) == 0 or motion.period_ns <= 0:
        raise DataError("wrong_shape", f"positions {motion.positions.shape} every {motion.period_ns} ns")
    if not (np.isfinite(motion.positions).all() and np.isfinite(motion.out_of_distribution)):
        raise DataError("not_finite", "a position or the out-of-distribution score is NaN or infinite")
    rows = motion.positions
    if not is_arm and names != robot.joint_names:
        rows = rows[:, [names.index(name) for name in robot.joint_names]]
    start_ns = motion.stamp_ns + motion.lead_ns
    return Plan(motion.stamp_ns, now_ns, start_ns, motion.period_ns, rows, motion.interaction, motion.covariance)


@dataclass(frozen=True)
class Ramp:
    """A smooth way from where the robot stands onto a plan that begins elsewhere.

    Attributes:
        start_ns: When it began.
        duration_s: How long it lasts; 0 for none.
        from_rad: J positions at its start.
    """

    start_ns: int
    duration_s: float
    from_rad: Joints

    def blend(self, target_rad: FloatArray, now_ns: int) -> FloatArray:
        """(J,) between the start of the ramp and `target_rad`, along a minimum-jerk curve.

        Source: T. Flash, N. Hogan, "The coordination of arm movements", J. Neuroscience 1985, eq. 3.
        """
        elapsed_s = (now_ns - self.start_ns) * 1e-9
        if elapsed_s >= self.duration_s:
            return target_rad
        s = elapsed_s / self.duration_s
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        start = np.array(self.from_rad)
        blended: FloatArray = start + (target_rad - start) * share
        return blended


MINIMUM_JERK_PEAK = 1.875
"""Peak over mean speed of a minimum-jerk curve; source: Flash and Hogan 1985."""


def ramp_onto(target_rad: FloatArray, from_rad: Joints, peak_rad_s: float, now_ns: int) -> Ramp:
    """The ramp from `from_rad` onto a target that is now at `target_rad` (J,), at most `peak_rad_s` fast."""
    distance = float(np.abs(target_rad - np.array(from_rad)).max())
    return Ramp(now_ns, MINIMUM_JERK_PEAK * distance / peak_rad_s, from_rad)

# SPDX-License-Identifier: Apache-2.0
"""Where the controlled joints shall be at a time: a checked motion window, interpolated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mild_core.errors import DataError
from mild_core.retargeting.limiter import Joints
from mild_core.shapes import FloatArray
from mild_core.signals import MotionWindow


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion window that the robot may follow.

    Attributes:
        stamp_ns: Of the motion window.
        received_ns: When it came.
        start_ns: Time of row 0.
        period_ns: Time between rows.
        rows_rad: (W, J) in the robot's joint order.
    """

    stamp_ns: int
    received_ns: int
    start_ns: int
    period_ns: int
    rows_rad: FloatArray

    def at(self, time_ns: int) -> FloatArray:
        """(J,) positions [rad] at `time_ns`, linear between rows; before the first or after the last row that row."""
        last = len(self.rows_rad) - 1
        row, rest_ns = divmod(time_ns - self.start_ns, self.period_ns)
        if row < 0 or row >= last:
            end: FloatArray = self.rows_rad[0 if row < 0 else last]
            return end
        before, after = self.rows_rad[row], self.rows_rad[row + 1]
        between: FloatArray = before + (after - before) * (rest_ns / self.period_ns)
        return between


def checked_plan(motion: MotionWindow, joint_names: tuple[str, ...], now_ns: int) -> Plan:
    """The plan that `motion` makes for the robot's joints.

    Args:
        motion: From inference or from another machine: nothing in it is trusted.
        joint_names: J names in the robot's order; the window may give them in another.
        now_ns: When it came.

    Raises:
        DataError: `wrong_joints`, `wrong_shape` or `not_finite`.
    """
    if sorted(motion.joint_names) != sorted(joint_names):
        raise DataError("wrong_joints", f"got {motion.joint_names}, expected {joint_names}")
    if motion.positions.ndim != 2 or len(motion.positions) == 0 or motion.period_ns <= 0:
        raise DataError("wrong_shape", f"positions {motion.positions.shape} every {motion.period_ns} ns")
    if not (np.isfinite(motion.positions).all() and np.isfinite(motion.out_of_distribution)):
        raise DataError("not_finite", "a position or the out-of-distribution score is NaN or infinite")
    rows = motion.positions
    if motion.joint_names != joint_names:
        rows = rows[:, [motion.joint_names.index(name) for name in joint_names]]
    return Plan(motion.stamp_ns, now_ns, motion.stamp_ns + motion.lead_ns, motion.period_ns, rows)


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

# SPDX-License-Identifier: Apache-2.0
"""Where the controlled joints shall be at a time: a checked motion window, interpolated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mild_core.errors import DataError
from mild_core.retargeting.limiter import Joints
from mild_core.retargeting.robot_model.robot import RobotModel
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
        interaction: What it is about; "" for an offered hand that has no name yet.
        gentle: Whether it is carried out slowly.
        covariance: Of the window's joint angles [rad^2], or of the partner's joints [m^2].
    """

    stamp_ns: int
    received_ns: int
    start_ns: int
    period_ns: int
    rows: FloatArray
    interaction: str
    covariance: FloatArray
    gentle: bool = False

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
    numbers = (motion.positions, motion.covariance, motion.out_of_distribution)
    if not all(np.isfinite(each).all() for each in numbers):
        raise DataError("not_finite", "a position, covariance or out-of-distribution score is NaN or infinite")
    rows = motion.positions
    if not is_arm and names != robot.joint_names:
        rows = rows[:, [names.index(name) for name in robot.joint_names]]
    start_ns = motion.stamp_ns + motion.lead_ns
    gentle = not motion.interaction or not motion.may_start
    return Plan(
        motion.stamp_ns, now_ns, start_ns, motion.period_ns, rows, motion.interaction, motion.covariance, gentle
    )


SETTLING_S, HURRIED_S = 0.15, 0.03
"""The rest of a way onto a plan fades with these time constants: by itself, and with hands that are to meet."""

LEAST_RAD_S = 0.02
"""It ends with this speed, and so at some time."""

STARTING_S = 0.2
"""A way onto a plan comes up to its speed in this time."""

HURRY = 3.0
"""With hands that are to meet a way onto a plan may be so much faster: there the hand's own limit of speed holds."""


@dataclass(frozen=True)
class RampIn:
    """A smooth way onto a plan from where the robot stands, or to where it was held back.

    Attributes:
        target_rad: J positions to which the joints were sent last.
        behind_rad: J: from the plan to there.
        speed_rad_s: Of the joint that has the longest way.
    """

    target_rad: Joints
    behind_rad: Joints
    speed_rad_s: float = 0.0

    @staticmethod
    def onto(aimed_rad: FloatArray, from_rad: Joints) -> RampIn:
        """The beginning of the way from `from_rad` onto a plan that is now at `aimed_rad` (J,)."""
        return RampIn(from_rad, tuple((np.array(from_rad) - aimed_rad).tolist()))

    def nearer(
        self, aimed_rad: FloatArray, peak_rad_s: float, hurry: float, elapsed_s: float
    ) -> tuple[RampIn, FloatArray]:
        """With its next speed, and the next target (J,): the plan, less what is left to catch up with.

        Args:
            aimed_rad: (J,) where the plan is now.
            peak_rad_s: What catching up may add to the speed of the plan ...
            hurry: ... and from 0 to 1 how much more, since hands are to meet.
            elapsed_s: Since the target before.
        """
        behind = np.array(self.behind_rad)
        far = float(np.abs(behind).max())
        most = peak_rad_s * (1.0 + HURRY * hurry)
        fading = max(far / (SETTLING_S + (HURRIED_S - SETTLING_S) * hurry), LEAST_RAD_S)
        speed = min(most, fading, self.speed_rad_s + most * elapsed_s / STARTING_S)
        left = max(0.0, 1.0 - speed * elapsed_s / far) if far > 0.0 else 0.0
        return replace(self, speed_rad_s=speed), aimed_rad + left * behind

    def at(self, target_rad: FloatArray, aimed_rad: FloatArray) -> RampIn:
        """With the target that was taken."""
        return replace(self, target_rad=tuple(target_rad.tolist()), behind_rad=tuple((target_rad - aimed_rad).tolist()))

    def held(self, at_rad: Joints, free: Sequence[bool]) -> RampIn:
        """Of an arm whose joints were held back at `at_rad`, but for the free ones: those set off from there again."""
        each = zip(free, self.target_rad, self.behind_rad, at_rad, strict=True)
        kept = [(to, behind) if goes else (at, at - to + behind) for goes, to, behind, at in each]
        return replace(self, target_rad=tuple(to for to, _ in kept), behind_rad=tuple(behind for _, behind in kept))

# SPDX-License-Identifier: Apache-2.0
"""Motion inside velocity, acceleration and jerk limits, time-optimal, for any time step.

Each call plans from the current position, velocity and acceleration and samples the plan once, so that nothing
but these three numbers per joint is carried from step to step. Position limits are kept by the caller, who gives the
target: every plan ends at rest in its target, so a plan that starts on another such plan stays between them.

Source: L. Berscheid, T. Kroeger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target States",
RSS 2021 (ruckig, community version).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from ruckig import (  # type: ignore[import-not-found]
    ControlInterface,
    InputParameter,
    Result,
    Ruckig,
    RuckigError,
    Synchronization,
    Trajectory,
)

from mild_core.errors import MildError
from mild_core.shapes import FloatArray

Joints = tuple[float, ...]
"""One number per joint."""

ROUNDING = 1e-9
"""Below this an angle [rad], a speed or an acceleration is what rounding left over: no encoder sees it."""


class NoPlanError(MildError):
    """The planner found no way from a motion to its target."""


@dataclass(frozen=True)
class JointMotion:
    """Where J joints are and how they move: all that a plan needs to go on without a jump.

    Attributes:
        position_rad: J values.
        velocity_rad_s: J values.
        acceleration_rad_s2: J values.
    """

    position_rad: Joints
    velocity_rad_s: Joints
    acceleration_rad_s2: Joints

    @staticmethod
    def at_rest(position_rad: Joints) -> JointMotion:
        """Standing at `position_rad`."""
        zero = (0.0,) * len(position_rad)
        return JointMotion(position_rad, zero, zero)

    def toward(self, other: JointMotion, share: float) -> JointMotion:
        """A share of the way from this to another motion at the same time."""
        pairs = (
            (self.position_rad, other.position_rad),
            (self.velocity_rad_s, other.velocity_rad_s),
            (self.acceleration_rad_s2, other.acceleration_rad_s2),
        )
        return JointMotion(*(tuple(a + share * (b - a) for a, b in zip(*pair, strict=True)) for pair in pairs))

    def with_joint(self, joint: int, other: JointMotion) -> JointMotion:
        """This motion, one joint of which moves as in another."""
        pairs = (
            (self.position_rad, other.position_rad),
            (self.velocity_rad_s, other.velocity_rad_s),
            (self.acceleration_rad_s2, other.acceleration_rad_s2),
        )
        return JointMotion(*((*mine[:joint], theirs[joint], *mine[joint + 1 :]) for mine, theirs in pairs))

    @property
    def resting(self) -> bool:
        """Whether no joint moves."""
        return all(-ROUNDING < rate < ROUNDING for rate in (*self.velocity_rad_s, *self.acceleration_rad_s2))


class Limiter:
    """Plans for J joints under one set of limits.

    Args:
        velocity_rad_s: (J,) largest speeds.
        acceleration_rad_s2: (J,) largest accelerations.
        jerk_rad_s3: (J,) largest jerks.
    """

    def __init__(self, velocity_rad_s: FloatArray, acceleration_rad_s2: FloatArray, jerk_rad_s3: FloatArray) -> None:
        joints = len(velocity_rad_s)
        self._planner = Ruckig(joints)
        self._plan = Trajectory(joints)
        self._reach, self._stop, self._cruise = (InputParameter(joints) for _ in range(3))
        for problem in (self._reach, self._stop, self._cruise):
            problem.max_velocity = velocity_rad_s.tolist()
            problem.max_acceleration = acceleration_rad_s2.tolist()
            problem.max_jerk = jerk_rad_s3.tolist()
            problem.target_velocity = problem.target_acceleration = [0.0] * joints
            # A slow joint must not delay a quick one, and a stretched plan might swing out on its far side.
            problem.synchronization = Synchronization.No
        self._stop.control_interface = self._cruise.control_interface = ControlInterface.Velocity

    def toward(self, motion: JointMotion, target_rad: Joints, dt_s: float) -> JointMotion:
        """`motion` after `dt_s` on the fastest way to rest in `target_rad`.

        Raises:
            NoPlanError: There is no plan; finite input inside the limits always has one.
        """
        if motion.resting:
            pairs = zip(target_rad, motion.position_rad, strict=True)
            if all(abs(target - position) < ROUNDING for target, position in pairs):
                return JointMotion.at_rest(motion.position_rad)
        self._reach.target_position = target_rad
        return self._sampled(self._reach, motion, dt_s)

    def stop(self, motion: JointMotion, dt_s: float) -> JointMotion:
        """`motion` after `dt_s` on the fastest way to rest anywhere.

        Raises:
            NoPlanError: There is no plan; finite input inside the limits always has one.
        """
        if motion.resting:
            return JointMotion.at_rest(motion.position_rad)
        return self._sampled(self._stop, motion, dt_s)

    def stop_duration_s(self, motion: JointMotion) -> float:
        """How long `motion` takes to come to rest.

        Raises:
            NoPlanError: There is no plan; finite input inside the limits always has one.
        """
        if motion.resting:
            return 0.0
        self._planned(self._stop, motion)
        return float(self._plan.duration)

    def path(
        self, now: JointMotion, then: JointMotion, elapsed_s: float, times_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(K, J) positions [rad] and (K, J) velocities [rad/s] of a step and the stop after it.

        Args:
            now: Where it begins.
            then: Where it is after `elapsed_s`, when the stop begins.
            elapsed_s: See there.
            times_s: (K,) times after `now`, in order. Inside the step the cubic between its ends is taken.

        Raises:
            NoPlanError: There is no plan; finite input inside the limits always has one.
        """
        self._planned(self._stop, then)
        positions, velocities = [], []
        for time_s in times_s.tolist():
            if time_s >= elapsed_s:
                position, velocity, _ = self._plan.at_time(time_s - elapsed_s)
            elif time_s == 0.0:
                position, velocity = now.position_rad, now.velocity_rad_s
            else:
                position, velocity = _between(now, then, elapsed_s, time_s / elapsed_s)
            positions.append(position)
            velocities.append(velocity)
        return np.array(positions), np.array(velocities)

    def at_velocity(self, motion: JointMotion, velocity_rad_s: Joints, dt_s: float) -> JointMotion:
        """`motion` after `dt_s` on the fastest way to these velocities.

        Raises:
            NoPlanError: There is no plan; finite input inside the limits always has one.
        """
        self._cruise.target_velocity = velocity_rad_s
        return self._sampled(self._cruise, motion, dt_s)

    def stopping(self, motion: JointMotion, period_s: float) -> tuple[JointMotion, ...]:
        """What follows `motion` on the fastest way to rest: each `period_s`, the last at rest; none if it rests.

        Raises:
            NoPlanError: There is no plan; finite input inside the limits always has one.
        """
        if motion.resting:
            return ()
        self._planned(self._stop, motion)
        count = math.ceil(self._plan.duration / period_s)
        at = (self._plan.at_time(period_s * number) for number in range(1, count))
        moving = [JointMotion(*map(tuple, each)) for each in at]
        return (*moving, JointMotion.at_rest(tuple(self._plan.at_time(self._plan.duration)[0])))

    def bears(self, motion: JointMotion) -> bool:
        """Whether `motion` is inside these limits."""
        pairs = (
            (motion.velocity_rad_s, self._stop.max_velocity),
            (motion.acceleration_rad_s2, self._stop.max_acceleration),
        )
        return all(abs(rate) <= most + ROUNDING for each in pairs for rate, most in zip(*each, strict=True))

    def resting_place(self, motion: JointMotion) -> Joints:
        """Where `motion` comes to rest if stopped now: J positions [rad].

        Raises:
            NoPlanError: There is no plan; finite input inside the limits always has one.
        """
        # Longer than any stop lasts: a plan stays in its last state after its end.
        return self.stop(motion, 1e3).position_rad

    def _sampled(self, problem: InputParameter, motion: JointMotion, dt_s: float) -> JointMotion:
        self._planned(problem, motion)
        position, velocity, acceleration = self._plan.at_time(dt_s)
        sampled = JointMotion(tuple(position), tuple(velocity), tuple(acceleration))
        return JointMotion.at_rest(sampled.position_rad) if sampled.resting else sampled

    def _planned(self, problem: InputParameter, motion: JointMotion) -> None:
        problem.current_position = motion.position_rad
        problem.current_velocity = motion.velocity_rad_s
        problem.current_acceleration = motion.acceleration_rad_s2
        try:
            result = self._planner.calculate(problem, self._plan)
        except RuckigError as error:
            raise NoPlanError(str(error).strip()) from error
        if result not in (Result.Working, Result.Finished):
            raise NoPlanError(f"{result}")


def _between(now: JointMotion, then: JointMotion, elapsed_s: float, share: float) -> tuple[FloatArray, FloatArray]:
    """Position and velocity inside a step. Source: cubic Hermite interpolation."""
    start, end = np.array(now.position_rad), np.array(then.position_rad)
    leaving, coming = (np.array(motion.velocity_rad_s) * elapsed_s for motion in (now, then))
    third, second = 2.0 * (start - end) + leaving + coming, 3.0 * (end - start) - 2.0 * leaving - coming
    position = start + share * (leaving + share * (second + share * third))
    return position, (leaving + share * (2.0 * second + 3.0 * share * third)) / elapsed_s

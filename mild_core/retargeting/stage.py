# SPDX-License-Identifier: Apache-2.0
"""From a predicted motion to commands that a robot can carry out: smooth, inside every limit, safe without input.

    MotionWindow, PersonPose, JointMeasurement, Request or a tick of the control clock -> JointCommand

The robot is commanded from where it says it is. It follows the newest motion, read a little ahead of now because
the limits make it lag. Without a usable motion it stops smoothly, waits, goes home slowly and is ready again; a
motion that comes on the way is followed at once. A robot that is found far from its command for a while (moved by
hand, blocked, switched off) is not pulled back: the command moves smoothly to where the robot is, and whatever
follows ramps from there.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mild_core.retargeting.limiter import JointMotion, Joints, Limiter, NoPlanError
from mild_core.retargeting.modes import Mode, next_mode
from mild_core.retargeting.reception import take_measurement, take_motion, take_person, take_request
from mild_core.retargeting.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.state import Request, RetargetingState
from mild_core.retargeting.target import Plan, ramp_onto
from mild_core.retargeting.watchdog import after_gap, after_time_jump, fresh, known
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import JointCommand, JointMeasurement, MotionWindow, PersonPose

__all__ = ["Mode", "Request", "Retargeting", "RetargetingInput", "RetargetingSettings", "RetargetingState"]

HOME_SHARE = 0.1
"""Share of the robot's acceleration and jerk used on the way home: nobody is waiting for it."""

AT_HOME_RAD = 1e-6
"""Closer to home than this is home: far below an encoder's step, far above rounding."""


RetargetingInput = MotionWindow | PersonPose | JointMeasurement | Request | None
"""None is a tick of the control clock."""

_Stepped = tuple[RetargetingState, tuple[JointCommand, ...]]


@dataclass(frozen=True, eq=False)
class Retargeting:
    """Commands for one robot.

    Attributes:
        robot: What is commanded.
        settings: How.
    """

    robot: RobotModel
    settings: RetargetingSettings = field(default_factory=RetargetingSettings)
    _limiter: Limiter = field(init=False, repr=False)
    _slow: Limiter = field(init=False, repr=False)
    _lower: FloatArray = field(init=False, repr=False)
    _upper: FloatArray = field(init=False, repr=False)
    _home: Joints = field(init=False, repr=False)

    def __post_init__(self) -> None:
        robot, margin = self.robot, self.settings.position_margin_rad
        acceleration, jerk = robot.acceleration_rad_s2, robot.jerk_rad_s3
        velocity = np.minimum(robot.velocity_rad_s, self.settings.home_velocity_rad_s)
        object.__setattr__(self, "_limiter", Limiter(robot.velocity_rad_s, acceleration, jerk))
        object.__setattr__(self, "_slow", Limiter(velocity, acceleration * HOME_SHARE, jerk * HOME_SHARE))
        object.__setattr__(self, "_lower", robot.lower_rad + margin)
        object.__setattr__(self, "_upper", robot.upper_rad - margin)
        object.__setattr__(self, "_home", self._inside(robot.home_rad))

    def init(self) -> RetargetingState:
        """The state before the first input."""
        return RetargetingState(mode=Mode.WAITING if self.settings.start_enabled else Mode.DISABLED)

    def step(self, state: RetargetingState, given: RetargetingInput, now_ns: int) -> _Stepped:
        """Take one input, or None for a tick of the control clock, at time `now_ns`.

        A tick and an accepted motion lead to one command, unless one was sent at this very time, nobody has said
        yet where the robot is, or retargeting is disabled. Bad input is counted by its reason and changes nothing.
        """
        if state.commanded_ns is not None and now_ns < state.commanded_ns:
            state = after_time_jump(state, now_ns)
        if given is None:
            return self._command(state.ended("tick"), now_ns)
        if isinstance(given, MotionWindow):
            state = take_motion(state, given, self.robot, self.settings, now_ns)
            return self._command(state, now_ns) if state.outcome == "accepted" else (state, ())
        if isinstance(given, PersonPose):
            return take_person(state, given, self.settings, now_ns), ()
        if isinstance(given, JointMeasurement):
            return take_measurement(state, given, self.robot, self.settings, now_ns), ()
        return take_request(state, given, now_ns), ()

    def _command(self, state: RetargetingState, now_ns: int) -> _Stepped:
        state = state.with_sight(now_ns)
        motion = state.motion
        if motion is None or state.commanded_ns == now_ns:
            return state, ()
        if state.mode is Mode.DISABLED and motion.resting:
            return replace(state, commanded_ns=None), ()
        elapsed_s = 0.0 if state.commanded_ns is None else (now_ns - state.commanded_ns) * 1e-9
        if elapsed_s > self.settings.max_gap_s:
            state, elapsed_s = after_gap(state, motion, now_ns), 0.0
            motion = state.motion or motion
        state = self._in_next_mode(state, motion, now_ns)
        try:
            motion = self._advanced(state, motion, now_ns, elapsed_s)
        except NoPlanError:
            motion = JointMotion.at_rest(motion.position_rad)
            state = state.counted("no_plan")
        return replace(state, motion=motion, commanded_ns=now_ns), (
            JointCommand(
                stamp_ns=now_ns,
                joint_names=self.robot.joint_names,
                positions_rad=read_only(motion.position_rad),
                velocities_rad_s=read_only(motion.velocity_rad_s),
                mode=state.mode.value,
                motion_stamp_ns=state.plan.stamp_ns if state.plan is not None and state.mode is Mode.FOLLOWING else 0,
            ),
        )

    def _in_next_mode(self, state: RetargetingState, motion: JointMotion, now_ns: int) -> RetargetingState:
        settings = self.settings
        is_known, is_fresh = known(state, settings, now_ns), fresh(state, settings, now_ns)
        held_s = (now_ns - state.holding_since_ns) * 1e-9
        mode = next_mode(
            state.mode,
            usable=is_known and is_fresh,
            displaced=state.displaced,
            patience_over=held_s >= settings.home_after_s and motion.resting,
            at_home=state.mode is Mode.RETURNING and self._at_home(motion),
        )
        if mode is state.mode:
            return state
        if mode is Mode.FOLLOWING and state.plan is not None:
            start_rad, target_rad = self._limiter.resting_place(motion), self._wanted(state.plan, now_ns)
            ramp = ramp_onto(target_rad, start_rad, settings.ramp_velocity_rad_s, now_ns)
            return replace(state, mode=mode, ramp=ramp)
        if mode is Mode.HOLDING and not state.displaced:
            state = state.counted("held_stale" if is_known else "held_unknown")
        return replace(state, mode=mode, plan=None, ramp=None, holding_since_ns=now_ns)

    def _advanced(self, state: RetargetingState, motion: JointMotion, now_ns: int, elapsed_s: float) -> JointMotion:
        if state.mode is Mode.FOLLOWING and state.plan is not None and state.ramp is not None:
            target = state.ramp.blend(self._wanted(state.plan, now_ns), now_ns)
            return self._limiter.toward(motion, tuple(target.tolist()), elapsed_s)
        if state.mode is Mode.HOLDING and state.displaced:
            return self._limiter.toward(motion, self._inside(np.array(state.measured_rad)), elapsed_s)
        if state.mode is Mode.RETURNING:
            return self._slow.toward(motion, self._home, elapsed_s)
        return self._limiter.stop(motion, elapsed_s)

    def _at_home(self, motion: JointMotion) -> bool:
        away_rad = max(abs(now - home) for now, home in zip(motion.position_rad, self._home, strict=True))
        return motion.resting and away_rad < AT_HOME_RAD

    def _wanted(self, plan: Plan, now_ns: int) -> FloatArray:
        target = plan.at(now_ns + round(self.settings.look_ahead_s * 1e9))
        wanted: FloatArray = np.minimum(np.maximum(target, self._lower), self._upper)
        return wanted

    def _inside(self, positions_rad: FloatArray) -> Joints:
        return tuple(np.minimum(np.maximum(positions_rad, self._lower), self._upper).tolist())

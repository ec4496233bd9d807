# SPDX-License-Identifier: Apache-2.0
"""From a predicted motion to commands that a robot can carry out: smooth, inside every limit, safe without input.

    MotionWindow, PersonPose, JointMeasurement, Request or a tick of the control clock -> JointCommand

The robot is commanded from where it says it is. Once the person raises the hand it follows the newest motion, read a
little ahead of now because the limits make it lag, and brings the hands together where they are meant to touch. When
the hand is back, or without a usable motion, it stops smoothly and goes home slowly; whoever starts on its way is
followed at once. A motion into itself, into the person or too fast near them is refused. A robot that is found far
from its command for a while (moved by hand, blocked, switched off) is not pulled back: the command moves smoothly to
where the robot is, and whatever follows ramps from there. Of a robot that has ceased to say where it is nobody knows
that, so the command stops until it speaks again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mild_core.joint_measurements import JointMerger
from mild_core.retargeting.arm_following import ArmFollower, arm_follower
from mild_core.retargeting.contact import Contact, stiffness
from mild_core.retargeting.guard import NOBODY, TOO_FAST, Body, Guard, body_of
from mild_core.retargeting.life import person_present, situation, with_rest
from mild_core.retargeting.limiter import JointMotion, Joints, Limiter, NoPlanError
from mild_core.retargeting.modes import Mode, next_mode
from mild_core.retargeting.person import LOST_S, SHIFT_M_S, Standing
from mild_core.retargeting.reception import joint_merger, take_measurement, take_motion, take_person, take_request
from mild_core.retargeting.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.state import Request, RetargetingState
from mild_core.retargeting.target import Plan, Pursuit
from mild_core.retargeting.watchdog import after_gap, after_time_jump, known, with_ear
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import ARM_FRAME, JointCommand, JointMeasurement, MotionWindow, PersonPose

__all__ = ["Mode", "Request", "Retargeting", "RetargetingInput", "RetargetingSettings", "RetargetingState"]

HOME_SHARE = 0.1
"""Share of the robot's acceleration and jerk used on the way home: nobody is waiting for it."""

EASINGS = 3
"""Times that what is taken of a refused motion is halved: an eighth of it is as good as none."""

SLOWED = "slowed"
"""Counted when a part of a motion was taken."""

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
        standing: Where people stand, and in which interactions hands touch; None when nobody knows: then no hand is
            met, and only people whom a calibrated camera sees are kept away from.
    """

    robot: RobotModel
    settings: RetargetingSettings = field(default_factory=RetargetingSettings)
    standing: Standing | None = None
    _limiter: Limiter = field(init=False, repr=False)
    _slow: Limiter = field(init=False, repr=False)
    _guard: Guard = field(init=False, repr=False)
    _merger: JointMerger = field(init=False, repr=False)
    _contact: Contact | None = field(init=False, repr=False)
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
        object.__setattr__(self, "_guard", Guard(robot, self.settings))
        object.__setattr__(self, "_merger", joint_merger(robot, self.settings))
        touches = self.settings.ik != "off" and self.standing is not None
        object.__setattr__(self, "_contact", Contact(robot, self.settings.ik, margin) if touches else None)

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
            return take_measurement(state, given, self._merger, self.robot, self.settings, now_ns), ()
        state = take_request(state, given, now_ns)
        return self._command(state, now_ns) if given.kind == "hold" else (state, ())

    def _command(self, state: RetargetingState, now_ns: int) -> _Stepped:
        state = state.with_sight(now_ns)
        motion = state.motion
        if motion is None or state.commanded_ns == now_ns:
            return state, ()
        if state.mode is Mode.DISABLED and motion.resting:
            return replace(state, commanded_ns=None), ()
        if state.commanded_ns is None and motion.resting and state.joints.disagree(now_ns):
            return state, ()  # nobody knows where the first command would have to begin
        elapsed_s = 0.0 if state.commanded_ns is None else (now_ns - state.commanded_ns) * 1e-9
        if elapsed_s > self.settings.max_gap_s:
            state, elapsed_s = after_gap(state, motion, now_ns), 0.0
            motion = state.motion or motion
        if state.plan is not None and self.standing is not None:
            most_m = SHIFT_M_S * elapsed_s if state.near_m < self.settings.near_m else math.inf
            state = replace(state, place_m=self.standing.place(state.plan.interaction, state.place_m, most_m))
        state = with_ear(with_rest(state, self.settings, now_ns), self.settings, now_ns)
        state = self._in_next_mode(state, motion, now_ns)
        try:
            state, motion = self._advanced(state, motion, now_ns, elapsed_s)
        except NoPlanError:
            motion = JointMotion.at_rest(motion.position_rad)
            state = state.counted("no_plan")
        return replace(state, motion=motion, commanded_ns=now_ns, had_plan=state.plan is not None), (
            JointCommand(
                stamp_ns=now_ns,
                joint_names=self.robot.joint_names,
                positions_rad=read_only(motion.position_rad),
                velocities_rad_s=read_only(motion.velocity_rad_s),
                mode=state.mode.value,
                stiffness=stiffness(state.touch),
                motion_stamp_ns=state.plan.stamp_ns if state.plan is not None and state.mode is Mode.FOLLOWING else 0,
            ),
        )

    def _in_next_mode(self, state: RetargetingState, motion: JointMotion, now_ns: int) -> RetargetingState:
        settings, resting = self.settings, motion.resting
        given = situation(state, settings, now_ns, resting=resting, at_home=resting and self._at_home(motion))
        mode = next_mode(state.mode, given)
        if mode is state.mode:
            return state
        state = replace(state, since_ns=now_ns, touch=None, pursuit=None)
        if mode is Mode.FOLLOWING and state.plan is not None:
            return replace(state, mode=mode)
        if mode is Mode.HOLDING and not (state.displaced or state.silent) and state.mode is Mode.FOLLOWING:
            state = state.counted("held_stale" if known(state, settings, now_ns) else "held_unknown")
        # A plan outlives a pause that the person made, for them to go on at once.
        plan = state.plan if given.usable else None
        return replace(state, mode=mode, plan=plan, holding_since_ns=now_ns)

    def _advanced(
        self, state: RetargetingState, motion: JointMotion, now_ns: int, elapsed_s: float
    ) -> tuple[RetargetingState, JointMotion]:
        """The state and the motion after a step, or after the first step of a stop where the wanted one is refused."""
        body = self._body(state, now_ns)
        if state.mode is Mode.FOLLOWING and state.plan is not None:
            state, target_rad = self._target(state, state.plan, motion, body, now_ns, elapsed_s)
            wanted = self._limiter.toward(motion, target_rad, elapsed_s)
        elif state.mode is Mode.HOLDING and state.displaced:
            wanted = self._limiter.toward(motion, self._inside(np.array(state.measured_rad)), elapsed_s)
        elif state.mode is Mode.RETURNING:
            wanted = self._homeward(motion, elapsed_s)
        else:
            return state, self._limiter.stop(motion, elapsed_s)
        if wanted.resting and wanted.position_rad == motion.position_rad:
            return state, wanted
        taken, refusal, near_m = self._harmless(motion, wanted, body, elapsed_s)
        state = replace(state, near_m=near_m)
        if not refusal:
            return state, taken
        if state.pursuit is not None and refusal not in (SLOWED, TOO_FAST):
            # Held back for good a joint sets off anew, and does not hurry after what went on without it.
            free = [a == b for a, b in zip(taken.position_rad, wanted.position_rad, strict=True)]
            pursuit = state.pursuit.held(self._limiter.resting_place(taken), free) if any(free) else None
            state = replace(state, pursuit=pursuit)
        return state.counted(refusal), taken

    def _harmless(
        self, motion: JointMotion, wanted: JointMotion, body: Body, elapsed_s: float
    ) -> tuple[JointMotion, str, float]:
        """As much of a step as is harmless, from none, which is a stop; why not all of it; and how near [m] it is.

        A joint that does no harm without the others goes on: an arm that would meet the robot slides along it. Between
        two motions that keep the limits all others keep them, also with joints of the one in the other.
        """
        refusal, near_m = self._guard.judged(motion, self._limiter.stop_path(wanted), body)
        if not refusal:
            return wanted, refusal, near_m
        taken = stop = self._limiter.stop(motion, elapsed_s)
        least, most = 0.0, 1.0
        for _ in range(EASINGS):
            share = (least + most) / 2.0
            tried = stop.toward(wanted, share)
            if self._guard.judged(motion, self._limiter.stop_path(tried), body)[0]:
                most = share
            else:
                least, taken = share, tried
        for joint in range(len(self._home)) if refusal != TOO_FAST else ():
            tried = taken.with_joint(joint, wanted)
            if not self._guard.judged(motion, self._limiter.stop_path(tried), body)[0]:
                taken = tried
        return taken, SLOWED if least > 0.0 else refusal, near_m

    def _target(
        self,
        state: RetargetingState,
        plan: Plan,
        motion: JointMotion,
        body: Body,
        now_ns: int,
        elapsed_s: float,
    ) -> tuple[RetargetingState, Joints]:
        """Where the joints are sent while following: as learned, hands brought together, no faster than allowed."""
        aimed, touch = self._wanted(plan, motion, now_ns), None
        pursuit = state.pursuit or Pursuit.onto(aimed, self._limiter.resting_place(motion))
        if self._contact is not None and self.standing is not None:
            touches = plan.interaction in self.standing.by_interaction and np.isfinite(body.hand_m).all()
            hand_m = self._guard.outside(body.hand_m, body) if touches else None
            offered = state.sight is not None and state.sight.offered()
            known = (plan.covariance, hand_m, offered, state.touch)
            aimed, touch = self._contact.aim(aimed, *known, np.array(motion.position_rad), elapsed_s)
            aimed = np.minimum(np.maximum(aimed, self._lower), self._upper)
        hurry = 0.0 if touch is None else touch.share * self._guard.nearness(state.near_m)
        pursuit, target = pursuit.nearer(aimed, self.settings.ramp_velocity_rad_s, hurry, elapsed_s)
        # A plan that turns takes what is left to catch up with along, beyond the limits too.
        target = np.minimum(np.maximum(target, self._lower), self._upper)
        target = self._guard.paced(np.array(pursuit.target_rad), target, state.near_m, elapsed_s)
        pursuit = pursuit.at(target, aimed)
        return replace(state, touch=touch, pursuit=pursuit), pursuit.target_rad

    def _body(self, state: RetargetingState, now_ns: int) -> Body:
        """The person where they will be when this command has been carried out; nobody if that is not known."""
        sight, settings = state.sight, self.settings
        if sight is None or not person_present(state, settings, now_ns):
            return NOBODY
        if sight.frame_id == ARM_FRAME and self.standing is None:
            return NOBODY
        seen = (now_ns - sight.hand_ns) * 1e-9 <= LOST_S
        hand = sight.hand_at(now_ns + round(settings.look_ahead_s * 1e9)) if seen else np.full(3, np.nan)
        points = np.stack([hand, *sight.body_m])
        if self.standing is not None:
            points = self.standing.placed(points, sight.frame_id, state.place_m or self.standing.place_m)
        return body_of(points[0], points[1:])

    def _homeward(self, motion: JointMotion, elapsed_s: float) -> JointMotion:
        """A step of the slow way home, or of a stop while the arm is quicker than that way can bear.

        Slow brakes would carry an arm that an interaction has left in full flight far beyond its limits.
        """
        if self._slow.bears(motion) and self._is_inside(self._slow.resting_place(motion)):
            return self._slow.toward(motion, self._home, elapsed_s)
        return self._limiter.stop(motion, elapsed_s)

    def _at_home(self, motion: JointMotion) -> bool:
        away_rad = max(abs(now - home) for now, home in zip(motion.position_rad, self._home, strict=True))
        return motion.resting and away_rad < AT_HOME_RAD

    @cached_property
    def _arm(self) -> ArmFollower:
        return arm_follower(self.robot)

    def _wanted(self, plan: Plan, motion: JointMotion, now_ns: int) -> FloatArray:
        target = plan.at(now_ns + round(self.settings.look_ahead_s * 1e9))
        if target.ndim == 2:
            target = np.array(self._arm.joints(target, motion.position_rad))
        wanted: FloatArray = np.minimum(np.maximum(target, self._lower), self._upper)
        return wanted

    def _is_inside(self, positions_rad: Joints) -> bool:
        places = np.array(positions_rad)
        return bool((places >= self.robot.lower_rad).all() and (places <= self.robot.upper_rad).all())

    def _inside(self, positions_rad: FloatArray) -> Joints:
        return tuple(np.minimum(np.maximum(positions_rad, self._lower), self._upper).tolist())

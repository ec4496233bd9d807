# SPDX-License-Identifier: Apache-2.0
"""From a predicted motion to commands that a robot can carry out: smooth, inside every limit, safe without input.

    MotionWindow, PersonPose, JointMeasurement, Request or a tick of the control clock -> JointCommand

The robot is commanded from where it says it is. Once the person raises the hand it follows the newest motion, read a
little ahead of now because the limits make it lag, and brings the hands together where they are meant to touch. A hand
that is offered before it is known for what is met wherever it is measured, slowly. When the hand is back, or without a
usable motion, it stops smoothly and goes home slowly; a person who starts on its way is followed at once. A motion into
itself, into a person or too fast near one is rejected, and the arm gives way to people who come too near, also while it
waits at home; only an operator's hold stands still. A robot that is found far from its command for a while (moved by
hand, blocked, switched off) is not pulled back: the command moves smoothly to where the robot is, and what follows
ramps from there. A robot that no longer says where it is may be anywhere, so the command stops until it speaks again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mild_core.joint_measurements import JointMerger
from mild_core.retargeting.camera_doubt import BEHIND, INSIDE, UPSIDE_DOWN, camera_doubt
from mild_core.retargeting.clearance import BREACHES
from mild_core.retargeting.contact import Contact, stiffness
from mild_core.retargeting.guard import TOO_FAST, Guard, PoseEvaluation, Verdict
from mild_core.retargeting.human_track import LOST_S, SHIFT_M_S, AssumedPlacement
from mild_core.retargeting.input_handlers import joint_merger, take_measurement, take_motion, take_person, take_request
from mild_core.retargeting.limiter import JointMotion, Joints, Limiter, NoPlanError
from mild_core.retargeting.mode_inputs import person_present, situation, with_rest, with_start
from mild_core.retargeting.modes import Mode, next_mode
from mild_core.retargeting.obstacles import NO_ONE, Obstacles, obstacles_of
from mild_core.retargeting.robot_model.arm_following import ArmFollower, arm_follower
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.state import PAUSED_S, Request, RetargetingState
from mild_core.retargeting.target import Plan, RampIn
from mild_core.retargeting.timeouts import after_gap, after_time_jump, known, with_robot_timeout
from mild_core.retargeting.trajectory_stream import STAND_S, TrajectoryStream, limits_between_points, resumed
from mild_core.retargeting.unmet import (
    APART_M,
    LASTS_S,
    LATE_AFTER_S,
    LIMITS,
    NO_TOUCH,
    PARTED_M,
    SAID_AFTER_S,
    STAYS_S,
    not_followed,
    not_reached,
)
from mild_core.retargeting.yielding import Yielding
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import (
    ARM_FRAME,
    ROBOT_FRAME,
    UNKNOWN_DIRECTION,
    JointCommand,
    JointMeasurement,
    MotionWindow,
    PersonPose,
)

__all__ = ["Mode", "Request", "Retargeting", "RetargetingInput", "RetargetingSettings", "RetargetingState"]

HOME_SHARE = 0.1
"""Share of the robot's acceleration and jerk used on the way home: no person waits for it."""

GENTLE = 0.8
"""Share of `ramp_velocity_rad_s` with which the robot meets a hand that is offered, not yet known for what, and follows
a given interaction that is not the one performed."""

UNHURRIED = 0.95
"""Share of that speed of its targets: the limits overshoot a little where they catch up."""

EASINGS = 3
"""Times that what is taken of a refused motion is halved: an eighth of it is as good as none."""

SLOWED = "slowed"
"""Counted when a part of a motion was taken."""

REFUSALS = tuple(dict.fromkeys(reason for reason in BREACHES if reason))
"""What the guard counts when it refuses a motion."""

UNMEASURED = "the camera is not measured; set robot_from_camera or allow_unmeasured_contact"
ASSUMED = "the camera is not measured: hands may touch as allow_unmeasured_contact says, where people are assumed to be"

WAITS_S = 1.2
"""A hand that has been raised for longer and is held out waits to be met: the learned one has had time to come near."""

NEVER = "the model names no interaction in which hands touch; name them under contact in its manifest, or set ik to off"
"""Why hands are never brought together."""

PARTNER_WAITS_S = 0.6
"""So long waits a hand, and not `WAITS_S`, where the learned one is a partner's: that gives the posture, and comes near
the person's by chance alone."""

RELAXING_S = 0.5
"""The learned posture is given up in this time, where it leads too near to a person."""

UNKNOWN_BODY = "the person's head and trunk are not known; use a tracker that gives shoulders and head"
"""Why hands are not brought together, or why they should not be."""

NEEDED_PARTS = {"head", "trunk"}
"""Parts of the watched person that must be known for hands to touch: what must not be touched has to be known first."""

DOUBTED = tuple(f"no contact: {doubt}" for doubt in (UPSIDE_DOWN, INSIDE))
"""Said where the person's measured place is impossible, so that nothing is met there."""

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
        standing: Where people stand, and in which interactions hands touch; None when unknown: then no hand is
            met, and only people whom a calibrated camera sees are kept away from.
        camera_measured: Whether the camera's pose is known, if asked before a person is seen; None when only people
            will show it.
    """

    robot: RobotModel
    settings: RetargetingSettings = field(default_factory=RetargetingSettings)
    standing: AssumedPlacement | None = None
    camera_measured: bool | None = None
    _limiter: Limiter = field(init=False, repr=False)
    _slow: Limiter = field(init=False, repr=False)
    _guard: Guard = field(init=False, repr=False)
    _merger: JointMerger = field(init=False, repr=False)
    _yielding: Yielding = field(init=False, repr=False)
    _contact: Contact | None = field(init=False, repr=False)
    _lower: FloatArray = field(init=False, repr=False)
    _upper: FloatArray = field(init=False, repr=False)
    _home: Joints = field(init=False, repr=False)

    def __post_init__(self) -> None:
        robot, margin = self.robot, self.settings.position_margin_rad
        acceleration, jerk = robot.acceleration_rad_s2, robot.jerk_rad_s3
        velocity = np.minimum(robot.velocity_rad_s, self.settings.home_velocity_rad_s)
        if self.settings.execution_delay_s:
            acceleration, jerk = limits_between_points(acceleration, jerk)
        object.__setattr__(self, "_limiter", Limiter(robot.velocity_rad_s, acceleration, jerk))
        object.__setattr__(self, "_slow", Limiter(velocity, acceleration * HOME_SHARE, jerk * HOME_SHARE))
        object.__setattr__(self, "_lower", robot.lower_rad + margin)
        object.__setattr__(self, "_upper", robot.upper_rad - margin)
        object.__setattr__(self, "_home", self._inside(robot.home_rad))
        object.__setattr__(self, "_guard", Guard(robot, self.settings))
        object.__setattr__(self, "_merger", joint_merger(robot, self.settings))
        object.__setattr__(self, "_yielding", Yielding(robot, self.settings, self._guard))
        touches = self.settings.ik != "off" and self.standing is not None
        object.__setattr__(self, "_contact", Contact(robot, self.settings.ik, margin) if touches else None)

    def init(self) -> RetargetingState:
        """The state before the first input."""
        state = RetargetingState(mode=Mode.WAITING if self.settings.enabled else Mode.DISABLED)
        return replace(state, no_contact=self._no_contact(state, 0))

    def trajectory_stream(self) -> TrajectoryStream:
        """Makes messages for a controller of trajectories from the commands; for settings with `execution_delay_s`."""
        robot = self.robot
        return TrajectoryStream(
            self._limiter,
            tuple(robot.velocity_rad_s.tolist()),
            tuple(robot.acceleration_rad_s2.tolist()),
            self.settings.execution_delay_s,
        )

    def step(self, state: RetargetingState, given: RetargetingInput, now_ns: int) -> _Stepped:
        """Take one input, or None for a tick of the control clock, at time `now_ns`.

        A tick and an accepted motion lead to one command, unless one was sent at this very time, it is unknown
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
            return state, ()  # the start of the first command is unknown
        if state.commanded_ns is None:
            state = replace(state, started_ns=now_ns)
        elapsed_s = 0.0 if state.commanded_ns is None else (now_ns - state.commanded_ns) * 1e-9
        if self.settings.execution_delay_s:
            if elapsed_s > self.settings.command_gap_s:
                state = after_gap(state, motion, now_ns)
            motion, elapsed_s = resumed(self._limiter, motion, elapsed_s)
        elif elapsed_s > self.settings.command_gap_s:
            state, elapsed_s = after_gap(state, motion, now_ns), 0.0
            motion = state.motion or motion
        if state.plan is not None and state.plan.interaction and self.standing is not None:
            most_m = SHIFT_M_S * elapsed_s if state.near_m < self.settings.near_m else math.inf
            state = replace(state, place_m=self.standing.place(state.plan.interaction, state.place_m, most_m))
        among = self._obstacles(state, now_ns)
        here = self._guard.here(motion, among)
        state = self._with_people(replace(state, near_m=here.near_m), among, here, now_ns)
        state = with_robot_timeout(with_rest(state, self.settings, now_ns), self.settings, now_ns)
        state = with_start(state, self.settings, self._guard.chain.offsets[0][:3, 3], now_ns)
        state = self._in_next_mode(state, motion, now_ns)
        refused = {reason: state.counts.get(reason, 0) for reason in REFUSALS}
        stands_ns = round(STAND_S * 1e9) if self.settings.execution_delay_s else 0
        try:
            if not 0 <= now_ns - state.started_ns < stands_ns:
                state, motion = self._advanced(state, motion, among, here, now_ns, elapsed_s)
        except NoPlanError:
            motion = JointMotion.at_rest(motion.position_rad)
            state = state.counted("no_plan")
        state = self._with_unmet(state, motion, among, refused, now_ns)
        if self.settings.execution_delay_s:
            state = state.with_pending(motion.position_rad, self.settings.execution_delay_s, now_ns)
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
        at_home = resting and self._at_home(motion)
        if at_home and state.gave_way:
            state = replace(state, gave_way=False)
        given = situation(state, settings, now_ns, resting=resting, at_home=at_home)
        mode = next_mode(state.mode, given)
        if mode is state.mode:
            return state
        state = replace(state, since_ns=now_ns, touch=None, pursuit=None, relaxed=0.0)
        if mode is Mode.FOLLOWING and state.plan is not None:
            return replace(state, mode=mode)
        if mode is Mode.HOLDING and not (state.displaced or state.silent) and state.mode is Mode.FOLLOWING:
            state = state.counted("held_stale" if known(state, settings, now_ns) else "held_unknown")
        # A plan outlives a pause that the person made, for them to go on at once.
        plan = state.plan if given.usable else None
        return replace(state, mode=mode, plan=plan, holding_since_ns=now_ns)

    def _no_contact(self, state: RetargetingState, now_ns: int) -> str:
        """Why hands do not meet, or should not, with or without a person in view; "" when they may."""
        crowd = state.crowd
        unmeasured = self.camera_measured is False if crowd is None else crowd.frame_id == ARM_FRAME
        if self._contact is None or self.standing is None:
            return UNMEASURED if unmeasured else ""
        if not self.standing.touching:
            return f"no contact: {NEVER}" + (f"; {UNMEASURED}" if unmeasured else "")
        if unmeasured and not self.settings.allow_unmeasured_contact:
            return f"no contact: {UNMEASURED}"
        present = crowd is not None and person_present(state, self.settings, now_ns)
        measured = present and crowd is not None and crowd.frame_id != ARM_FRAME
        doubt = camera_doubt(crowd, self._guard.chain.offsets[0][:3, 3]) if measured and crowd is not None else ""
        if doubt:
            return doubt if doubt == BEHIND else f"no contact: {doubt}"
        if present and crowd is not None and not crowd.watched_parts >= NEEDED_PARTS:
            return f"no contact: {UNKNOWN_BODY}"
        return ASSUMED if unmeasured else ""

    def _with_people(
        self, state: RetargetingState, among: Obstacles, here: PoseEvaluation, now_ns: int
    ) -> RetargetingState:
        """The state that knows what an operator should know of people: why no hands meet, and who is in the way."""
        no_contact = self._no_contact(state, now_ns)
        crowded = False
        for place in range(len(among.people)):
            if among.is_bystander(place) and here.clear_m[0, place] < among.zones_m[place]:
                crowded = True
        crowded = crowded or self._guard.within_reach(among)
        if (no_contact, crowded) == (state.no_contact, state.crowded):
            return state
        if crowded and not state.crowded:
            state = state.counted("bystander_near")
        return replace(state, no_contact=no_contact, crowded=crowded)

    def _with_unmet(
        self, state: RetargetingState, motion: JointMotion, among: Obstacles, refused: Mapping[str, int], now_ns: int
    ) -> RetargetingState:
        """The state that knows why a hand that is held out is not met."""
        apart_m = self._apart_m(state, motion, now_ns)
        met = (state.met and apart_m < PARTED_M) or (apart_m < APART_M and state.touch is not None)
        unmet = "" if met or apart_m < APART_M else self._unmet(state, among, refused, now_ns)
        lasting_s = (now_ns - state.unmet_ns) * 1e-9
        if not unmet:
            if not state.unmet and not state.unmet_ns and met == state.met:
                return state
            return replace(state, met=met, unmet="", unmet_ns=0)
        if not state.unmet_ns:
            return replace(state, met=met, unmet_ns=now_ns)
        stays_s = STAYS_S if state.unmet not in ("", LIMITS) else LASTS_S
        if unmet == state.unmet or lasting_s < stays_s:
            return state if met == state.met else replace(state, met=met)
        return replace(state, met=met, unmet=unmet, unmet_ns=now_ns).counted(unmet)

    def _apart_m(self, state: RetargetingState, motion: JointMotion, now_ns: int) -> float:
        """From the robot's hand to one that has been held out for a while [m]; infinite for any other."""
        sight = state.sight
        if self._contact is None or sight is None or not sight.raised:
            return math.inf
        apart_m = math.dist(self._contact.tool_m(motion.position_rad), self._hand(state, now_ns))
        return apart_m if math.isfinite(apart_m) else math.inf

    def _unmet(self, state: RetargetingState, among: Obstacles, refused: Mapping[str, int], now_ns: int) -> str:
        sight = state.sight
        if self._contact is None or sight is None or state.no_contact.startswith("no contact"):
            return ""
        if not sight.offered() or (raised_s := (now_ns - sight.raised_ns) * 1e-9) < SAID_AFTER_S:
            return ""
        hand_m = self._hand(state, now_ns)
        if not np.isfinite(hand_m).all():
            return ""
        if state.mode in (Mode.WAITING, Mode.DISABLED, Mode.HELD) or state.displaced or state.silent:
            return ""
        if state.mode is not Mode.FOLLOWING or state.plan is None:
            return not_followed(state.start_refusal)
        if not self._is_met(state.plan):
            return NO_TOUCH
        met_m, _ = self._guard.push_out(hand_m, among.touchable())
        why = not_reached(
            beyond=self._contact.is_beyond(met_m, state.touch),
            pushed=math.dist(met_m, hand_m) > APART_M,
            yielding=state.yielding,
            refusals=[reason for reason, count in refused.items() if state.counts.get(reason, 0) != count],
            hand_m_s=float(np.linalg.norm(sight.velocity_m_s)),
        )
        return "" if why == LIMITS and raised_s < LATE_AFTER_S else why

    def _may_touch(self, state: RetargetingState) -> bool:
        """Whether the watched person is known well enough for hands to touch."""
        crowd = state.crowd
        if crowd is None or not crowd.watched_parts >= NEEDED_PARTS or state.no_contact in DOUBTED:
            return False
        return crowd.frame_id != ARM_FRAME or self.settings.allow_unmeasured_contact

    def _advanced(
        self,
        state: RetargetingState,
        motion: JointMotion,
        among: Obstacles,
        here: PoseEvaluation,
        now_ns: int,
        elapsed_s: float,
    ) -> tuple[RetargetingState, JointMotion]:
        """The state and the motion after a step, or after the first step of a stop where the wanted one is refused."""
        if self._touches(state):
            among = among.touchable()
        if state.mode in (Mode.DISABLED, Mode.HELD):
            return replace(state, yielding=False, refuge=None), self._limiter.stop(motion, elapsed_s)
        retreat, refuge = None, None
        if not (state.displaced or state.silent):
            resting = self._limiter.resting_place(motion)
            goal = self._goal(state, resting)
            given = (motion.position_rad, resting, goal, here, among, state.refuge, state.mode is Mode.FOLLOWING)
            retreat, refuge = self._yielding.retreat(*given)
        if refuge != state.refuge:
            state = replace(state, refuge=refuge)
        if (retreat is not None) != state.yielding:
            state = replace(state, yielding=retreat is not None, gave_way=True)
            state = state.counted("yielded") if state.yielding else state
        following = state.mode is Mode.FOLLOWING and state.plan is not None
        if following and state.plan is not None:
            state, target_rad = self._target(state, state.plan, motion, among, here, now_ns, elapsed_s)
        if retreat is not None:
            wanted = self._retreating(motion, retreat, elapsed_s)
        elif following:
            wanted = self._limiter.toward(motion, target_rad, elapsed_s)
        elif state.mode is Mode.HOLDING and state.displaced:
            wanted = self._limiter.toward(motion, self._inside(np.array(state.measured_rad)), elapsed_s)
        elif state.mode is Mode.RETURNING:
            wanted = self._homeward(motion, elapsed_s)
        else:
            return state, self._limiter.stop(motion, elapsed_s)
        if wanted.resting and wanted.position_rad == motion.position_rad:
            return state, wanted
        taken, verdict = self._harmless(motion, wanted, among, here, elapsed_s, retreat is not None)
        refusal = verdict.refusal
        if following and state.plan is not None and state.plan.rows.ndim == 3:
            hindered = retreat is not None or refusal not in ("", SLOWED, TOO_FAST)
            if hindered and state.relaxed < 1.0:
                state = replace(state, relaxed=min(1.0, state.relaxed + elapsed_s / RELAXING_S))
        if refusal and among.is_bystander(verdict.segment):
            state = _paused(state, now_ns)
        if state.pursuit is not None and (retreat is not None or (refusal and refusal not in (SLOWED, TOO_FAST))):
            # A joint that was blocked ramps in again instead of catching up.
            each = zip(taken.position_rad, wanted.position_rad, strict=True)
            free = [retreat is None and a == b for a, b in each]
            goes = any(free) or retreat is not None
            pursuit = state.pursuit.held(self._limiter.resting_place(taken), free) if goes else None
            state = replace(state, pursuit=pursuit)
        return state.counted(refusal) if refusal else state, taken

    def _goal(self, state: RetargetingState, resting_rad: Joints) -> Joints:
        """Where the joints are on their way to."""
        if state.mode is Mode.FOLLOWING and state.pursuit is not None:
            pursuit = state.pursuit
            return self._inside(np.array(pursuit.target_rad) - np.array(pursuit.behind_rad))
        return self._home if state.mode is Mode.RETURNING else resting_rad

    def _touches(self, state: RetargetingState) -> bool:
        """Whether the watched hand may be touched now: it is offered, or hands are together and it is not withdrawn."""
        if state.mode is not Mode.FOLLOWING or state.plan is None or state.sight is None or self.standing is None:
            return False
        if self._contact is None or not self._is_met(state.plan):
            return False
        meeting = state.touch is not None and not state.touch.withdrawn
        return self._may_touch(state) and (state.sight.offered() or (state.sight.raised and meeting))

    def _is_met(self, plan: Plan) -> bool:
        """Whether hands touch in what a plan is about, be it known yet or not."""
        return self.standing is not None and plan.interaction in ("", *self.standing.touching)

    def _retreating(self, motion: JointMotion, retreat_rad_s: Joints, elapsed_s: float) -> JointMotion:
        """A step away from people; joints whose stop would leave their range stop instead."""
        moved = self._limiter.at_velocity(motion, retreat_rad_s, elapsed_s)
        stopped, resting = self._limiter.stop(motion, elapsed_s), self._limiter.resting_place(moved)
        for joint, place in enumerate(resting):
            if not self._lower[joint] <= place <= self._upper[joint]:
                moved = moved.with_joint(joint, stopped)
        return moved

    def _harmless(
        self,
        motion: JointMotion,
        wanted: JointMotion,
        among: Obstacles,
        here: PoseEvaluation,
        elapsed_s: float,
        giving_way: bool,
    ) -> tuple[JointMotion, Verdict]:
        """As much of a step as is harmless, from none, which is a stop; and why not all of it.

        A joint that does no harm without the others goes on: an arm that would meet the robot slides along it. Between
        two motions that keep the limits all others keep them, also with joints of the one in the other.
        """

        def checked(tried: JointMotion) -> Verdict:
            return self._guard.check_motion(self._limiter, motion, tried, elapsed_s, here, among, giving_way)

        verdict = checked(wanted)
        if not verdict.refusal:
            return wanted, verdict
        taken = stop = self._limiter.stop(motion, elapsed_s)
        least, most = 0.0, 1.0
        for _ in range(EASINGS):
            share = (least + most) / 2.0
            tried = stop.toward(wanted, share)
            if checked(tried).refusal:
                most = share
            else:
                least, taken = share, tried
        for joint in range(len(self._home)) if verdict.refusal != TOO_FAST else ():
            tried = taken.with_joint(joint, wanted)
            if not checked(tried).refusal:
                taken = tried
        return taken, verdict._replace(refusal=SLOWED) if least > 0.0 else verdict

    def _target(
        self,
        state: RetargetingState,
        plan: Plan,
        motion: JointMotion,
        among: Obstacles,
        here: PoseEvaluation,
        now_ns: int,
        elapsed_s: float,
    ) -> tuple[RetargetingState, Joints]:
        """Where the joints are sent while following: as learned, hands brought together, no faster than allowed."""
        learned = aimed = self._wanted(plan, motion, now_ns)
        touch = None
        if self._contact is not None:
            hand_m = self._hand(state, now_ns)
            touches = self._is_met(plan) and bool(np.isfinite(hand_m).all())
            touches = touches and self._may_touch(state) and not state.yielding
            met_m, pushed = self._guard.push_out(hand_m, among.touchable()) if touches else (None, -1)
            if among.is_bystander(pushed):
                state = _paused(state, now_ns)
            offered = state.sight is not None and state.sight.offered()
            given = (plan.covariance, met_m, offered, state.touch)
            measured = state.sight is not None and state.sight.frame_id == ROBOT_FRAME
            raised_s = 0.0 if state.sight is None else (now_ns - state.sight.raised_ns) * 1e-9
            partner = plan.rows.ndim == 3
            waits = measured and (not plan.interaction or raised_s > (PARTNER_WAITS_S if partner else WAITS_S))
            here_rad = np.array(motion.position_rad)
            aimed, touch = self._contact.aim(aimed, *given, here_rad, elapsed_s, waits=waits, relaxed=state.relaxed)
            aimed = np.minimum(np.maximum(aimed, self._lower), self._upper)
        pursuit = state.pursuit or RampIn.onto(aimed, self._limiter.resting_place(motion))
        hurry = 0.0 if touch is None or plan.gentle else touch.share * self._guard.nearness(state.near_m)
        ramp_rad_s = self.settings.ramp_velocity_rad_s * (GENTLE if plan.gentle else 1.0)
        pursuit, target = pursuit.nearer(aimed, ramp_rad_s, hurry, elapsed_s)
        # A plan that turns takes what is left to catch up with along, beyond the limits too.
        target = np.minimum(np.maximum(target, self._lower), self._upper)
        before = np.array(pursuit.target_rad)
        if plan.gentle:
            # Beside the learned motion itself, which goes as fast as its people did.
            learned_rad = np.abs(learned - self._wanted(plan, motion, now_ns - round(elapsed_s * 1e9)))
            most_rad = UNHURRIED * ramp_rad_s * elapsed_s + learned_rad
            target = before + np.minimum(np.maximum(target - before, -most_rad), most_rad)
        target = self._guard.limit_speed(before, target, here, among, state.crowded, elapsed_s)
        pursuit = pursuit.at(target, aimed)
        return replace(state, touch=touch, pursuit=pursuit), pursuit.target_rad

    def _hand(self, state: RetargetingState, now_ns: int) -> FloatArray:
        """(3,) the watched hand in the base frame when this command has been carried out; NaN if that is not known."""
        sight, settings = state.sight, self.settings
        if sight is None or not person_present(state, settings, now_ns):
            return UNKNOWN_DIRECTION
        if (now_ns - sight.hand_ns) * 1e-9 > LOST_S or (sight.frame_id == ARM_FRAME and self.standing is None):
            return UNKNOWN_DIRECTION
        hand = sight.hand_at(now_ns + round(settings.ahead_s * 1e9))
        if self.standing is not None:
            hand = self.standing.placed(hand, sight.frame_id, state.place_m or self.standing.place_m)
        return hand

    def _obstacles(self, state: RetargetingState, now_ns: int) -> Obstacles:
        """Everyone where they will be when this command has been carried out."""
        if state.crowd is None:
            return NO_ONE
        hand_m = self._hand(state, now_ns)
        among = obstacles_of(state.crowd, self.settings, self.standing, state.place_m, hand_m, now_ns)
        # A hand that may not be touched anyway is not offered: it makes the arm give way as it comes.
        return among if among.offered < 0 or self._may_touch(state) else replace(among, offered=-1)

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
        target = plan.at(now_ns + round(self.settings.ahead_s * 1e9))
        if target.ndim == 2:
            target = np.array(self._arm.joints(target, motion.position_rad))
        wanted: FloatArray = np.minimum(np.maximum(target, self._lower), self._upper)
        return wanted

    def _is_inside(self, positions_rad: Joints) -> bool:
        places = np.array(positions_rad)
        return bool((places >= self.robot.lower_rad).all() and (places <= self.robot.upper_rad).all())

    def _inside(self, positions_rad: FloatArray) -> Joints:
        return tuple(np.minimum(np.maximum(positions_rad, self._lower), self._upper).tolist())


def _paused(state: RetargetingState, now_ns: int) -> RetargetingState:
    """The state after a bystander has held the arm back; counted once until it was free for a while."""
    if state.paused_ns is None or (now_ns - state.paused_ns) * 1e-9 > PAUSED_S:
        state = state.counted("bystander_paused")
    return replace(state, paused_ns=now_ns)

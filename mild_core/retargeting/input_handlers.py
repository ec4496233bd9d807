# SPDX-License-Identifier: Apache-2.0
"""What retargeting makes of an input before any command: taken into the state, or refused by a counted reason."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mild_core.errors import DataError
from mild_core.joint_measurements import JointMerger
from mild_core.retargeting.human_track import check_pose
from mild_core.retargeting.limiter import JointMotion
from mild_core.retargeting.modes import Mode
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.state import Request, RetargetingState
from mild_core.retargeting.target import checked_plan
from mild_core.signals import OFFERED, RESTING, JointMeasurement, MotionWindow, PersonPose

OUTSIDE_RAD = 0.02
"""A measured pose may lie this far outside the position limits: a robot that leans on its end stop."""

OUT_OF_DISTRIBUTION = 1.0
"""Above this score a motion is unknown to the model; source: `MotionWindow.out_of_distribution`."""

SETTLING_S = 0.2
"""A robot that lags comes to rest so long after its command at the latest."""

REFUSING = {Mode.WAITING: "no_joint_states", Mode.DISABLED: "not_enabled"}
"""Modes in which no motion is taken, with the reason that is counted."""


def take_motion(
    state: RetargetingState, given: MotionWindow, robot: RobotModel, settings: RetargetingSettings, now_ns: int
) -> RetargetingState:
    """The state after a motion window; its outcome is `accepted`, `unknown` or why the window was refused."""
    if state.mode in REFUSING:
        return state.ended(REFUSING[state.mode])
    try:
        plan = checked_plan(given, robot, now_ns)
    except DataError as error:
        return state.ended(error.reason)
    age_s = (now_ns - given.stamp_ns) * 1e-9
    if age_s > settings.max_age_s:
        return state.ended("too_old")
    if age_s < -settings.max_future_s:
        return state.ended("from_future")
    if state.plan is not None and given.stamp_ns < state.plan.stamp_ns:
        return state.ended("out_of_order")
    state = _with_evidence(state, given, settings, now_ns)
    # To start asks for more than to go on, so that a score near the bound does not flicker between the two.
    bound = OUT_OF_DISTRIBUTION if state.mode is Mode.FOLLOWING else settings.known_below
    # A hand that is back at its rest ends what was followed: the robot goes home, and does not hold as for the unknown.
    ended = given.state == RESTING and state.mode is Mode.FOLLOWING
    # An offered hand has no name yet: whether the robot sets off for one depends on the person, see `start_gate.py`.
    is_some = bool(given.interaction) or (given.state == OFFERED and (given.may_start or state.mode is Mode.FOLLOWING))
    if not ended and (not is_some or given.out_of_distribution > bound):
        since_ns = now_ns if state.unknown_since_ns is None else state.unknown_since_ns
        return replace(state, unknown_since_ns=since_ns).ended("unknown")
    return replace(state, plan=plan, unknown_since_ns=None).ended("accepted")


def _with_evidence(
    state: RetargetingState, given: MotionWindow, settings: RetargetingSettings, now_ns: int
) -> RetargetingState:
    """The state with a running mean of how probable the recognised interaction is; what is unknown counts as 0.

    An offered hand is on its way to one of them, whichever it is.
    """
    probability = 1.0 if given.state == OFFERED else given.probability if given.interaction else 0.0
    known = given.out_of_distribution <= settings.known_below and math.isfinite(probability)
    value = min(max(probability, 0.0), 1.0) if known else 0.0
    elapsed_s = settings.start_evidence_s if state.evidence_ns is None else (now_ns - state.evidence_ns) * 1e-9
    mean_s = settings.start_evidence_s / 2.0
    share = 1.0 - math.exp(-max(elapsed_s, 0.0) / mean_s) if mean_s > 0.0 else 1.0
    evidence = state.evidence + share * (value - state.evidence)
    return replace(state, evidence=evidence, evidence_ns=now_ns)


def take_person(
    state: RetargetingState, given: PersonPose, settings: RetargetingSettings, now_ns: int
) -> RetargetingState:
    """The state after a pose of the person; its outcome is `person` or why the pose was refused."""
    try:
        check_pose(given)
    except DataError as error:
        return state.ended(error.reason)
    age_s = (now_ns - given.stamp_ns) * 1e-9
    if not -settings.max_future_s <= age_s <= settings.max_age_s:
        return state.ended("too_old" if age_s > 0 else "from_future")
    return replace(state.with_sight(now_ns), person=given, person_ns=now_ns).ended("person")


def joint_merger(robot: RobotModel, settings: RetargetingSettings) -> JointMerger:
    """What merges and doubts the robot's own messages."""
    return JointMerger(
        robot.joint_names,
        tuple(robot.velocity_rad_s.tolist()),
        tuple((robot.lower_rad - OUTSIDE_RAD).tolist()),
        tuple((robot.upper_rad + OUTSIDE_RAD).tolist()),
        settings.stale_after_s,
    )


def take_measurement(
    state: RetargetingState,
    given: JointMeasurement,
    merger: JointMerger,
    robot: RobotModel,
    settings: RetargetingSettings,
    now_ns: int,
) -> RetargetingState:
    """The state after the robot said where it is; its outcome is one of `joint_measurements`.

    The first one ends `waiting`. While disabled and at rest the command follows the robot. Otherwise it is watched
    for the robot being elsewhere than commanded.
    """
    disagreed, joints = state.joints.disagree(now_ns), merger.take(state.joints, given, now_ns)
    state = replace(state, joints=joints)
    if joints.disagree(now_ns) and not disagreed:
        state = state.counted("joint_states_disagree")
    if joints.outcome != "measured":
        return state.ended(joints.outcome, joints.detail)
    inside = np.minimum(np.maximum(joints.positions_rad, robot.lower_rad), robot.upper_rad)
    reports = state.measured_ns is not None and (now_ns - state.measured_ns) * 1e-9 <= settings.stale_after_s
    state = replace(
        state,
        measured_rad=tuple(inside.tolist()),
        measured_ns=joints.oldest_ns,
        reports=state.reports or reports,
        silent=False,
        holding_since_ns=now_ns if state.silent else state.holding_since_ns,
    )
    delay_s = settings.execution_delay_s
    under_way = bool(state.pending) and 0.0 <= (now_ns - state.pending[-1][0]) * 1e-9 < delay_s + SETTLING_S
    if state.motion is None or (state.mode is Mode.DISABLED and state.motion.resting and not under_way):
        mode = Mode.IDLE if state.mode is Mode.WAITING else state.mode
        # What comes next is a first command, not one that continues the last.
        state = replace(state, mode=mode, commanded_ns=None, displaced=False, displaced_since_ns=None, pending=())
        return replace(state, motion=JointMotion.at_rest(state.measured_rad)).ended("measured")
    return _watch_displacement(state, state.motion, settings, now_ns).ended("measured")


def _watch_displacement(
    state: RetargetingState, motion: JointMotion, settings: RetargetingSettings, now_ns: int
) -> RetargetingState:
    commanded_rad = state.carried_out(motion, settings.execution_delay_s, now_ns)
    pairs = zip(state.measured_rad, commanded_rad, strict=True)
    away_rad = max(abs(measured - commanded) for measured, commanded in pairs)
    if state.displaced:
        # Half the bound, so that a robot at the bound does not flicker between the two.
        if away_rad > 0.5 * settings.displaced_rad:
            return state
        return replace(state, displaced=False, displaced_since_ns=None, holding_since_ns=now_ns)
    if away_rad <= settings.displaced_rad:
        return replace(state, displaced_since_ns=None)
    since_ns = now_ns if state.displaced_since_ns is None else state.displaced_since_ns
    state = replace(state, displaced_since_ns=since_ns)
    if (now_ns - since_ns) * 1e-9 < settings.displaced_after_s:
        return state
    return replace(state, displaced=True).counted("displaced")


def take_request(state: RetargetingState, given: Request, robot: RobotModel, now_ns: int) -> RetargetingState:
    """The state after an operator's request; its outcome is its past participle."""
    waiting = state.motion is None
    if given.kind == "enable":
        mode = (Mode.WAITING if waiting else Mode.IDLE) if state.mode is Mode.DISABLED else state.mode
        return replace(state, mode=mode).ended("enabled")
    if given.kind in ("hold", "release"):
        held = given.kind == "hold"
        # A hand that is up when the robot is released has to be raised again.
        sight = state.sight.at_rest_here() if state.sight is not None and not held else state.sight
        return replace(state, held=held, sight=sight).ended("held" if held else "released")
    state = replace(state, plan=None, pursuit=None, unknown_since_ns=None, holding_since_ns=now_ns, shown_rad=None)
    if given.kind == "show":
        there = np.array(given.there_rad, dtype=np.float64)
        if there.shape != robot.home_rad.shape or not np.isfinite(there).all():
            return state.ended("wrong_joints", f"shows {given.there_rad}")
        return replace(state, shown_rad=given.there_rad).ended("shown")
    if given.kind == "disable":
        return replace(state, mode=Mode.DISABLED).ended("disabled")
    state = replace(state, displaced=False, displaced_since_ns=None, person=None, sight=None)
    stays = state.mode is Mode.DISABLED or waiting
    return (state if stays else replace(state, mode=Mode.HOLDING)).ended("reset")

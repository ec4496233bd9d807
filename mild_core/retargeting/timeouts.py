# SPDX-License-Identifier: Apache-2.0
"""Whether there is a motion to follow, and what to do when the clock jumps."""

from __future__ import annotations

from dataclasses import replace

from mild_core.joint_measurements import JointTracks
from mild_core.retargeting.limiter import JointMotion
from mild_core.retargeting.modes import Mode
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.state import RetargetingState


def fresh(state: RetargetingState, settings: RetargetingSettings, now_ns: int) -> bool:
    """Whether the newest motion came lately and is about what the person did lately.

    Both, because a stalled network delivers old motions now, and a dead publisher goes unnoticed for 20 s.
    """
    plan = state.plan
    return (
        plan is not None
        and (now_ns - plan.received_ns) * 1e-9 <= settings.stale_after_s
        and (now_ns - plan.stamp_ns) * 1e-9 <= settings.max_age_s
    )


def known(state: RetargetingState, settings: RetargetingSettings, now_ns: int) -> bool:
    """Whether the model knows what the person does, or knew it a moment ago."""
    since_ns = state.unknown_since_ns
    return since_ns is None or (now_ns - since_ns) * 1e-9 <= settings.unknown_after_s


def with_robot_timeout(state: RetargetingState, settings: RetargetingSettings, now_ns: int) -> RetargetingState:
    """The state that notices when a robot which said where it is has ceased to: what it does then is unknown."""
    if state.silent or not state.reports or state.measured_ns is None or state.mode is Mode.DISABLED:
        return state
    if (now_ns - state.measured_ns) * 1e-9 <= settings.stale_after_s:
        return state
    return replace(state, silent=True).counted("robot_silent")


def after_gap(state: RetargetingState, motion: JointMotion, now_ns: int) -> RetargetingState:
    """The state after a long time without a command: the robot has come to rest at the last one.

    To go on with the speed of before would make a resting robot jump.
    """
    if state.mode is Mode.FOLLOWING:
        state = replace(state, mode=Mode.HOLDING, holding_since_ns=now_ns)
    # Measurements during the gap were not processed; restart their timeout.
    heard_ns = None if state.measured_ns is None else now_ns
    return replace(state, measured_ns=heard_ns, motion=JointMotion.at_rest(motion.position_rad)).counted("gap")


def after_time_jump(state: RetargetingState, now_ns: int) -> RetargetingState:
    """The state after the clock went backwards (a bag that starts again): timing starts again.

    The robot knows nothing of it and still moves, so the command keeps its speed and stops smoothly.
    """
    stops = state.mode in (Mode.FOLLOWING, Mode.HOLDING, Mode.RETURNING, Mode.SHOWING)
    return replace(
        state,
        mode=Mode.HOLDING if stops else state.mode,
        commanded_ns=None,
        plan=None,
        pursuit=None,
        unknown_since_ns=None,
        displaced_since_ns=None,
        joints=JointTracks(),
        measured_ns=None if state.measured_ns is None else now_ns,
        person=None,
        sight=None,
        crowd=None if state.crowd is None else replace(state.crowd, stamp_ns=now_ns),
        evidence=0.0,
        evidence_ns=None,
        paused_ns=None,
        holding_since_ns=now_ns,
    ).counted("time_backwards")

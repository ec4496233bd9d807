# SPDX-License-Identifier: Apache-2.0
"""What the state says of the person and of the time: all that the next mode depends on."""

from __future__ import annotations

from dataclasses import replace

from mild_core.retargeting.human_track import LOST_S
from mild_core.retargeting.modes import Mode, Situation
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.start_gate import start_refusal, way_of
from mild_core.retargeting.state import RetargetingState
from mild_core.retargeting.timeouts import fresh, known
from mild_core.shapes import FloatArray


def person_present(state: RetargetingState, settings: RetargetingSettings, now_ns: int) -> bool:
    """Whether a calibrated person was seen lately."""
    return state.sight is not None and (now_ns - state.sight.received_ns) * 1e-9 <= settings.stale_after_s


def with_start(
    state: RetargetingState, settings: RetargetingSettings, shoulder_m: FloatArray, now_ns: int
) -> RetargetingState:
    """The state that knows whether the hand is raised for the robot; while it follows, that was decided before."""
    refusal, doubt, sight = "", "", state.sight
    if sight is not None and sight.raised and state.mode is not Mode.FOLLOWING:
        doubt = state.doubt
        if person_present(state, settings, now_ns):
            if (now_ns - sight.hand_ns) * 1e-9 <= LOST_S:  # where the rest of the arm is agrees with the hand only then
                way = way_of(sight, state.crowd)
                # A hand that went where no greeting goes comes back from there, until it reaches for the robot.
                doubt = "" if way.reaches(settings.start_reach_m) else way.doubt or state.doubt
            known = (state.evidence, state.named)
            refusal = start_refusal(sight, state.crowd, *known, settings, shoulder_m, now_ns) or doubt
    if (refusal, doubt) == (state.start_refusal, state.doubt):
        return state
    before, state = state.start_refusal, replace(state, start_refusal=refusal, doubt=doubt)
    return state.counted(refusal) if refusal not in ("", before) else state


def situation(
    state: RetargetingState, settings: RetargetingSettings, now_ns: int, *, resting: bool, at_home: bool
) -> Situation:
    """What the next mode depends on.

    Args:
        state: Before the command.
        settings: With the time-outs.
        now_ns: Of the command.
        resting: Whether the robot rests.
        at_home: Whether it does so at home.
    """
    present = person_present(state, settings, now_ns)
    # The pose that belongs to a first motion may come after it, at the same time.
    alone = not present and state.had_plan and (state.named or state.mode is Mode.FOLLOWING)
    since_s = (now_ns - state.since_ns) * 1e-9
    held_s = (now_ns - state.holding_since_ns) * 1e-9
    return Situation(
        usable=known(state, settings, now_ns) and fresh(state, settings, now_ns),
        present=present,
        raised=alone or (present and state.sight is not None and state.sight.raised and not state.start_refusal),
        held=state.held,
        displaced=state.displaced,
        silent=state.silent or state.joints.disagree(now_ns),
        at_home=at_home,
        patience_over=resting and held_s >= settings.home_after_s,
        too_long=state.mode is Mode.RETURNING and since_s > settings.home_timeout_s,
        gave_way=state.gave_way,
        shows=state.shown_rad is not None,
    )


def with_rest(state: RetargetingState, settings: RetargetingSettings, now_ns: int) -> RetargetingState:
    """The state in which a hand that is raised but does nothing any more is at rest where it is.

    That is a hand which stays still far from the robot's, or an interaction without an end.
    """
    sight = state.sight
    if state.mode is not Mode.FOLLOWING or sight is None or not sight.raised:
        return state
    # Counted from when the robot set off: it needs time to come near a hand that waits for it.
    still_s = min(sight.still_s(), (now_ns - state.since_ns) * 1e-9)
    if still_s > settings.still_after_s and state.near_m > settings.near_m:
        return replace(state, sight=sight.at_rest_here()).counted("ended_still")
    if (now_ns - state.since_ns) * 1e-9 > settings.interaction_s:
        return replace(state, sight=sight.at_rest_here()).counted("ended_too_long")
    return state

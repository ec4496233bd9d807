# SPDX-License-Identifier: Apache-2.0
"""Why a hand that is held out to the robot is not met, as it is counted and as an operator reads it."""

from __future__ import annotations

from collections.abc import Collection

from mild_core.retargeting.guard import TOO_FAST
from mild_core.retargeting.start_gate import FAR, UNDECIDED, WATCHED

OUT_OF_REACH, GUARDED, UNKNOWN, FAST, LIMITS = (
    "unmet_out_of_reach",
    "unmet_guard",
    "unmet_unknown",
    "unmet_too_fast",
    "unmet_limits",
)
NOT_MEANT, NO_TOUCH = "unmet_not_meant", "unmet_no_touch"

TEXTS = {
    OUT_OF_REACH: "out of reach: the arm does not come there; come nearer or to another side",
    GUARDED: "guard: the arm would come too near to a person or to itself, or be too fast near one",
    UNKNOWN: "unknown: the motion is like none that the model knows; give the interaction, or another model",
    FAST: "too fast: the hand moves faster than the arm may follow",
    LIMITS: "limits: the arm is on its way, as fast as its limits allow",
    NOT_MEANT: "not meant for the robot: the person does not face it, or the hand went elsewhere",
    NO_TOUCH: "no touch: hands do not touch in this interaction, as the model's manifest says under contact",
}
"""For people, by reason."""

SAID_AFTER_S, LATE_AFTER_S = 1.5, 2.2
"""A hand that has been raised for longer should be met; an arm on its way is late only after the second."""

APART_M, PARTED_M = 0.03, 0.15
"""Hands nearer than the first have met, and part at the second: people shake them."""

LASTS_S = 0.5
"""A reason is said when hands have not met for so long."""

FAST_M_S = 0.4
"""A hand that is held out is slower than this."""

STAYS_S = 1.0
"""A reason stays for so long before another takes its place: diagnostics come once a second."""


def not_followed(start_refusal: str) -> str:
    """Why the robot does not follow, by what refused its start."""
    if start_refusal in ("", WATCHED):
        return UNKNOWN if not start_refusal else ""
    return {FAR: OUT_OF_REACH, UNDECIDED: UNKNOWN}.get(start_refusal, NOT_MEANT)


def not_reached(*, beyond: bool, pushed: bool, yielding: bool, refusals: Collection[str], hand_m_s: float) -> str:
    """Why an arm that follows does not come to the hand.

    Args:
        beyond: Whether inverse kinematics finds no way there.
        pushed: Whether the meeting point was pushed out of what must not be touched.
        yielding: Whether the arm gives way to a person.
        refusals: What the guard has counted at this command.
        hand_m_s: Speed of the person's hand.
    """
    if pushed or yielding or any(reason != TOO_FAST for reason in refusals):
        return GUARDED
    if beyond:
        return OUT_OF_REACH
    if hand_m_s > FAST_M_S:
        return FAST
    return GUARDED if refusals else LIMITS

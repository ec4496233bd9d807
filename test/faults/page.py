# SPDX-License-Identifier: Apache-2.0
"""The faults and what came of them, as a page of the documentation."""

from __future__ import annotations

from collections.abc import Sequence

from test.faults.table import STATED_S, Fault
from test.faults.trial import Outcome

HEAD = f"""# Faults and what the robot does

Written by `./mild faults`, which lets all of this happen to real processes that talk over DDS, one fault after the
other, without a restart in between: a fault ends well when the next one finds a robot that follows the person again.
`./mild test test/ros/test_faults.py` runs the same.

In every fault each command is judged: inside the limits of position, velocity, acceleration and jerk, finite, without a
jump, also where the clock jumps. What the robot must do stands in the table: it *rests* within {STATED_S:g} s, if no
other time is named, and stays so until the fault is over, or only makes way for a person who is not seen any more; it
*rests for a while*, until messages come again; it *gives way*, to where it was pushed; or it *goes on* following.
Each fault must raise all of its counters in `/diagnostics`.

Faults of messages and of the clock happen to the `pipeline` in simulated time, so their figures are the same on any
machine; those marked *live* happen in real time to `perception`, `inference`, `retargeting` and `simulation`. One of
these happens again, up to three times in all, where the machine was too busy to do what is written; a broken limit is
never excused.

| Fault | What happens | The robot | at rest after | follows again after | counted in `/diagnostics` |
|---|---|---|---|---|---|
"""

FOOT = """
"Follows again" is counted from the end of the fault. Where it is some seconds, the person is calibrated again and then
raises the hand, or the killed process loads its model.
"""


def page(outcomes: Sequence[Outcome]) -> str:
    """The whole page."""
    return HEAD + "".join(f"{row_start(one.fault)}{_row_end(one)}\n" for one in outcomes) + FOOT


def row_start(fault: Fault) -> str:
    """What a row says of the fault itself."""
    live = ", *live*" if fault.live else ""
    stated = "" if fault.within_s == STATED_S else f" within {fault.within_s:g} s"
    return f"| {fault.name}{live} | {fault.what} | {fault.answer}{stated} |"


def _row_end(outcome: Outcome) -> str:
    """What a row says of what came of it."""
    rested = "" if outcome.rest_s is None else f"{outcome.rest_s:.1f} s"
    recovered = "never" if outcome.recovery_s is None else f"{outcome.recovery_s:.1f} s"
    if outcome.fault.answer == "goes on":
        recovered = "at once" if not outcome.wrong else recovered
    counted = ", ".join(f"`{key}`" for key, rise in outcome.counted.items() if rise > 0)
    return f" {rested} | {recovered} | {counted}{''.join(f' **{line}**' for line in outcome.wrong)} |"

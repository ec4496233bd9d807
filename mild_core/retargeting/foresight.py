# SPDX-License-Identifier: Apache-2.0
"""What will be commanded if nothing more comes: the stage itself, run ahead of time.

Stages are pure, so a look ahead is a fold over ticks that have not come yet; the state that it ends in is forgotten.
"""

from __future__ import annotations

from mild_core.retargeting.stage import Request, Retargeting
from mild_core.retargeting.state import RetargetingState
from mild_core.signals import JointCommand

LONGEST_STOP_S = 3.0
"""No robot of ours needs longer to stop from its greatest speed."""


def foreseen(
    stage: Retargeting, state: RetargetingState, now_ns: int, ahead_s: float, period_s: float
) -> tuple[JointCommand, ...]:
    """The next commands, inside every limit.

    Args:
        stage: Of the robot.
        state: After the newest command.
        now_ns: When that was sent.
        ahead_s: How long to go on as now; then comes a smooth stop.
        period_s: Between two commands.

    Returns:
        Commands at `now_ns` plus multiples of the period, the last of them at rest; none if none would be sent.
    """
    commands: list[JointCommand] = []
    period_ns, at_ns, stopping = round(period_s * 1e9), now_ns, False
    while at_ns < now_ns + round((ahead_s + LONGEST_STOP_S) * 1e9):
        at_ns += period_ns
        if not stopping and at_ns - now_ns > ahead_s * 1e9:
            stopping = True
            state, _ = stage.step(state, Request("disable"), at_ns)
        state, made = stage.step(state, None, at_ns)
        if stopping and not made:
            break
        commands += made
    return tuple(commands)

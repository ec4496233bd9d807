# SPDX-License-Identifier: Apache-2.0
"""How long one tick of retargeting takes: `./mild measure retargeting_tick [--panda FILE]`.

CPU time of the thread for each robot and by what it does, as mean, median and 99th percentile; then of what a tick does
once in contact: the motion wanted, the hands brought together, the planner, the judge. The same ticks are repeated, and
the best time of each counts, so that other programs hardly matter. A second robot file may be measured beside ours.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from mild_core.retargeting.robot_file import find_robot
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.stage import Retargeting, RetargetingInput
from mild_core.shapes import FloatArray
from test.core.retargeting.offering import HIGH, LOW, STANDING, Arms, Offer, learned_hand

PARTS = {
    "motion wanted": ("", "_wanted"),
    "hands together": ("_contact", "aim"),
    "planner": ("_limiter", "toward"),
    "path sampled": ("_limiter", "path"),
    "everyone placed": ("", "_obstacles"),
    "view of a path": ("_guard", "view"),
    "giving way": ("_yielding", "retreat"),
    "speed limited": ("_guard", "limit_speed"),
    "judge": ("_guard", "check_motion"),
}
"""Where in the stage each part is: an attribute of it, "" for itself, and a method."""

Times = dict[str, list[float]]
REPEATED = 7
"""Times that all ticks are taken; the first compiles and does not count."""


def _timed(function: Callable[..., Any], times_us: list[float]) -> Callable[..., Any]:
    def timing(*given: Any, **named: Any) -> Any:
        start_ns = time.thread_time_ns()
        made = function(*given, **named)
        times_us.append((time.thread_time_ns() - start_ns) / 1e3)
        return made

    return timing


def measured(robot: RobotModel, arms: Arms, parts: bool) -> dict[str, FloatArray]:
    """CPU time [us] of each tick by what the robot did, or of each part of it: the best of several."""
    stage = Retargeting(robot, standing=STANDING)
    inputs = list(Offer(robot, learned_hand(robot, arms) + 0.03, arms).inputs())
    _once(stage, inputs)
    times: Times = {name: [] for name in PARTS}
    for name, (owner, method) in PARTS.items() if parts else ():
        at = getattr(stage, owner) if owner else stage
        object.__setattr__(at, method, _timed(getattr(at, method), times[name]))
    whole = [_once(stage, inputs) for _ in range(REPEATED - 1)]
    if parts:
        return {name: np.reshape(each, (len(whole), -1)).min(axis=0) for name, each in times.items()}
    return {what: np.min([each[what] for each in whole], axis=0) for what in whole[0]}


def _once(stage: Retargeting, inputs: list[tuple[int, RetargetingInput]]) -> Times:
    times: Times = {}
    state = stage.init()
    for now_ns, given in inputs:
        start_ns = time.thread_time_ns()
        state, commands = stage.step(state, given, now_ns)
        took_us = (time.thread_time_ns() - start_ns) / 1e3
        if given is None and commands:
            touching = "touching" if state.touch is not None else commands[0].mode
            times.setdefault("every tick", []).append(took_us)
            times.setdefault(touching, []).append(took_us)
    return times


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--panda", help="another robot file, of an arm that stands on a table")
    given = parser.parse_args()
    chosen = [("yumi", LOW), ("pepper", LOW), *([(given.panda, HIGH)] if given.panda else [])]
    for name, arms in chosen:
        robot = find_robot(name)
        for parts in (False, True):
            for what, times_us in measured(robot, arms, parts).items():
                if len(times_us):
                    mean, (median, most) = np.mean(times_us) / 1e3, np.percentile(times_us, [50, 99]) / 1e3
                    rates = f"mean {mean:6.3f} ms  median {median:6.3f} ms  p99 {most:6.3f} ms"
                    print(f"{robot.name:8} {what:16} {len(times_us):5}  {rates}", flush=True)


if __name__ == "__main__":
    main()

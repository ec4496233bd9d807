# SPDX-License-Identifier: Apache-2.0
"""A model that is never wrong: a known motion handed out window by window, as a model that predicts ahead would."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Retargeting, RetargetingState
from mild_core.shapes import FloatArray
from mild_core.signals import JointCommand, JointMeasurement, MotionWindow

MODEL_PERIOD_NS = 25_000_000
TICK_NS = 10_000_000
START_NS = 1_700_000_000_123_456_789
"""An ordinary time of day: a clock that starts at 0 hides rounding."""


def measurement(positions_rad: FloatArray, stamp_ns: int = START_NS) -> JointMeasurement:
    return JointMeasurement(stamp_ns, YUMI.joint_names, positions_rad)


def window(
    rows_rad: FloatArray,
    stamp_ns: int,
    lead_ns: int = MODEL_PERIOD_NS,
    interaction: str = "handshake",
    out_of_distribution: float = 0.2,
    joint_names: tuple[str, ...] = YUMI.joint_names,
    state: str = "named",
    may_start: bool = True,
) -> MotionWindow:
    """A motion window with rows (W, J) at the model's rate."""
    return MotionWindow(
        stamp_ns=stamp_ns,
        lead_ns=lead_ns,
        period_ns=MODEL_PERIOD_NS,
        joint_names=joint_names,
        positions=rows_rad,
        covariance=np.eye(rows_rad[0].size) * 1e-4,
        interaction=interaction,
        probability=0.9 if interaction or state == "offered" else 0.0,
        belief=np.array([0.25, 0.75]),
        phase=0.5,
        out_of_distribution=out_of_distribution,
        state=state,
        may_start=may_start,
    )


@dataclass(frozen=True, eq=False)
class Followed:
    """What became of a motion: the commands and where the motion was at their times."""

    state: RetargetingState
    commands: tuple[JointCommand, ...]
    times_s: FloatArray
    positions_rad: FloatArray
    velocities_rad_s: FloatArray
    wanted_rad: FloatArray

    def error_deg(self) -> float:
        """Root of the mean square over times and joints."""
        return float(np.rad2deg(np.sqrt(np.mean((self.positions_rad - self.wanted_rad) ** 2))))


def follow(
    retargeting: Retargeting, motion: Callable[[float], FloatArray], duration_s: float, tick_ns: int = TICK_NS
) -> Followed:
    """Follow `motion` (seconds from the start -> (J,) positions) for `duration_s`, given one second ahead at 40 Hz."""
    state = retargeting.init()
    state, _ = retargeting.step(state, measurement(motion(0.0)), START_NS)
    commands: list[JointCommand] = []
    for now_ns, given in _inputs(motion, duration_s, tick_ns):
        state, new = retargeting.step(state, given, now_ns)
        commands += new
    times_s = np.array([(command.stamp_ns - START_NS) * 1e-9 for command in commands])
    return Followed(
        state,
        tuple(commands),
        times_s,
        np.array([command.positions_rad for command in commands]),
        np.array([command.velocities_rad_s for command in commands]),
        np.array([motion(time_s) for time_s in times_s]),
    )


def _inputs(
    motion: Callable[[float], FloatArray], duration_s: float, tick_ns: int
) -> Iterator[tuple[int, MotionWindow | None]]:
    end_ns = START_NS + round(duration_s * 1e9)
    ahead_s = np.arange(1, 41) * MODEL_PERIOD_NS * 1e-9
    next_window_ns, next_tick_ns = START_NS, START_NS
    while min(next_window_ns, next_tick_ns) <= end_ns:
        if next_window_ns <= next_tick_ns:
            now_s = (next_window_ns - START_NS) * 1e-9
            yield next_window_ns, window(np.array([motion(now_s + ahead) for ahead in ahead_s]), next_window_ns)
            next_window_ns += MODEL_PERIOD_NS
        else:
            yield next_tick_ns, None
            next_tick_ns += tick_ns


def interpolated(rows_rad: FloatArray, rate_hz: float) -> Callable[[float], FloatArray]:
    """Rows (T, J) as a function of seconds; clamped to its ends."""

    def motion(time_s: float) -> FloatArray:
        place = min(max(time_s * rate_hz, 0.0), len(rows_rad) - 1.0)
        before = min(int(place), len(rows_rad) - 2)
        between: FloatArray = rows_rad[before] + (place - before) * (rows_rad[before + 1] - rows_rad[before])
        return between

    return motion

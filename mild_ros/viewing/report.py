# SPDX-License-Identifier: Apache-2.0
"""What a recorded run shows in numbers: ages, rates, losses, limits, errors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray
from mild_ros.messages.handled import Handled
from mild_ros.replay.recorded import JointTrack, RecordedRun

FOLLOWING_NS = 500_000_000
"""A command later than this after the last answer is based on no skeleton: the robot holds or goes home."""

ROUNDING = 1e-6
"""Relative room for the rounding of stamps to nanoseconds and of values to float64."""


@dataclass(frozen=True)
class Limits:
    """Largest share of each limit that the commands used; up to 1 the limit is kept.

    Attributes:
        position: 0 in the middle of a joint's range, 1 at its end.
        velocity: Of commands, as they say and from one to the next.
        acceleration: From one command's velocity to the next.
    """

    position: float
    velocity: float
    acceleration: float

    @property
    def kept(self) -> bool:
        """Whether all are."""
        return max(self.position, self.velocity, self.acceleration) <= 1.0 + ROUNDING


@dataclass(frozen=True, eq=False)
class Report:
    """The numbers of a run.

    Attributes:
        answer_ages_ms: (A,) from a skeleton's stamp to the arrival of the first command based on it.
        command_ages_ms: (C,) the same for every command that is based on a skeleton: its newest one.
        sent_ages_ms: What the pipeline says of its answers' ages when it sent them: the usual second's median, the
            worst second's 99th percentile, and the greatest; None when it said nothing.
        rates_hz: Messages per second by topic.
        outcomes: Number of tracker messages, by outcome.
        dropped: Tracker messages that were recorded but that the stages never saw; None when unknown.
        unrecorded: Tracker messages that the stages saw and the recorder did not.
        commands: How many were sent.
        limits: None without commands.
        error_deg: Root mean square of commanded less true joints; None where the truth is unknown.
        predicted_error_deg: The same of predicted joints.
        jumps: Commands whose stamp is not later than the one before.
    """

    answer_ages_ms: FloatArray
    command_ages_ms: FloatArray
    sent_ages_ms: tuple[float, float, float] | None
    rates_hz: Mapping[str, float]
    outcomes: Mapping[str, int]
    dropped: int | None
    limits: Limits | None
    error_deg: float | None
    predicted_error_deg: float | None
    jumps: int = 0
    unrecorded: int = 0
    commands: int = 0


def make_report(run: RecordedRun, robot: RobotModel) -> Report:
    """All figures of a run."""
    commands = run.commands.of(robot.joint_names) if run.commands else None
    answers, ages = _ages(run)
    seen = [handled for handled in run.outcomes if _is_of_tracker(handled)]
    return Report(
        answer_ages_ms=answers,
        command_ages_ms=ages,
        sent_ages_ms=_published_ages(run),
        rates_hz=_rates(run),
        outcomes=dict(Counter(handled.outcome for handled in seen)),
        dropped=max(len(run.tracker_arrived_ns) - len(seen), 0) if seen else None,
        unrecorded=max(len(seen) - len(run.tracker_arrived_ns), 0),
        limits=None if commands is None or len(commands.stamps_ns) < 3 else used_limits(commands, robot),
        error_deg=_error(run, robot, predicted=False),
        predicted_error_deg=_error(run, robot, predicted=True),
        commands=0 if commands is None else len(commands.stamps_ns),
        jumps=0 if commands is None else int((np.diff(commands.stamps_ns) <= 0).sum()),
    )


def used_limits(commands: JointTrack, robot: RobotModel) -> Limits:
    """How much of each limit was used; velocities as announced and as differences, accelerations as differences."""
    positions, velocities = commands.positions_rad, commands.velocities_rad_s
    elapsed_s = np.diff(commands.stamps_ns)[:, None] * 1e-9
    whole = (elapsed_s > 0.0).ravel()
    middle, half = (robot.upper_rad + robot.lower_rad) / 2.0, (robot.upper_rad - robot.lower_rad) / 2.0
    moved = np.abs(np.diff(positions, axis=0))[whole] / elapsed_s[whole] / robot.velocity_rad_s
    announced = np.abs(velocities) / robot.velocity_rad_s
    pushed = np.abs(np.diff(velocities, axis=0))[whole] / elapsed_s[whole] / robot.acceleration_rad_s2
    return Limits(
        position=float((np.abs(positions - middle) / half).max()),
        velocity=float(max(moved.max(), announced.max())),
        acceleration=float(pushed.max()),
    )


def _is_of_tracker(handled: Handled) -> bool:
    """Whether it is the outcome of a tracker's message."""
    return handled.stage in ("perception", "pipeline")


def _ages(run: RecordedRun) -> tuple[FloatArray, FloatArray]:
    """Ages of answers and of all commands [ms], at their arrival in the recording.

    Commands are sent at ticks, whose outcomes are published, and at once after a skeleton: those whose stamp is no
    tick's. The last ticks' outcomes are published after the recording has ended, so nothing is an answer to a skeleton
    of long ago.
    """
    ticks = {handled.stamp_ns for handled in run.outcomes if handled.outcome == "tick"}
    skeletons = np.array([person.stamp_ns for person in run.people], dtype=np.int64)
    answers, ages, behind_ns, answered_ns = [], [], 0, -FOLLOWING_NS
    if run.commands is None or not ticks:
        return np.zeros(0), np.zeros(0)
    last_tick_ns = max(ticks)
    for stamp_ns, arrived_ns in zip(run.commands.stamps_ns.tolist(), run.commands.arrived_ns.tolist(), strict=True):
        newest = int(np.searchsorted(skeletons, stamp_ns, side="right")) - 1
        near = newest >= 0 and stamp_ns - skeletons[newest] < FOLLOWING_NS
        if stamp_ns not in ticks and near and stamp_ns < last_tick_ns:  # later outcomes were not recorded any more
            behind_ns, answered_ns = int(skeletons[newest]), stamp_ns
            answers.append((arrived_ns - behind_ns) * 1e-6)
        if stamp_ns - answered_ns < FOLLOWING_NS:
            ages.append((arrived_ns - behind_ns) * 1e-6)
    return np.array(answers), np.array(ages)


def _published_ages(run: RecordedRun) -> tuple[float, float, float] | None:
    """Source: the values "age of an answer p50 [ms]" and so on of the pipeline's diagnostics."""
    keys = [f"age of an answer {name} [ms]" for name in ("p50", "p99", "max")]
    seconds = [values for reports in run.diagnostics.values() for values in reports if keys[0] in values]
    if not seconds:
        return None
    middle, high, greatest = ([float(values[key]) for values in seconds] for key in keys)
    return float(np.median(middle)), max(high), max(greatest)


def _rates(run: RecordedRun) -> dict[str, float]:
    rates = {}
    for name, times in (
        ("skeleton", run.tracker_arrived_ns),
        ("motion", np.array([motion.stamp_ns for motion in run.motions])),
        ("joint_command", run.commands.stamps_ns if run.commands else np.zeros(0)),
        ("joint_states", run.measured.stamps_ns if run.measured else np.zeros(0)),
    ):
        if len(times) > 1 and times[-1] > times[0]:
            rates[name] = (len(times) - 1) * 1e9 / float(times[-1] - times[0])
    return rates


def _error(run: RecordedRun, robot: RobotModel, *, predicted: bool) -> float | None:
    """Root mean square over joints and the true motion's frames [deg]; from the first motion to the last."""
    if run.truth is None or not run.motions or (run.commands is None and not predicted):
        return None
    truth = run.truth.of(robot.joint_names)
    first, last = run.motions[0].stamp_ns, run.motions[-1].stamp_ns
    shared = (truth.stamps_ns >= first) & (truth.stamps_ns <= last)
    stamps = truth.stamps_ns[shared]
    if not len(stamps):
        return None
    if predicted:
        if run.motions[0].positions.ndim != 2:  # a partner's arm, which has no joints
            return None
        said = np.stack([_newest_said(run, robot, int(stamp)) for stamp in stamps])
    else:
        assert run.commands is not None
        said = run.commands.of(robot.joint_names).at(stamps)
    return float(np.degrees(np.sqrt(np.mean((said - truth.positions_rad[shared]) ** 2))))


def _newest_said(run: RecordedRun, robot: RobotModel, stamp_ns: int) -> FloatArray:
    """What the newest motion known at a time says about that time."""
    stamps = [motion.stamp_ns for motion in run.motions]
    motion = run.motions[max(int(np.searchsorted(stamps, stamp_ns, side="right")) - 1, 0)]
    rows_ns = motion.stamp_ns + motion.lead_ns + motion.period_ns * np.arange(len(motion.positions))
    columns = [motion.joint_names.index(name) for name in robot.joint_names]
    return np.array([np.interp(stamp_ns, rows_ns, motion.positions[:, column]) for column in columns])

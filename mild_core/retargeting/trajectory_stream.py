# SPDX-License-Identifier: Apache-2.0
"""Commands as a stream of trajectories, for a controller that replaces what it plays by every message that comes.

A controller plays a message some time after it was made, and the latency differs from message to message. The motion
that it plays is continuous only if the old and the new message are the same at the moment of the exchange. So each
command is a promise: it is carried out `execution_delay_s` later, and never taken back. A message holds

1. the promised points, from `PAST_S` before now to `execution_delay_s` after now;
2. then the fastest stop. The guard has examined this stop together with the command. The next message replaces it.

For an exchange at time t no later than latency and one controller period after the new message was made, both messages
agree around t as long as the messages between them (lost ones, and ones that were never made because this process was
late) span at most `FREE_S`. When this process is late by more than `COVERED_GAP_S`, the robot
is already carrying out the stop of the last message, and the stage goes on from there: see `resumed`.

A stream begins with one point at rest, `STAND_S` ahead, and the commands stand still until then. What the controller
holds before may be elsewhere than where the robot says it is: a robot sags, or was switched off and moved. Up to a
point in the future a controller interpolates by itself, from what it holds; meanwhile it is sent nothing.

The points are the commands themselves. Between points a controller interpolates with cubic polynomials. Where the jerk
of the commands changes between two points, the acceleration of the cubic exceeds theirs by at most
4/27 * jerk * period (the error of a best linear fit to a kinked acceleration). `limits_between_points` leaves room.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mild_core.retargeting.limiter import JointMotion, Joints, Limiter, NoPlanError
from mild_core.shapes import FloatArray, read_only

TICK_S = 0.01
"""Time between points: a period of the control clock at its default and least rate."""

LONGEST_STEP_S = 0.0125
"""A longer step between two commands gets points in between."""

LEAST_STEP_S = 0.005
"""A command that follows the one before in less takes its place, unless that makes a step too long."""

MESSAGE_PERIOD_S = 0.0075
"""Least time between messages: one per tick, but none for a command that a motion causes right after one."""

CONTROLLER_PERIOD_S = 0.01
"""Of the slowest controller: it takes a message at its next update and plays it from one period later."""

SPARE_S = 0.06
"""Time that a command is made earlier than latency alone requires: a controller period, and three lost messages."""

FREE_S = SPARE_S - CONTROLLER_PERIOD_S
"""The end of what is promised that no controller plays yet when it gets the next message, if none is lost."""

COVERED_GAP_S = 0.025
"""After a longer time without a command the robot is assumed to have started the stop in the last message."""

STAND_S = 0.5
"""How long the commands of a new stream stand still. After latency 0.4 s are left: a controller that holds the robot
0.3 rad away from where it is needs 11 rad/s^2 on the way, and twice that in its first period."""

PAST_S = 0.03
"""So much of the past is in each message: the clock of the controller may be behind ours by this."""

ACCELERATION_SHARE, JERK_PER_ACCELERATION = 0.97, 20.0
"""Commands use this share of the acceleration limit, and at most so much jerk per acceleration [1/s]."""

SAME_RAD = 1e-6
"""Rounding of positions over a step."""


def execution_delay_s(max_latency_s: float, trajectory_s: float = 0.0) -> float:
    """Time from a command to its execution, in whole ticks.

    Args:
        max_latency_s: Of messages to the controller, at most.
        trajectory_s: How far ahead to promise at least.
    """
    return math.ceil(round(max(max_latency_s + SPARE_S, trajectory_s) / TICK_S, 6)) * TICK_S


def limits_between_points(acceleration_rad_s2: FloatArray, jerk_rad_s3: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(J,) limits of acceleration and jerk for commands whose cubic interpolation keeps the given limits."""
    return acceleration_rad_s2 * ACCELERATION_SHARE, np.minimum(
        jerk_rad_s3, acceleration_rad_s2 * JERK_PER_ACCELERATION
    )


def resumed(limiter: Limiter, motion: JointMotion, elapsed_s: float) -> tuple[JointMotion, float]:
    """The motion that the next command continues, and for how long, `elapsed_s` after the command `motion`.

    After a gap it is the stop of the last message, one tick ago: what the robot is going to do anyway.
    """
    if elapsed_s <= COVERED_GAP_S:
        return motion, elapsed_s
    try:
        return limiter.stop(motion, elapsed_s - TICK_S), TICK_S
    except NoPlanError:
        return JointMotion.at_rest(motion.position_rad), TICK_S


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A message for a controller.

    Attributes:
        stamp_ns: Time of the first point: now or before.
        offsets_ns: (N,) times of the points after that; they increase strictly from 0.
        positions_rad: (N, J).
        velocities_rad_s: (N, J); zero at the last point.
    """

    stamp_ns: int
    offsets_ns: tuple[int, ...]
    positions_rad: FloatArray
    velocities_rad_s: FloatArray


@dataclass(frozen=True)
class TrajectoryState:
    """What has been promised.

    Attributes:
        times_ns: Of the commands, oldest first; each is carried out `execution_delay_s` later.
        motions: The commands.
        sent_ns: When the newest message was made; None before the first.
        stands_until_ns: When the controller has to be where the stream begins; None from then on.
    """

    times_ns: tuple[int, ...] = ()
    motions: tuple[JointMotion, ...] = ()
    sent_ns: int | None = None
    stands_until_ns: int | None = None


@dataclass(frozen=True, eq=False)
class TrajectoryStream:
    """Makes messages of commands.

    Attributes:
        limiter: With the limits of the commands.
        velocity_rad_s: J largest speeds: a command that is further away than these allow starts a new stream.
        acceleration_rad_s2: J largest accelerations.
        delay_s: From a command to its execution.
    """

    limiter: Limiter
    velocity_rad_s: Joints
    acceleration_rad_s2: Joints
    delay_s: float

    def init(self) -> TrajectoryState:
        """The state before the first command."""
        return TrajectoryState()

    def step(
        self, state: TrajectoryState, motion: JointMotion, now_ns: int
    ) -> tuple[TrajectoryState, Trajectory | None]:
        """Promise a command that was made now; returns the message that is due, or None."""
        if state.stands_until_ns is not None:
            left_ns, start, begin_ns = state.stands_until_ns - now_ns, state.motions[0], state.times_ns[0]
            if left_ns > 0 and _stands(motion, start) and left_ns <= STAND_S * 1e9:
                if now_ns > begin_ns:
                    state = replace(state, times_ns=(begin_ns, now_ns), motions=(start, start))
                return state, None
            # If it moves too soon, or time goes back, the stream starts again.
            state = replace(state, stands_until_ns=None) if left_ns <= 0 else TrajectoryState()
        state = self._promised(state, motion, now_ns)
        if state.stands_until_ns is not None:
            return replace(state, sent_ns=now_ns), self._message(state)
        state = self._trimmed(state, now_ns)
        if state.sent_ns is not None and 0 <= now_ns - state.sent_ns < MESSAGE_PERIOD_S * 1e9:
            return state, None
        return replace(state, sent_ns=now_ns), self._message(state)

    def _promised(self, state: TrajectoryState, motion: JointMotion, now_ns: int) -> TrajectoryState:
        if not state.times_ns:
            return self._start(motion, now_ns)
        times, motions = state.times_ns, state.motions
        if now_ns < times[-1]:  # the clock was set back, and the motion goes on
            shift_ns = now_ns - times[-1]
            times = tuple(time_ns + shift_ns for time_ns in times)
        last = motions[-1]
        elapsed_s = (now_ns - times[-1]) * 1e-9
        before, step_s = resumed(self.limiter, last, elapsed_s)
        steps = [now - then for now, then in zip(motion.position_rad, before.position_rad, strict=True)]
        free_ns = now_ns - _ns(FREE_S)
        if last.resting and motion.resting and times[-1] < free_ns and max(map(abs, steps)) > SAME_RAD:
            if self._bridges(steps):
                return TrajectoryState((*times, free_ns, now_ns), (*motions, before, motion), state.sent_ns)
            return self._start(motion, now_ns)
        if any(abs(way) > 1.1 * most * step_s + SAME_RAD for way, most in zip(steps, self.velocity_rad_s, strict=True)):
            return self._start(motion, now_ns)
        if before is not last:
            stop_times, stop_motions = self._stop_points(times[-1], last, now_ns - _ns(TICK_S), before)
            times, motions = (*times, *stop_times), (*motions, *stop_motions)
        elif elapsed_s > LONGEST_STEP_S:
            between = _between(last, motion, elapsed_s)
            times = (*times, *(times[-1] + _ns(at_s) for at_s, _ in between))
            motions = (*motions, *(each for _, each in between))
        elif elapsed_s == 0.0 or (
            # A flood of commands makes no flood of points.
            elapsed_s < LEAST_STEP_S and len(times) > 1 and now_ns - times[-2] <= LONGEST_STEP_S * 1e9
        ):
            times, motions = times[:-1], motions[:-1]
        return TrajectoryState((*times, now_ns), (*motions, motion), state.sent_ns)

    def _start(self, motion: JointMotion, now_ns: int) -> TrajectoryState:
        """A new stream: the robot stands where it is until the first command is carried out."""
        at_rest = JointMotion.at_rest(motion.position_rad)
        if motion.resting:
            stands_until_ns = now_ns + _ns(STAND_S)
            return TrajectoryState((stands_until_ns - _ns(self.delay_s),), (at_rest,), None, stands_until_ns)
        first_ns = min(max(now_ns - _ns(PAST_S), 1), now_ns + 1) - _ns(self.delay_s)
        return TrajectoryState((first_ns, now_ns), (at_rest, motion))

    def _bridges(self, ways_rad: list[float]) -> bool:
        """Whether cubics get from rest to rest in `FREE_S` inside the limits.

        A robot that was switched off for a while is commanded from where it says it is, and that differs a little from
        where it was sent before.
        """
        ways = zip(map(abs, ways_rad), self.velocity_rad_s, self.acceleration_rad_s2, strict=True)
        return all(1.5 * way <= speed * FREE_S and 6.0 * way <= most * FREE_S**2 for way, speed, most in ways)

    def _stop_points(
        self, time_ns: int, motion: JointMotion, end_ns: int, end: JointMotion
    ) -> tuple[list[int], list[JointMotion]]:
        """Points of the stop after a command at `time_ns`: those that were sent, and the last one at `end_ns`."""
        stop, period_ns = self._stop(motion), _ns(TICK_S)
        points = [(time_ns + (number + 1) * period_ns, each) for number, each in enumerate(stop)]
        # A point just before the end would nearly coincide with it.
        kept = [(at_ns, each) for at_ns, each in points if at_ns < end_ns - 0.1 * period_ns]
        kept.append((end_ns, end))
        return [at_ns for at_ns, _ in kept], [each for _, each in kept]

    def _stop(self, motion: JointMotion) -> tuple[JointMotion, ...]:
        try:
            return self.limiter.stopping(motion, TICK_S)
        except NoPlanError:
            return (JointMotion.at_rest(motion.position_rad),)

    def _trimmed(self, state: TrajectoryState, now_ns: int) -> TrajectoryState:
        """Without points that are carried out; one from before `PAST_S` ago stays."""
        past_ns = now_ns - _ns(self.delay_s + PAST_S)
        first = max((index for index, time_ns in enumerate(state.times_ns) if time_ns <= past_ns), default=0)
        return replace(state, times_ns=state.times_ns[first:], motions=state.motions[first:])

    def _message(self, state: TrajectoryState) -> Trajectory:
        stop = self._stop(state.motions[-1])
        period_ns = _ns(TICK_S)
        motions = (*state.motions, *stop)
        times = (*state.times_ns, *(state.times_ns[-1] + (number + 1) * period_ns for number in range(len(stop))))
        # A time that is negative, or zero for "now", is none to a controller: right after the start of a simulation.
        first = next(
            (index for index, time_ns in enumerate(times[:-1]) if time_ns + _ns(self.delay_s) > 0), len(times) - 1
        )
        times, motions = times[first:], motions[first:]
        # Where nothing moves two points are enough.
        kept = [
            index
            for index in range(len(times))
            if index in (0, len(times) - 1) or not _same(motions[index - 1 : index + 2])
        ]
        return Trajectory(
            stamp_ns=times[0] + _ns(self.delay_s),
            offsets_ns=tuple(times[index] - times[0] for index in kept),
            positions_rad=read_only(np.array([motions[index].position_rad for index in kept])),
            velocities_rad_s=read_only(np.array([motions[index].velocity_rad_s for index in kept])),
        )


def _stands(motion: JointMotion, start: JointMotion) -> bool:
    """Whether a command is at rest where the stream began."""
    return motion.resting and motion.position_rad == start.position_rad


def _same(motions: tuple[JointMotion, ...]) -> bool:
    """Whether all of them stand at the same place."""
    first = motions[0].position_rad
    return all(each.position_rad == first and not any(each.velocity_rad_s) for each in motions)


def _between(before: JointMotion, after: JointMotion, elapsed_s: float) -> list[tuple[float, JointMotion]]:
    """Points inside a long step, by the quintic polynomial that both ends determine; times [s] after `before`."""
    start = np.array([before.position_rad, before.velocity_rad_s, before.acceleration_rad_s2])
    end = np.array([after.position_rad, after.velocity_rad_s, after.acceleration_rad_s2])
    powers = np.arange(6)
    first = np.vander([0.0, elapsed_s], 6, increasing=True)
    second = np.zeros((2, 6))
    second[:, 1:] = powers[1:] * first[:, :-1]
    third = np.zeros((2, 6))
    third[:, 2:] = powers[2:] * powers[1:-1] * first[:, :-2]
    rows = np.stack([first, second, third], axis=1).reshape(6, 6)
    coefficients = np.linalg.solve(rows, np.concatenate([start, end]))
    count = math.ceil(2.0 * elapsed_s / TICK_S)
    made = []
    for number in range(1, count):
        at_s = elapsed_s * number / count
        power = at_s**powers
        derived = np.zeros((3, 6))
        derived[0], derived[1, 1:] = power, powers[1:] * power[:-1]
        derived[2, 2:] = powers[2:] * powers[1:-1] * power[:-2]
        made.append((at_s, JointMotion(*(tuple(row.tolist()) for row in derived @ coefficients))))
    return made


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)

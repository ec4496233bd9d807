# SPDX-License-Identifier: Apache-2.0
"""An independent model of how ros2_control's JointTrajectoryController plays a stream of messages.

It knows the messages alone, nothing of what made them. Source: `JointTrajectoryController::update` and
`Trajectory::sample` of ros2_controllers (Jazzy):

- each update takes the newest message that has come; it replaces the one before;
- the first sample of a message remembers a state before it: the measured one now, or with
  `interpolate_from_desired_state` the last command and when it was given;
- up to the first point it interpolates from there; a first point that is not in the future is sampled directly;
- between points with velocities it is cubic, after the last point it stays there;
- what is written at an update is the sample one period later;
- a message that ends in the past is rejected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.shapes import FloatArray


@dataclass(frozen=True, eq=False)
class Sent:
    """A message as a controller reads it.

    Attributes:
        sent_s: When it left.
        times_s: (N,) of its points, its stamp included.
        positions_rad: (N, J).
        velocities_rad_s: (N, J).
    """

    sent_s: float
    times_s: FloatArray
    positions_rad: FloatArray
    velocities_rad_s: FloatArray


@dataclass(frozen=True)
class Setting:
    """What a controller and its surroundings may differ in.

    Attributes:
        rate_hz: Of its updates.
        latency_s: (least, most) time from a message's leaving to its arrival, drawn for each message.
        from_desired: `interpolate_from_desired_state`.
        lag_s: The measured state is the command of so long ago.
        lost: Share of the messages that never arrive.
        seed: Of what is drawn.
    """

    rate_hz: float = 250.0
    latency_s: tuple[float, float] = (0.0, 0.0)
    from_desired: bool = False
    lag_s: float = 0.0
    lost: float = 0.0
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Played:
    """What the controller commanded.

    Attributes:
        times_s: (N,) of its updates.
        positions_rad: (N, J) written at each.
        rate_hz: Of its updates.
        late: Messages whose first point was still in the future when they were first sampled.
        rejected: Messages that ended in the past.
    """

    times_s: FloatArray
    positions_rad: FloatArray
    rate_hz: float
    late: int
    rejected: int

    @property
    def velocities_rad_s(self) -> FloatArray:
        """(N - 1, J): means over one period, so that what is bounded at each moment is bounded here."""
        return np.diff(self.positions_rad, axis=0) * self.rate_hz

    @property
    def accelerations_rad_s2(self) -> FloatArray:
        """(N - 2, J): weighted means over two periods."""
        return np.diff(self.positions_rad, n=2, axis=0) * self.rate_hz**2


def play(messages: Sequence[Sent], start_rad: FloatArray, setting: Setting, after_s: float = 3.0) -> Played:
    """What a controller that stands at `start_rad` makes of a stream, to `after_s` after its last message."""
    random = np.random.default_rng(setting.seed)
    period_s, first_s = 1.0 / setting.rate_hz, messages[0].sent_s - 0.1
    updates = np.arange(first_s + random.uniform(0.0, period_s), messages[-1].sent_s + after_s, period_s)
    commands = np.tile(start_rad, (len(updates), 1))
    delay = round(setting.lag_s * setting.rate_hz) + 1
    late = 0
    taken, rejected = _taken(messages, updates, setting, random)
    for message, begin, end in taken:
        now_s = updates[begin]
        late += bool(message.times_s[0] > now_s)
        before = _state(commands, begin, 1 if setting.from_desired else delay, setting.rate_hz)
        before_s = updates[max(begin - 1, 0)] if setting.from_desired else now_s
        commands[begin:end] = sampled(message, (before_s, *before), updates[begin:end] + period_s)
    return Played(updates, commands, setting.rate_hz, late, rejected)


def sampled(message: Sent, before: tuple[float, FloatArray, FloatArray], times_s: FloatArray) -> FloatArray:
    """(N, J) positions at `times_s` (N,); `before`: time, positions and velocities before the message's first point."""
    at, positions, velocities = message.times_s, message.positions_rad, message.velocities_rad_s
    if at[0] > times_s[0] and at[0] > before[0]:
        at = np.concatenate([[before[0]], at])
        positions = np.concatenate([before[1][None], positions])
        velocities = np.concatenate([before[2][None], velocities])
    if len(at) == 1:
        return np.tile(positions[0], (len(times_s), 1))
    inside = np.clip(times_s, at[0], at[-1])
    index = np.clip(np.searchsorted(at, inside, side="right") - 1, 0, len(at) - 2)
    span = np.diff(at)[index][:, None]
    u = (inside - at[index])[:, None] / span
    made: FloatArray = (
        (2 * u**3 - 3 * u**2 + 1) * positions[index]
        + (u**3 - 2 * u**2 + u) * span * velocities[index]
        + (3 * u**2 - 2 * u**3) * positions[index + 1]
        + (u**3 - u**2) * span * velocities[index + 1]
    )
    return made


def _taken(
    messages: Sequence[Sent], updates: FloatArray, setting: Setting, random: np.random.Generator
) -> tuple[list[tuple[Sent, int, int]], int]:
    """Each message that is played, from which update to which; and how many are rejected."""
    latency = random.uniform(*setting.latency_s, len(messages))
    # Messages do not overtake each other: the newest one replaces what came before.
    arrivals = np.maximum.accumulate(np.array([each.sent_s for each in messages]) + latency)
    kept = np.flatnonzero(random.uniform(size=len(messages)) >= setting.lost)
    valid = [k for k in kept if messages[k].times_s[-1] >= arrivals[k]]
    first = np.searchsorted(updates, arrivals[valid])
    ends = [*first[1:], len(updates)]
    each = zip(valid, first, ends, strict=True)
    return [(messages[k], begin, end) for k, begin, end in each if begin < end], len(kept) - len(valid)


def _state(commands: FloatArray, index: int, delay: int, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities so many updates ago."""
    at = max(index - delay, 0)
    return commands[at], (commands[at] - commands[max(at - 1, 0)]) * rate_hz

# SPDX-License-Identifier: Apache-2.0
"""One fault after the other in the same processes, and what came of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mild_core.shapes import FloatArray
from mild_ros.faults.judge import problems
from mild_ros.faults.live_room import LiveRoom
from mild_ros.faults.replayed_room import ReplayedRoom
from mild_ros.faults.room import ROBOT, Room
from mild_ros.faults.table import Fault
from mild_ros.processes import Nodes

RECOVERY_S = 30.0
"""Within this time all is well again. A person who is calibrated anew needs four seconds, a node that is started as
many; a busy machine makes it longer."""

BESIDE_RAD = 0.2
"""A command so near to where the robot was pushed has given way: half of what counts as displaced."""


A_WHILE_NS = 250_000_000
"""Who does not move for so long has come to rest."""


@dataclass(frozen=True)
class Outcome:
    """What came of a fault.

    Attributes:
        fault: The fault.
        wrong: All that went wrong, for people; empty when the system survived it.
        rest_s: How long after its begin the robot moved last, or when it ceased to follow before giving way; None
            when it went on.
        recovery_s: How long after its end the robot followed again; None when it never did.
        counted: How much each of the fault's counters rose.
        commands: How many commands were judged.
    """

    fault: Fault
    wrong: tuple[str, ...]
    rest_s: float | None
    recovery_s: float | None
    counted: Mapping[str, int]
    commands: int


@contextmanager
def running_room(live: bool, log_folder: Path, domain: int) -> Iterator[Room]:
    """A room whose robot follows its person.

    Raises:
        SetupError: The nodes do not start.
    """
    with Nodes(domain, log_folder) as nodes, (LiveRoom if live else ReplayedRoom)(nodes, domain) as room:
        room.begin()
        room.read_reports()
        yield room


def tried(room: Room, fault: Fault) -> Outcome:
    """Let a fault happen to a robot that follows, and wait until all is well again."""
    if not room.until(lambda: room.follows, RECOVERY_S):
        return Outcome(fault, ("the robot did not follow before it",), None, None, {}, 0)
    first, before = len(room.commands), room.counts()
    with room.suffering(fault) as begun_ns:
        end_ns = begun_ns + round(fault.lasts_s * 1e9)
        room.until(lambda: room.now_ns() >= end_ns, 2.0 * fault.lasts_s)
        put_rad = room.heard_rad
    ended_ns, last = room.now_ns(), len(room.commands)
    recovered = room.until(lambda: room.now_ns() > ended_ns and room.follows, RECOVERY_S)
    recovery_s = (room.now_ns() - ended_ns) * 1e-9 if recovered else None
    room.read_reports()
    after = room.counts()
    counted = {key: after.get(key, 0) - before.get(key, 0) for key in fault.counted}
    wrong = problems(ROBOT, room.commands[max(first - 3, 0) :])
    wrong += [f"{key} was not counted" for key, rise in counted.items() if rise <= 0]
    wrong += [] if recovered else [f"no recovery within {RECOVERY_S:g} s: {room.mode}"]
    rest_s, complaint = _answer(room, fault, begun_ns, ended_ns, slice(first, last), put_rad)
    wrong += [complaint] if complaint else []
    return Outcome(fault, tuple(wrong), rest_s, recovery_s, counted, len(room.commands) - first)


def _answer(
    room: Room, fault: Fault, begun_ns: int, ended_ns: int, during: slice, put_rad: FloatArray
) -> tuple[float | None, str]:
    """When the robot rested, and what is wrong with how it answered; "" for nothing."""
    left_ns = next((at for at, mode in room.modes if begun_ns < at <= ended_ns and mode != "following"), None)
    moving_ns = [command.stamp_ns for command in room.commands[during] if command.moves]
    if fault.answer == "goes on":
        if left_ns is not None:
            return None, f"the robot stopped following after {(left_ns - begun_ns) * 1e-9:.2f} s"
        return None, "" if moving_ns else "the robot did not move"
    if fault.answer == "gives way":
        way = [np.abs(np.subtract(command.positions_rad, put_rad)).max() for command in room.commands[during]]
        rest_s = None if left_ns is None else (left_ns - begun_ns) * 1e-9
        if not way or min(way) > BESIDE_RAD:
            return rest_s, "the robot does not go where it was put"
    else:
        if fault.answer == "rests for a while":
            moving_ns = moving_ns[
                : next((place for place, ns in enumerate(np.diff(moving_ns)) if ns > A_WHILE_NS), 0) + 1
            ]
        rest_s = max(0.0, (max(moving_ns, default=begun_ns) - begun_ns) * 1e-9)
    if rest_s is None or rest_s > fault.within_s:
        return rest_s, f"not at rest within {fault.within_s:g} s, but after {rest_s or fault.lasts_s:.2f} s"
    return rest_s, ""

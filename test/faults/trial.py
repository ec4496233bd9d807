# SPDX-License-Identifier: Apache-2.0
"""One fault after the other in the same processes, and what came of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from mild_core.shapes import FloatArray
from mild_ros.environment.processes import Nodes, private_domain
from test.faults.fault_bench import ROBOT, FaultBench
from test.faults.judge import Command, problems
from test.faults.live_fault_bench import LiveFaultBench
from test.faults.replayed_fault_bench import ReplayFaultBench
from test.faults.table import Answer, Fault

RECOVERY_S = 30.0
"""Longest time to recover. Recalibrating a person takes four seconds, a node that is started as
many; a busy machine makes it longer."""

BESIDE_RAD = 0.2
"""A command so near to where the robot was pushed has given way: half of what counts as displaced."""

HINDERED = 0.5
"""An arm that a person blocks has given way after this share of the way there."""

STOP_S, WAY_RAD = 0.3, 0.6
"""So long after it ceased to follow, an arm that makes way for a person who is not seen any more turns no joint by more
than this: their radius grows by 0.2 m at most, which is so much at a lever of a third of a metre. Of 50 faults tried
out of step the most was 0.42."""

TRIES, PAUSE_S = 3, 0.1
"""A fault is tried again after this process had to stand still for longer than this ..."""

OTHER_STOPS = tuple(f"retargeting {why}" for why in ("gap", "displaced", "robot_silent", "held_unknown"))
"""... or after the robot stopped for one of these reasons, unless they are the fault's own: other processes had to."""

A_WHILE_NS = 250_000_000
"""Who does not move for so long has come to rest."""


AT_ONCE_S = 8.0
"""A person whose robot does not follow for so long lowers the hand and tries again."""

KEPT_OUT = "retargeting refused_keep_out"
"""Counted when a person is in the way of a motion: then the arm cannot follow wherever it is pushed."""

MADE_WAY = "retargeting yielded"
"""Counted when the arm moves away from a body."""


@dataclass(frozen=True)
class Outcome:
    """What came of a fault.

    Attributes:
        fault: The fault.
        broken: What is wrong with the commands themselves, for people ...
        missed: ... and with all else: an answer, a counter, the recovery.
        rest_s: How long after its begin the robot came to rest, or ceased to follow before giving way; None when it
            went on.
        recovery_s: How long after its end the robot followed again; None when it never did.
        counted: How much each of the fault's counters rose.
        stopped_by: Reasons to stop that are not the fault's, counted meanwhile.
        commands: How many commands were judged.
    """

    fault: Fault
    broken: tuple[str, ...]
    missed: tuple[str, ...]
    rest_s: float | None = None
    recovery_s: float | None = None
    counted: Mapping[str, int] = field(default_factory=dict)
    stopped_by: tuple[str, ...] = ()
    commands: int = 0

    @property
    def wrong(self) -> tuple[str, ...]:
        """All that went wrong; empty when the system survived."""
        return self.broken + self.missed


@contextmanager
def running_room(live: bool, log_folder: Path, domain: int) -> Iterator[FaultBench]:
    """A room whose robot follows its person.

    Raises:
        SetupError: The nodes do not start.
    """
    with Nodes(domain, log_folder) as nodes, (LiveFaultBench if live else ReplayFaultBench)(nodes, domain) as room:
        room.begin()
        room.read_reports()
        yield room


def all_tried(faults: Sequence[Fault], log_folder: Path) -> Iterator[Outcome]:
    """Let faults happen one after the other, in as few rooms as will do, each in a domain of its own.

    Raises:
        SetupError: The nodes do not start.
    """
    for live in (False, True):
        of_room = [fault for fault in faults if fault.live is live]
        if of_room:
            with private_domain() as domain, running_room(live, log_folder, domain) as room:
                yield from (tried(room, fault) for fault in of_room)


def tried(room: FaultBench, fault: Fault) -> Outcome:
    """Let a fault happen to a robot that follows, and wait until all is well again.

    What a machine made of it that gave this process no time is another fault than was meant: then it happens again,
    unless a command broke a limit, for which there is no excuse.
    """
    for _ in range(TRIES):
        room.longest_pause_s = 0.0
        outcome = _tried(room, fault)
        undisturbed = room.longest_pause_s < PAUSE_S and not outcome.stopped_by
        if outcome.broken or not outcome.missed or undisturbed:
            break
    return outcome


def _tried(room: FaultBench, fault: Fault) -> Outcome:
    if not _recovers(room, lambda: room.follows):
        return Outcome(fault, (), ("the robot did not follow before it",))
    first, before = len(room.commands), room.counts()
    with room.suffering(fault) as started_ns:
        end_ns = started_ns + round(fault.lasts_s * 1e9)
        room.until(lambda: room.now_ns() >= end_ns, 2.0 * fault.lasts_s)
        put_rad, ended_ns = room.heard_rad, room.now_ns()
    recovered = _recovers(room, lambda: room.follows and room.commands[-1].stamp_ns > ended_ns)
    recovery_s = (room.commands[-1].stamp_ns - ended_ns) * 1e-9 if recovered else None
    room.read_reports()
    after = room.counts()
    counted = {key: after.get(key, 0) - before.get(key, 0) for key in fault.counted}
    missed = [f"{key} was not counted" for key, rise in counted.items() if rise < fault.least]
    missed += [] if recovered else [f"no recovery within {RECOVERY_S:g} s: {room.mode}"]
    left_ns = next((at for at, mode in room.modes if started_ns < at <= ended_ns and mode != "following"), None)
    during = room.commands_between(first, started_ns, ended_ns)
    made_way = after.get(MADE_WAY, 0) > before.get(MADE_WAY, 0)
    again_ns = next((at for at, mode in room.modes if left_ns and at > left_ns and mode == "following"), ended_ns)
    stopped = [command for command in during if left_ns and left_ns + STOP_S * 1e9 <= command.stamp_ns <= again_ns]
    rest_s = rest_after_s(fault.answer, during, started_ns, left_ns, turned_rad(stopped) if made_way else None)
    hindered = made_way or after.get(KEPT_OUT, 0) > before.get(KEPT_OUT, 0)
    missed += complaints(fault, during, rest_s, put_rad, hindered=hindered)
    commands = room.commands[max(first - 3, 0) :]
    broken = tuple(problems(ROBOT, commands))
    others = tuple(key for key in OTHER_STOPS if key not in fault.counted and after.get(key, 0) > before.get(key, 0))
    return Outcome(fault, broken, tuple(missed), rest_s, recovery_s, counted, others, len(commands))


def _recovers(room: FaultBench, happened: Callable[[], bool]) -> bool:
    """Whether the robot follows again: at once, or when the person lowers the hand and raises it once more."""
    if room.until(happened, AT_ONCE_S):
        return True
    room.human.restart()
    return room.until(happened, RECOVERY_S)


def rest_after_s(
    answer: Answer, during: Sequence[Command], started_ns: int, left_ns: int | None, made_way_rad: float | None
) -> float | None:
    """When the robot came to rest; None for never.

    Where it goes on or gives way, or makes way a little for a person who is not seen and so may be anywhere near, it is
    when it ceased to follow.

    Args:
        answer: What it must do.
        during: Its commands.
        started_ns: When the fault began.
        left_ns: When it ceased to follow; None for not at all.
        made_way_rad: How far a joint turned at most after that, if the robot gave way to a person; else None.
    """
    if answer in ("goes on", "gives way"):
        return None if left_ns is None else (left_ns - started_ns) * 1e-9
    if made_way_rad is not None and left_ns is not None and made_way_rad <= WAY_RAD:
        return (left_ns - started_ns) * 1e-9
    moving_ns = [started_ns, *(command.stamp_ns for command in during if command.moves)]
    pauses = [before for before, after in pairwise(moving_ns) if after - before > A_WHILE_NS]
    rested_ns = pauses[0] if pauses and answer == "rests for a while" else moving_ns[-1]
    return (rested_ns - started_ns) * 1e-9


def turned_rad(commands: Sequence[Command]) -> float:
    """How far the joint turned that turned most [rad]."""
    positions = np.array([command.positions_rad for command in commands])
    return float(np.abs(np.diff(positions, axis=0)).sum(axis=0).max()) if len(commands) > 1 else 0.0


def complaints(
    fault: Fault, during: Sequence[Command], rest_s: float | None, put_rad: FloatArray, *, hindered: bool
) -> Iterator[str]:
    """What is wrong with how the robot answered."""
    if fault.answer == "goes on":
        if rest_s is not None:
            yield f"the robot ceased to follow after {rest_s:.2f} s"
        if not any(command.moves for command in during):
            yield "the robot did not move"
        return
    if rest_s is None or rest_s > fault.within_s:
        yield f"no rest within {fault.within_s:g} s but after {rest_s or fault.lasts_s:.2f} s"
    if fault.answer == "gives way" and not _gave_way(during, put_rad, hindered=hindered):
        yield "the robot does not go where it was put"


def _gave_way(during: Sequence[Command], put_rad: FloatArray, *, hindered: bool) -> bool:
    """Whether the robot went where it was put, or half of the way there if a person blocked it."""
    if not during:
        return False
    left = np.array([np.abs(np.subtract(command.positions_rad, put_rad)).max() for command in during])
    return bool(left.min() < BESIDE_RAD or (hindered and left.min() <= (1.0 - HINDERED) * left[0]))

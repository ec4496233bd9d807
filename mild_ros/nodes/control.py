# SPDX-License-Identifier: Apache-2.0
"""Control: the thread that alone steps retargeting and sends commands; it waits for no reception.

Whatever retargeting takes goes through a bounded inbox in which the newest wins; what is dropped is counted. Requests
of the operator are never dropped and are served at once, `~/hold` before all else: its requests lie in DDS until this
thread takes them, at least once in a control period, however many other calls wait. Live, ticks come from the steady
clock. With `use_sim_time` they come from `/clock`; when that stands still while the robot moves, the robot is stopped
on the steady clock. The thread has real-time priority where that is allowed (`priorities`). In lock-step there is no
thread: each input is taken where it comes (`StageNode.is_in_order`).
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from mild_core.retargeting.modes import Mode
from mild_core.retargeting.stage import Request, Retargeting, RetargetingInput, RetargetingState
from mild_core.signals import JointCommand, JointMeasurement, MotionWindow, PersonPose
from mild_ros.assembly.settings import RetargetingParameters
from mild_ros.messages.stamps import NANOSECONDS_PER_SECOND
from mild_ros.node_kit.clock import NodeClock
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.outcomes import OutcomePublisher
from mild_ros.node_kit.priorities import in_real_time
from mild_ros.node_kit.threads import StageNode
from mild_ros.nodes.commanding import Commanding
from mild_ros.nodes.life_topics import LifeTopics

KEPT = {"measurement": 32, "person": 8, "motion": 4}
"""Inputs of each kind that wait at most. Measurements come from several publishers, which are all to be heard."""

MOTION_PERIOD_S = 0.005
"""A motion is answered at once, but not sooner than this after the one before: models answer at 40 Hz."""

STANDSTILL_S = 0.2
"""`/clock` that has not advanced for so long stands still; a slow simulation publishes at 10 Hz."""

SWITCH_S = 0.0001
"""Python hands its lock to a thread that waits for it after this time, not after 5 ms."""

ANSWER_S = 5.0
"""Control answers within a period; a machine that gives it no time for so long has stopped."""

END_S = 1.0
"""A smooth stop takes 0.3 s; a node that is to end ends after this time in any case."""


@dataclass(frozen=True)
class Given:
    """One input of retargeting.

    Attributes:
        given: The input.
        received_ns: When it came, in the node's time.
        stamp_ns: What its outcome is reported under; None reports none.
        behind_ns: When what it is about was seen; 0 if that does not matter.
    """

    given: RetargetingInput
    received_ns: int
    stamp_ns: int | None = None
    behind_ns: int = 0


def kind_of(given: RetargetingInput) -> str:
    """What an input is called in diagnostics."""
    kinds = ((JointMeasurement, "measurement"), (PersonPose, "person"), (MotionWindow, "motion"))
    return next((name for kind, name in kinds if isinstance(given, kind)), "request")


class _Call:
    """Something to do in the thread of control, and what came of it.

    Attributes:
        done: Set once `result` or `error` is there.
        result: What it returned ...
        error: ... or raised.
    """

    def __init__(self, do: Callable[[], Any]) -> None:
        self._do, self.done = do, threading.Event()
        self.result: Any = None
        self.error: Exception | None = None

    def answer(self) -> None:
        """Do it; what it raises is raised where it was asked for."""
        try:
            self.result = self._do()
        except Exception as error:
            self.error = error
        self.done.set()


class Control:
    """Steps retargeting.

    Args:
        node: Whose.
        stage: Retargeting.
        parameters: Its rate, and whether commands are wanted from the start.
        diagnostics: Where outcomes are counted.
        outcomes: Where they are reported one by one.
        on_reset: Resets the stages before retargeting.
        age: What the time from a motion's origin to the command is called in diagnostics ...
        tick_age: ... and that of a command between motions; "" for not to be measured.

    Attributes:
        clock: The node's time.
        state: Of retargeting; only control changes it, others may look at it.
        commanding: Publishes the commands.
    """

    def __init__(
        self,
        node: StageNode,
        stage: Retargeting,
        parameters: RetargetingParameters,
        diagnostics: Diagnostics,
        outcomes: OutcomePublisher,
        on_reset: Callable[[], None],
        age: str,
        tick_age: str = "",
    ) -> None:
        self.state = stage.init()
        self._node, self._stage, self._diagnostics, self._outcomes = node, stage, diagnostics, outcomes
        self._in_order, self._age, self._tick_age = node.is_in_order, age, tick_age
        self._period_s = 1.0 / parameters.control_rate_hz
        self._inbox = {kind: deque[tuple[int, Given]]() for kind in KEPT}
        self._calls: deque[_Call] = deque()
        self._changed = threading.Condition()
        self._number = 0
        self._due = False
        self._motion_s = -1.0
        self._newest_ns = self._behind_ns = 0
        self._standing_ns: int | None = None
        self.commanding = Commanding(node, diagnostics, self._request, self.call, on_reset, parameters, stage)
        if self.commanding.silent:
            self.state = replace(self.state, mode=Mode.DISABLED)
        self._life = LifeTopics(node, self._request, polled=not self._in_order)
        self.clock = NodeClock(node, diagnostics, self._on_tick, parameters.control_rate_hz, timer=False)
        if not self._in_order:
            sys.setswitchinterval(SWITCH_S)
            node.run_beside("control", self._run, self._finish)

    def put(self, *entries: Given) -> None:
        """Hand over inputs that came together; in lock-step they are taken at once."""
        if self._in_order:
            self._take(entries, self.clock.now_ns())
            return
        with self._changed:
            for entry in entries:
                kind = kind_of(entry.given)
                box = self._inbox[kind]
                if len(box) >= KEPT[kind]:
                    _, old = box.popleft()
                    self._diagnostics.superseded(f"{kind} in the inbox", 1)
                    if old.stamp_ns is not None:
                        self._outcomes.report("retargeting", 0, "superseded", old.stamp_ns)
                self._number += 1
                box.append((self._number, entry))
            if self._inbox["motion"]:
                self._changed.notify()

    def call(self, do: Callable[[], Any]) -> Any:
        """Do something in the thread of control, before its next step, and return what comes of it.

        Raises:
            TimeoutError: Control gets no time.
            Exception: Whatever `do` raises.
        """
        if self._in_order or threading.current_thread().name == "control":
            return do()
        call = _Call(do)
        with self._changed:
            self._calls.append(call)
            self._changed.notify()
        if not call.done.wait(ANSWER_S):
            raise TimeoutError(f"control has had no time for {ANSWER_S:g} s")
        if call.error is not None:
            raise call.error
        return call.result

    def ask(self, request: Request) -> None:
        """Hand over a request, as an operator would.

        Raises:
            TimeoutError: Control gets no time.
        """
        self.call(lambda: self._request(request))

    def _finish(self) -> None:
        """The node is to end: let the robot come to rest first."""
        self.call(lambda: self.commanding.stop("end"))
        deadline_s = time.monotonic() + END_S
        while self.state.commanded_ns is not None and time.monotonic() < deadline_s:
            time.sleep(self._period_s)

    def _request(self, request: Request) -> RetargetingState:
        now_ns = self._now_ns()
        self._take((Given(request, now_ns, now_ns),), now_ns)
        return self.state

    def _on_tick(self, now_ns: int) -> None:
        """`/clock` has passed a point of the control grid."""
        if self._in_order:
            self._tick(now_ns)
            return
        with self._changed:
            self._due = True
            self._changed.notify()

    def _now_ns(self) -> int:
        """Now; time that stands still goes on here while the robot is being stopped."""
        return self.clock.now_ns() + (self._standing_ns or 0)

    def _run(self) -> None:
        self._diagnostics.facts["control priority"] = "real time" if in_real_time() else "normal"
        next_s = time.monotonic()
        # Each part by itself: a fault in one of them costs neither the commands nor the smooth stop.
        guard, watch = self._node.guard, self._node.guard("control", self.commanding.watch)
        drained, serve_hold = guard("control", self._drained), guard("control", self._life.serve_hold)
        take_late, tick = guard("control", self._take_late), guard("control", self._tick)
        check_clock = guard("control", self._check_clock)
        while not self._node.ending.is_set():
            with self._changed:
                while not (self._calls or self._due or self._node.ending.is_set()):
                    motion_s = self._motion_s + MOTION_PERIOD_S if self._inbox["motion"] else next_s
                    wait_s = min(next_s, motion_s) - time.monotonic()
                    if wait_s <= 0.0:
                        break
                    self._changed.wait(wait_s)
                calls, entries = list(self._calls), drained() or []
                self._calls.clear()
                due, self._due = self._due, False
            serve_hold()
            for call in calls:
                call.answer()
            watch()
            now_ns = self._now_ns()
            for entry in entries:
                take_late(entry, now_ns)
            now_s = time.monotonic()
            if now_s >= next_s:
                next_s += self._period_s * (1 + int((now_s - next_s) / self._period_s))
                due = check_clock() if self.clock.simulated and not due else True
            if due:
                tick(self._now_ns())

    def _drained(self) -> list[Given]:
        """Everything in the inbox, in the order in which it came; motions wait for their time."""
        motion_due = time.monotonic() >= self._motion_s + MOTION_PERIOD_S
        found: list[tuple[int, Given]] = []
        for kind, box in self._inbox.items():
            if kind != "motion" or motion_due:
                found += box
                box.clear()
        if motion_due and any(isinstance(entry.given, MotionWindow) for _, entry in found):
            self._motion_s = time.monotonic()
        return [entry for _, entry in sorted(found, key=lambda one: one[0])]

    def _take_late(self, entry: Given, now_ns: int) -> None:
        """Take an input at the time when it came, if that is not before what was taken already.

        A motion leads to a command, which is about now.
        """
        is_motion = isinstance(entry.given, MotionWindow)
        came_between = self._newest_ns <= entry.received_ns <= now_ns
        self._take((entry,), entry.received_ns if came_between and not is_motion else now_ns)

    def _tick(self, now_ns: int) -> None:
        self._take((Given(None, now_ns, now_ns),), now_ns)

    def _check_clock(self) -> bool:
        """Whether time stands still and the robot has to be stopped on the steady clock."""
        stands = self.clock.standstill_s() > STANDSTILL_S
        moves = self.state.motion is not None and not self.state.motion.resting
        if not stands:
            if self._standing_ns is not None:
                self._standing_ns = None
                self.commanding.go_on("time")
            return False
        if self._standing_ns is None and moves:
            self._standing_ns = 0
            self.commanding.stop("time")
        if self._standing_ns is None or self.state.commanded_ns is None:
            return False
        self._standing_ns += round(self._period_s * NANOSECONDS_PER_SECOND)
        return True

    def _take(self, entries: tuple[Given, ...], now_ns: int) -> None:
        """Step retargeting with each of these, send what comes of them and say what became of them."""
        started_ns = time.perf_counter_ns()
        commands: tuple[JointCommand, ...] = ()
        outcomes: list[tuple[str, int]] = []
        self._newest_ns = now_ns
        for entry in entries:
            self.state, new_commands = self._stage.step(self.state, entry.given, now_ns)
            commands += new_commands
            if entry.behind_ns and isinstance(entry.given, MotionWindow):
                self._behind_ns = entry.behind_ns
            if entry.stamp_ns is not None:
                outcomes.append((self.state.outcome, entry.stamp_ns))
            self._diagnostics.ended("retargeting", self.state.outcome, self.state.counts, self.state.detail)
        self._life.publish(self.state, commands)
        self.commanding.send(commands, self.state)
        if commands:
            self._diagnostics.took("control step", time.perf_counter_ns() - started_ns)
        if commands and commands[-1].motion_stamp_ns:
            age = self._tick_age if entries[-1].given is None else self._age
            if age:
                self._diagnostics.took(age, self.clock.now_ns() - self._behind_ns)
        for outcome, stamp_ns in outcomes:
            self._outcomes.report("retargeting", 0, outcome, stamp_ns)

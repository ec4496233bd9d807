# SPDX-License-Identifier: Apache-2.0
"""What stands around real nodes: a person before a tracker, a robot's report, an operator who reads; all may fail.

This process plays the tracker, says or passes on where the robot is, and writes down what is commanded, in which mode,
and what the diagnostics count. How time passes is up to the two kinds of benches: `live_fault_bench.py`,
`replayed_fault_bench.py`.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from mild_core.errors import SetupError
from mild_core.retargeting.robots import ROBOTS
from mild_core.shapes import FloatArray
from mild_core.signals import JointMeasurement
from mild_ros.environment.processes import Nodes
from mild_ros.messages.joint_state import joint_measurement_to_msg
from mild_ros.messages.stamps import ns_from_msg
from mild_ros.node_kit.quality_of_service import LATCHED, STATE
from test.faults.encoded_people import EncodedPeople
from test.faults.judge import Command
from test.faults.people import HANDSHAKE, TRACKER_HZ, People, SimulatedPerson
from test.faults.table import Fault
from tools.scenes import cameras

ROBOT = ROBOTS["yumi"]


def stage_parameters(stage: str) -> dict[str, object]:
    """Parameters of a node: the camera of the scene is measured, and an interaction ends only with the hand.

    The simulated person shakes hands without end, and never raises the hand once more.
    """
    given: dict[str, object] = {}
    if stage in ("pipeline", "perception"):
        given["robot_from_camera"] = cameras(HANDSHAKE)["yumi"]
    if stage in ("pipeline", "retargeting"):
        given["interaction_s"] = 3600.0
    return given


START_S = 300.0
"""For nodes to start: the first start compiles, and a busy machine takes its time."""


class FaultBench(ABC):
    """All processes, and the time in which they live.

    Args:
        nodes: Starts processes.
        domain: In which they talk.
        names: Of the nodes that must be at work before a person comes.

    Attributes:
        commands: All commands so far.
        modes: All modes so far, and when they were heard [ns].
        human: Who stands before the tracker.
        heard_rad: (J,) where the robot said last that it is.
        longest_pause_s: Longest time that this process got no time in which it should have played its part.
    """

    def __init__(self, nodes: Nodes, domain: int, names: Sequence[str]) -> None:
        self.commands: list[Command] = []
        self.modes: list[tuple[int, str]] = []
        self.human = SimulatedPerson()
        self.heard_rad: FloatArray = ROBOT.home_rad
        self.longest_pause_s = 0.0
        self._nodes, self._encoded, self._names = nodes, EncodedPeople(), set(names)
        self._reports: dict[str, tuple[float, dict[str, str]]] = {}
        self._fault: Fault | None = None
        self._started_ns = self._due_ns = self._heard = 0
        self._measured = self._first = JointMeasurement(0, ROBOT.joint_names, ROBOT.home_rad)
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = Node("surroundings", context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._skeletons = self._node.create_publisher(MarkerArray, "skeleton", STATE)
        self._states = self._node.create_publisher(JointState, "joint_states", STATE)
        self._node.create_subscription(JointState, "joint_command", self._on_command, 1000)
        self._node.create_subscription(String, "mode", self._on_mode, LATCHED)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 100)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    @abstractmethod
    def now_ns(self) -> int:
        """The time in which the nodes live."""

    @abstractmethod
    def _live(self) -> None:
        """Let a little time pass: send what is due, take what has come."""

    @property
    def mode(self) -> str:
        """The newest one."""
        return self.modes[-1][1] if self.modes else ""

    @property
    def follows(self) -> bool:
        """Whether the robot follows the person, and moves."""
        return self.mode == "following" and bool(self.commands) and self.commands[-1].moves

    def commands_between(self, first: int, started_ns: int, ended_ns: int) -> list[Command]:
        """Commands of a time, from the one at place `first` on."""
        return [command for command in self.commands[first:] if started_ns <= command.stamp_ns <= ended_ns]

    def until(self, happened: Callable[[], object], seconds: float) -> bool:
        """Let time pass until something has happened; whether it did within so many seconds of that time."""
        deadline_ns = self.now_ns() + round(seconds * 1e9)
        while not happened():
            if self.now_ns() > deadline_ns:
                return False
            self._live()
        return True

    def begin(self) -> None:
        """Let time pass until the robot follows.

        Raises:
            SetupError: It never does, or a node has ended.
        """
        deadline_s = time.monotonic() + START_S
        while not (self._is_occupied and self.follows):
            self._nodes.check()
            if time.monotonic() > deadline_s:
                raise SetupError(
                    "nodes", f"{self.mode or 'silent'} after {START_S:g} s", f"see {self._nodes.log_folder}"
                )
            self._live()

    @contextmanager
    def suffering(self, fault: Fault) -> Iterator[int]:
        """While in the block it goes wrong; gives when that began [ns]."""
        self._begin(fault)
        try:
            yield self._started_ns
        finally:
            self._fault = None
            self._due_ns = self.now_ns()
            if fault.recalibrated and not fault.clock_s:
                self.human.restart()

    def _begin(self, fault: Fault) -> None:
        self._started_ns, self._first, self._fault = self.now_ns(), self._measured, fault

    def has_said(self, name: str, words: str) -> bool:
        """Whether a node has printed `words`."""
        return self._nodes.has_said(name, words)

    def counts(self) -> dict[str, int]:
        """Everything that the newest diagnostics count; of all nodes together."""
        found: dict[str, int] = {}
        for _, values in self._reports.values():
            for key, value in values.items():
                if value.isdecimal():
                    found[key] = found.get(key, 0) + int(value)
        return found

    def read_reports(self) -> None:
        """Wait for a new report of every node."""
        since_s = time.monotonic()
        while not all(heard_s > since_s for heard_s, _ in self._reports.values()):
            if time.monotonic() > since_s + START_S:
                raise SetupError("/diagnostics", "a node does not report", f"see {self._nodes.log_folder}")
            self._meanwhile()

    def _meanwhile(self) -> None:
        """Wait for something to come; the time in which the nodes live need not pass."""
        self._live()

    def _see(self, due_ns: int) -> list[bytes]:
        """The tracker's messages at a time."""
        if not self._is_occupied:
            return []
        frame = self.human.seen(due_ns)
        if self._fault is None:
            people: tuple[People, ...] = ((frame,),)
        else:
            people = self._fault.tracker(frame, (due_ns - self._started_ns) * 1e-9)
        return [self._encoded.message(everyone) for everyone in people]

    @property
    def _is_occupied(self) -> bool:
        """Whether the person has come: when all nodes have spoken."""
        return self._names <= self._reports.keys()

    @property
    def _period_ns(self) -> int:
        return round(1e9 / (self._fault.rate_hz if self._fault else TRACKER_HZ))

    def _publish_joints(self, measured: JointMeasurement) -> bool:
        """Say where the robot is, if it says so; whether it did."""
        self._measured = measured
        reported: JointMeasurement | None = measured
        if self._fault is not None:
            reported = self._fault.robot(measured, self._first, (self.now_ns() - self._started_ns) * 1e-9)
        if reported is not None:
            self.heard_rad = reported.positions_rad[: len(ROBOT.joint_names)]  # ours come first
            data = serialize_message(joint_measurement_to_msg(reported))
            for _ in range(1 if self._fault is None else self._fault.copies):
                self._states.publish(data)
        return reported is not None

    def _on_command(self, message: Any) -> None:
        self._heard += 1
        stamp_ns = ns_from_msg(message.header.stamp)
        self.commands.append(Command(stamp_ns, tuple(message.position), tuple(message.velocity)))

    def _on_mode(self, message: Any) -> None:
        self.modes.append((self.now_ns(), message.data))

    def _on_report(self, message: Any) -> None:
        for status in message.status:
            self._reports[status.name] = time.monotonic(), {pair.key: pair.value for pair in status.values}

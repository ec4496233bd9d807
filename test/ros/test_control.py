# SPDX-License-Identifier: Apache-2.0
"""Control over real DDS: nothing that comes in, asks or stops around it ends or delays the stream of commands."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from mild_core.signals import JointMeasurement, MotionWindow
from mild_ros.messages.joint_state import joint_measurement_to_msg
from mild_ros.messages.motion import motion_state_to_msg, motion_to_msg
from mild_ros.messages.stamps import ns_from_msg, time_to_msg
from mild_ros.node_kit.priorities import BESIDE, CONTROL
from mild_ros.node_kit.quality_of_service import SERVICE
from mild_ros.nodes.commanding import DISCOVERY_S
from test.faults.judge import Command, problems
from test.ros.processes import END_S, NodeProcess, Probe
from test.ros.surroundings import ERROR, YUMI, Surroundings

pytestmark = pytest.mark.slow

AWAY = np.where(np.arange(7) == 0, 1.2, 0.0)


class Mover(Surroundings):
    """A robot that is sent to and fro by motions, in real time or in that of a `/clock`."""

    PERIOD_S = 0.02

    def __init__(self, probe: Probe, simulated: bool = False) -> None:
        super().__init__(probe, "retargeting")
        self.motion = probe.node.create_publisher(JointTrajectory, "motion", 100)
        self.state = probe.node.create_publisher(PointCloud2, "motion_state", 100)
        self.clock = probe.node.create_publisher(Clock, "/clock", 10) if simulated else None
        self.ticks = True
        self.came_s: list[float] = []
        self._start_s = time.monotonic()
        self._due_s = 0.0
        self._sim_ns = 1_000_000_000
        probe.node.create_subscription(JointState, "joint_command", lambda _: self.came_s.append(time.monotonic()), 50)

    def connect(self, *publishers: Any) -> None:
        super().connect(self.states, self.motion, self.state, *publishers)

    def now_ns(self) -> int:
        return self._sim_ns if self.clock is not None else self.probe.now_ns()

    def act(self) -> None:
        """Say where the robot is and where it is to go, fifty times a second."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + self.PERIOD_S
        if self.clock is not None and self.ticks:
            for _ in range(2):
                self._sim_ns += 10_000_000
                self.clock.publish(Clock(clock=time_to_msg(self._sim_ns)))
        place = np.array(self.commands[-1].position) if self.commands else YUMI.home_rad
        measured = JointMeasurement(self.now_ns(), YUMI.joint_names, place)
        self.states.publish(joint_measurement_to_msg(measured))
        there = YUMI.home_rad + AWAY * np.sin((now_s - self._start_s) * 1.5)
        motion = MotionWindow(
            self.now_ns(), 25_000_000, 25_000_000, YUMI.joint_names, np.tile(there, (40, 1)), np.eye(7) * 1e-4,
            "hand_shake", 0.9, np.array([0.25, 0.75]), phase=0.5, out_of_distribution=0.1,
        )  # fmt: skip
        self.motion.publish(motion_to_msg(motion))
        self.state.publish(motion_state_to_msg(motion, ("hand_shake",)))

    @property
    def moves(self) -> bool:
        return bool(self.commands) and max(map(abs, self.commands[-1].velocity)) > 0.2

    def until(self, happened: Callable[[], Any], what: str, seconds: float = 60.0) -> Any:
        """Act until something has happened."""

        def found() -> Any:
            self.act()
            return happened()

        return self.probe.until(found, what, seconds)

    def rests(self) -> bool:
        return max(map(abs, self.commands[-1].velocity)) < 1e-6

    def judged(self, since: int) -> list[str]:
        """What is wrong with the commands since one of them."""
        heard = [
            Command(ns_from_msg(one.header.stamp), tuple(one.position), tuple(one.velocity))
            for one in self.commands[since:]
        ]
        return problems(YUMI, heard)


@pytest.fixture
def mover(probe: Probe) -> Mover:
    return Mover(probe)


def test_the_kind_of_time_cannot_change_while_a_node_runs(start: Callable[..., NodeProcess], mover: Mover) -> None:
    start("retargeting")
    mover.connect()
    mover.until(lambda: mover.moves, "the robot moves")
    wish = ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=True)
    request = SetParameters.Request(parameters=[Parameter(name="use_sim_time", value=wish)])
    (answer,) = mover.probe.call(SetParameters, "/retargeting/set_parameters", request).results
    assert not answer.successful
    assert "start the node again" in answer.reason
    count = len(mover.commands)
    mover.until(lambda: len(mover.commands) > count + 30, "commands go on")
    same = SetParameters.Request(parameters=[Parameter(name="use_sim_time", value=ParameterValue(type=1))])
    (answer,) = mover.probe.call(SetParameters, "/retargeting/set_parameters", same).results
    assert answer.successful


def test_time_that_stands_still_stops_the_robot_and_goes_on_with_it(
    start: Callable[..., NodeProcess], probe: Probe
) -> None:
    mover = Mover(probe, simulated=True)
    start("retargeting", use_sim_time=True)
    mover.connect(mover.clock)
    mover.until(lambda: mover.moves, "the robot moves")
    first, stood_s, mover.ticks = len(mover.commands), time.monotonic(), False
    mover.until(lambda: len(mover.commands) > first + 3 and mover.rests(), "a stop without /clock")
    assert mover.came_s[-1] - stood_s < 1.5, "0.2 s to notice, 0.3 s to stop, and a busy machine"
    mover.until(lambda: mover.status()[0] == ERROR and "/clock stands still" in mover.status()[1], "the reason is said")
    assert mover.judged(first - 20) == []
    mover.ticks = True
    count = len(mover.commands)
    mover.until(lambda: len(mover.commands) > count + 20 and mover.moves, "it goes on with time")
    mover.until(lambda: "/clock stands still" not in mover.status()[1], "nothing is said any more")


def test_a_negative_clock_is_counted_and_ends_no_node(start: Callable[..., NodeProcess], probe: Probe) -> None:
    mover = Mover(probe, simulated=True)
    node = start("retargeting", use_sim_time=True)
    mover.connect(mover.clock)
    mover.until(lambda: mover.moves, "the robot moves")
    negative = Clock()
    negative.clock.sec = -5
    mover.clock.publish(negative)
    mover.until(lambda: int(mover.status()[2].get("messages negative_time", "0")) >= 1, "it is counted")
    count = len(mover.commands)
    mover.until(lambda: len(mover.commands) > count + 20 and mover.moves, "the robot moves on")
    assert node.process.poll() is None
    assert "messages unusable" not in mover.status()[2], "rclpy's own clock did not raise either"


def test_a_hold_among_thousands_of_calls_acts_at_once_and_every_call_is_answered(
    start: Callable[..., NodeProcess], mover: Mover
) -> None:
    start("retargeting")
    mover.connect()
    mover.until(lambda: mover.moves, "the robot moves")
    node = mover.probe.node
    hold, enable, hold_again = (
        node.create_client(SetBool, f"/retargeting/{name}", qos_profile=SERVICE) for name in ("hold", "enable", "hold")
    )
    mover.until(lambda: hold.service_is_ready() and enable.service_is_ready(), "services")
    calls = [enable.call_async(SetBool.Request(data=True)) for _ in range(1500)]
    asked_s = time.monotonic()
    held = hold.call_async(SetBool.Request(data=True))
    calls += [enable.call_async(SetBool.Request(data=True)) for _ in range(1000)]
    calls += [hold_again.call_async(SetBool.Request(data=True)) for _ in range(500)]
    mover.until(held.done, "the answer of hold")
    assert held.result().success
    assert held.result().message.startswith("held; held: the robot "), held.result().message
    mover.until(mover.rests, "the robot rests")
    assert mover.came_s[-1] - asked_s < 5.0
    mover.until(lambda: all(call.done() for call in calls), "every answer", 120.0)
    assert all(call.result().success for call in calls)
    released = mover.probe.call(SetBool, "/retargeting/hold", SetBool.Request(data=False))
    assert released.message.startswith("released; ")


def test_hold_says_so_when_no_command_is_sent(start: Callable[..., NodeProcess], mover: Mover, real_time: bool) -> None:
    running = start("retargeting")
    mover.connect()
    mover.probe.until(lambda: "waiting for joint_states" in mover.status()[1], "waiting")
    threads = [int(entry.name) for entry in Path(f"/proc/{running.process.pid}/task").iterdir()]
    found = Counter(os.sched_getparam(one).sched_priority for one in threads)
    expected = {CONTROL: 1, BESIDE: len(threads) - 1} if real_time else {0: len(threads)}
    said = mover.status()[2]["control priority"]
    assert (found, said) == (expected, "real time" if real_time else "normal")
    answer = mover.probe.call(SetBool, "/retargeting/hold", SetBool.Request(data=True))
    assert answer.message == "held; waiting: the robot has not said where it is, and no command is sent"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_node_that_ends_brings_the_robot_to_rest_first(
    start: Callable[..., NodeProcess], mover: Mover, number: int
) -> None:
    node = start("retargeting")
    mover.connect()
    mover.until(lambda: mover.moves, "the robot moves")
    first = len(mover.commands)
    node.process.send_signal(number)
    mover.until(lambda: node.process.poll() is not None, "the end", 10.0)
    assert node.process.returncode == 0
    assert "Traceback" not in node.output()
    assert mover.rests()
    assert mover.judged(first - 20) == []


class Two:
    """Two pipelines that believe to command one robot: by the place where each gets the robot's state, their commands
    can be distinguished."""

    def __init__(self, probe: Probe, start: Callable[..., NodeProcess], model: Path) -> None:
        self.probe, self._start, self._model = probe, start, model
        self.sent: dict[str, list[float]] = {"first": [], "second": []}
        self.said: dict[str, list[tuple[bytes, str]]] = {"first": [], "second": []}
        self._places = {"first": YUMI.home_rad, "second": YUMI.home_rad + 0.1}
        self._states = {name: probe.node.create_publisher(JointState, f"{name}/states", 10) for name in self._places}
        probe.node.create_subscription(JointState, "joint_command", self._on_command, 100)
        probe.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 50)

    def begin(self, name: str) -> NodeProcess:
        words = ("-r", f"__node:={name}", "-r", f"joint_states:={name}/states")
        return self._start("pipeline", *words, model=self._model)

    def act(self) -> None:
        for name, place in self._places.items():
            stamped = JointMeasurement(self.probe.now_ns(), YUMI.joint_names, place)
            self._states[name].publish(joint_measurement_to_msg(stamped))

    def until(self, happened: Callable[[], Any], what: str, seconds: float = 120.0) -> None:
        def found() -> Any:
            self.act()
            return happened()

        self.probe.until(found, what, seconds, lambda: {name: said[-1:] for name, said in self.said.items()})

    def overlap_s(self) -> float:
        """For how long both sent."""
        if not all(self.sent.values()):
            return 0.0
        started = max(times[0] for times in self.sent.values())
        return max(0.0, min(times[-1] for times in self.sent.values()) - started)

    def yields(self, name: str, other: str) -> bool:
        """Whether a node says that it sends nothing, and for whose sake."""
        level, text = (self.said[name] or [(b"", "")])[-1]
        return level == ERROR and "1 other publisher on /joint_command" in text and f"/{other}" in text

    def _on_command(self, message: Any) -> None:
        name = "first" if abs(message.position[0] - YUMI.home_rad[0]) < 0.05 else "second"
        self.sent[name].append(time.monotonic())

    def _on_report(self, message: Any) -> None:
        for status in message.status:
            if status.name in self.said:
                self.said[status.name].append((status.level, status.message))


def test_a_second_pipeline_never_sends_and_the_first_stops(
    start: Callable[..., NodeProcess], probe: Probe, random_model: Path
) -> None:
    two = Two(probe, start, random_model)
    two.begin("first")
    two.until(lambda: len(two.sent["first"]) > 20, "the first commands")
    second = two.begin("second")
    two.until(lambda: two.yields("first", "second") and two.yields("second", "first"), "both say why they are silent")
    assert two.sent["second"] == []
    assert second.stop() == 0
    count = len(two.sent["first"])
    two.until(lambda: len(two.sent["first"]) > count + 20, "the first goes on")
    assert two.sent["second"] == []


def test_two_pipelines_that_start_together_do_not_both_send(
    start: Callable[..., NodeProcess], probe: Probe, random_model: Path
) -> None:
    two = Two(probe, start, random_model)
    started_s = time.monotonic()
    two.begin("first")
    two.begin("second")
    two.until(lambda: two.yields("first", "second") and two.yields("second", "first"), "both say why they are silent")
    assert two.overlap_s() <= 0.1
    assert all(times[0] - started_s >= DISCOVERY_S for times in two.sent.values() if times), "discovery is awaited"


def test_commands_wait_until_others_would_have_been_seen(start: Callable[..., NodeProcess], mover: Mover) -> None:
    started_s = time.monotonic()
    node = start("retargeting")
    mover.until(lambda: mover.came_s, "commands")
    assert mover.came_s[0] - started_s >= DISCOVERY_S
    assert "no other publisher of commands within" in node.output(), "however long it took to start"


PLANTED = """
import signal, sys
from mild_ros.nodes import commanding
from mild_ros.nodes import life_topics
from mild_ros.node_kit import reception
from mild_ros.nodes import retargeting_node
where, name, error = sys.argv.pop(1).split(":")
kind = {"commanding": commanding.Commanding, "life": life_topics.LifeTopics, "reception": reception.Reception}[where]
sound, planted = getattr(kind, name), []
def faulty(*given):
    if planted:
        raise {"RuntimeError": RuntimeError, "SystemExit": SystemExit}[error]("planted")
    return sound(*given)
setattr(kind, name, faulty)
signal.signal(signal.SIGUSR1, lambda *_: planted.append(True))
retargeting_node.main()
"""


@pytest.mark.parametrize(
    "where", ["commanding:watch", "life:serve_hold", "reception:_take", "reception:_take:SystemExit"]
)
def test_no_fault_of_ours_in_a_thread_ends_commands_without_the_smooth_stop(
    where: str, mover: Mover, tmp_path: Path
) -> None:
    where, ends = (where, True) if where.count(":") == 2 else (f"{where}:RuntimeError", False)
    log = tmp_path / "planted.log"
    with log.open("w") as output:
        process = subprocess.Popen([sys.executable, "-c", PLANTED, where], stdout=output, stderr=subprocess.STDOUT)
    try:
        mover.connect()
        mover.until(lambda: mover.moves, "the robot moves")
        first = len(mover.commands)
        process.send_signal(signal.SIGUSR1)
        if ends:
            mover.until(lambda: process.poll() is not None, "the node ends")
            assert process.returncode != 0
            assert "planted" in log.read_text()
        else:
            mover.until(lambda: mover.status()[0] == ERROR and "planted" in mover.status()[1], "the fault is an ERROR")
            count = len(mover.commands)
            mover.until(lambda: len(mover.commands) > count + 50, "commands go on")
            process.send_signal(signal.SIGTERM)
            assert process.wait(END_S) == 0, log.read_text()
        mover.until(mover.rests, "the last command is at rest", 2.0)
        assert mover.judged(first - 20) == []
    finally:
        process.kill()
        process.wait()

# SPDX-License-Identifier: Apache-2.0
"""The retargeting node over real DDS: it commands only what it should, and says why when it does not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState, PointCloud2
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from mild_core.signals import MotionWindow
from mild_ros.messages.motion import motion_state_to_msg, motion_to_msg
from test.ros.processes import NodeProcess, Probe
from test.ros.surroundings import ERROR, WARN, YUMI, Surroundings

pytestmark = pytest.mark.slow


class Motions(Surroundings):
    """The surroundings of retargeting: motions are published."""

    def __init__(self, probe: Probe) -> None:
        super().__init__(probe, "retargeting")
        self.motion = probe.node.create_publisher(JointTrajectory, "motion", 100)
        self.state = probe.node.create_publisher(PointCloud2, "motion_state", 100)

    def connect(self, *publishers: Any) -> None:
        super().connect(self.states, self.motion, self.state, *publishers)

    def move(self, to: np.ndarray, joint_names: tuple[str, ...] = YUMI.joint_names) -> None:
        """A motion window that stays at one pose."""
        motion = MotionWindow(
            stamp_ns=self.probe.now_ns(),
            lead_ns=25_000_000,
            period_ns=25_000_000,
            joint_names=joint_names,
            positions=np.tile(to, (40, 1)),
            covariance=np.eye(len(joint_names)) * 1e-4,
            interaction="hand_shake",
            probability=0.9,
            belief=np.array([0.25, 0.75]),
            phase=0.5,
            out_of_distribution=0.1,
        )
        self.motion.publish(motion_to_msg(motion))
        self.state.publish(motion_state_to_msg(motion, ("hand_shake",)))


@pytest.fixture
def bench(probe: Probe) -> Motions:
    return Motions(probe)


def follow(bench: Motions, target: np.ndarray, done: Callable[[], Any], what: str) -> None:
    """Keep sending a motion until something has happened."""

    def sent() -> Any:
        bench.move(target)
        bench.obey()
        bench.probe.spin(0.02)
        return done()

    bench.probe.until(sent, what)


def obeyed(bench: Motions, done: Callable[[], Any], what: str) -> None:
    """The robot goes on saying where it is until something has happened."""

    def said() -> Any:
        bench.obey()
        return done()

    bench.probe.until(said, what)


TARGET = YUMI.home_rad + 0.3


def test_it_follows_and_holds_and_goes_home(start: Callable[..., NodeProcess], bench: Motions) -> None:
    start("retargeting", home_after_s=2.0, stale_after_s=0.3, home_velocity_rad_s=2.0, report_handled=True)
    bench.connect()
    bench.until_status(WARN, "waiting for joint_states")
    assert bench.commands == [], "the robot's place is unknown"
    bench.measure()
    bench.probe.until(lambda: len(bench.commands) > 10, "commands")
    np.testing.assert_array_equal(bench.commands[0].position, YUMI.home_rad)
    assert tuple(bench.commands[0].name) == YUMI.joint_names

    follow(bench, TARGET, lambda: bench.commands_reach(TARGET), "the target reached")
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in bench.commands]
    positions = np.array([list(message.position) for message in bench.commands])
    assert np.all(np.diff(stamps) > 0)
    speeds = np.diff(positions, axis=0) / (np.diff(stamps)[:, None] * 1e-9)
    # Rounding of stamps to a nanosecond over steps of at least 0.1 ms.
    assert np.all(np.abs(speeds) <= YUMI.velocity_rad_s * (1 + 1e-4))

    bench.until_status(WARN, "holding", bench.obey)
    obeyed(bench, lambda: bench.commands_reach(YUMI.home_rad), "home again")
    obeyed(bench, lambda: bench.status()[2]["mode"] == "idle", "ready again")
    values = bench.until_status(WARN, "no motion for")
    assert int(values["retargeting accepted"]) > 5
    assert int(values["retargeting held_stale"]) == 1


def test_the_operator_is_obeyed(start: Callable[..., NodeProcess], bench: Motions) -> None:
    start("retargeting", enabled=False)
    bench.connect()
    follow(bench, TARGET, lambda: bench.status()[2].get("retargeting not_enabled"), "refused motions")
    assert bench.commands == []
    assert bench.probe.call(SetBool, "/retargeting/enable", SetBool.Request(data=True)).success
    follow(bench, TARGET, lambda: bench.commands_reach(TARGET), "the target reached")
    assert bench.probe.call(SetBool, "/retargeting/hold", SetBool.Request(data=True)).success
    held_at = np.array(bench.commands[-1].position)
    follow(bench, YUMI.home_rad, lambda: bench.status()[2]["mode"] == "held", "held, whatever motion comes")
    np.testing.assert_allclose(bench.commands[-1].position, held_at, atol=0.01)  # it stood there already
    assert bench.probe.call(SetBool, "/retargeting/hold", SetBool.Request(data=False)).success
    assert bench.probe.call(Trigger, "/retargeting/reset", Trigger.Request()).success
    obeyed(bench, lambda: bench.commands_reach(YUMI.home_rad), "home after reset")
    assert bench.probe.call(SetBool, "/retargeting/enable", SetBool.Request(data=False)).success
    bench.until_status(WARN, "")
    bench.probe.until(lambda: bench.status()[2]["mode"] == "disabled", "disabled")
    count = bench.status()[2]["joint_command count"]
    seen = len(bench.reports)
    bench.probe.until(lambda: len(bench.reports) > seen + 1, "two more reports")
    assert bench.status()[2]["joint_command count"] == count, "a disabled node sends nothing"


def test_it_stops_when_another_node_commands(start: Callable[..., NodeProcess], bench: Motions) -> None:
    node = start("retargeting")
    bench.connect()
    bench.measure()
    bench.probe.until(lambda: bench.commands, "commands")
    other = bench.probe.node.create_publisher(JointState, "joint_command", 1)
    values = bench.until_status(ERROR, "1 other publisher on /joint_command: this node sends no commands")
    assert values["mode"] == "disabled"
    assert "other publisher" in node.output()
    answer = bench.probe.call(SetBool, "/retargeting/enable", SetBool.Request(data=True))
    assert not answer.success
    assert "no other node" in answer.message
    count, seen = len(bench.commands), len(bench.reports)
    bench.probe.until(lambda: len(bench.reports) > seen + 1, "two more reports")
    assert len(bench.commands) == count
    bench.probe.node.destroy_publisher(other)
    bench.probe.until(lambda: len(bench.commands) > count, "commands again")


def test_publishers_of_joint_states_that_disagree_hold_the_robot_and_are_named(
    start: Callable[..., NodeProcess], bench: Motions
) -> None:
    start("retargeting")
    bench.connect()
    follow(bench, TARGET, lambda: bench.commands_reach(TARGET), "the target reached")
    other = Node("publisher_of_zeros", context=bench.probe.node.context)
    wrong = other.create_publisher(JointState, "joint_states", 10)

    def contradict() -> None:
        bench.move(TARGET)
        bench.obey()
        wrong.publish(JointState(name=list(YUMI.joint_names), position=[-0.1] * 7))

    named = "two publishers of joint_states disagree: /probe, /publisher_of_zeros"
    values = bench.until_status(ERROR, named, contradict)
    other.destroy_node()
    assert values["mode"] == "holding"
    assert int(values["retargeting joint_states_disagree"]) == 1


def test_bad_input_is_counted_by_its_reason(start: Callable[..., NodeProcess], bench: Motions) -> None:
    node = start("retargeting")
    bench.connect()
    bench.measure(np.full(7, np.nan))
    bench.states.publish(JointState(name=["a"], position=[0.0, 1.0]))
    bench.states.publish(JointState(name=["another_joint"], position=[0.0]))
    bench.measure(YUMI.upper_rad + 1.0)
    bench.until_counted(
        "retargeting not_finite", "messages wrong_layout", "retargeting joints_missing", "retargeting outside_limits"
    )
    assert bench.commands == []
    bench.measure()
    bench.probe.until(lambda: bench.commands, "commands")
    bench.move(np.full(7, np.nan))
    bench.move(np.zeros(3), ("a", "b", "c"))
    bench.until_counted("retargeting not_finite", "retargeting wrong_joints")
    lonely = JointTrajectory()
    for number in range(51):
        lonely.header.stamp.sec = number
        bench.motion.publish(lonely)
        bench.probe.spin()
    bench.until_counted("messages unpaired")
    assert bench.status()[2]["messages unpaired"] == "1"
    assert "retargeting wrong_joints" in node.output()
    positions = np.array([list(message.position) for message in bench.commands])
    np.testing.assert_array_equal(positions, np.tile(YUMI.home_rad, (len(positions), 1)))

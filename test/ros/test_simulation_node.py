# SPDX-License-Identifier: Apache-2.0
"""The simulation node over real DDS: a robot that says where it is from the start and follows its commands."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, JointState

from mild_core.signals import JointCommand
from mild_ros.messages.joint_state import joint_command_to_msg
from mild_ros.messages.stamps import ns_from_msg, time_to_msg
from test.ros.processes import NodeProcess, Probe
from test.ros.surroundings import WARN, YUMI, Surroundings

pytestmark = pytest.mark.slow


def where(message: JointState) -> np.ndarray:
    """The commanded joints of a message, in the robot's order."""
    places = dict(zip(message.name, message.position, strict=True))
    return np.array([places[name] for name in YUMI.joint_names])


def test_it_stands_at_home_and_goes_where_it_is_commanded(start: Callable[..., NodeProcess], probe: Probe) -> None:
    around = Surroundings(probe, "simulation")
    states = probe.listen(JointState, "joint_states")
    pictures = probe.listen(Image, "camera/image_raw")
    orders = probe.node.create_publisher(JointState, "joint_command", 10)
    start("simulation", camera_rate_hz=2.0)
    around.connect(orders)
    probe.until(lambda: states, "joint states before any command")
    # A tenth of a degree: the arm holds itself against gravity.
    np.testing.assert_allclose(where(states[-1]), YUMI.home_rad, rtol=0.0, atol=np.deg2rad(0.1))
    around.until_status(WARN, "no joint_command yet")

    # One at a time: of commands only the newest is kept, so of three at once a busy machine sees the last.
    for reason, bad in (
        ("not_finite", JointState(name=["yumi_joint_1_r"], position=[float("nan")])),
        ("wrong_joints", JointState(name=["r2_d2"], position=[0.0])),
        ("wrong_layout", JointState(name=["yumi_joint_1_r", "yumi_joint_2_r"], position=[0.0])),
    ):
        orders.publish(bad)
        around.until_counted(f"messages {reason}")
    np.testing.assert_allclose(where(states[-1]), YUMI.home_rad, rtol=0.0, atol=np.deg2rad(0.1))

    target = YUMI.home_rad + 0.2

    def arrived() -> bool:
        orders.publish(joint_command_to_msg(JointCommand(probe.now_ns(), YUMI.joint_names, target, np.zeros(7))))
        return np.allclose(where(states[-1]), target, rtol=0.0, atol=np.deg2rad(0.5))

    probe.until(arrived, "the target reached")
    stamps = [ns_from_msg(message.header.stamp) for message in states]
    assert np.all(np.diff(stamps) > 0)

    taken, seen = ns_from_msg(states[-1].header.stamp), len(pictures)
    probe.until(lambda: len(pictures) > seen and ns_from_msg(pictures[-1].header.stamp) > taken, "a new picture")
    first, last = (np.frombuffer(pictures[place].data, np.uint8).reshape(480, 640, 3) for place in (0, -1))
    # An arm that moves changes more than a thousandth of the picture.
    assert np.mean(np.any(first != last, axis=2)) > 1e-3


def test_with_a_clock_it_moves_only_as_time_does(start: Callable[..., NodeProcess], probe: Probe) -> None:
    around = Surroundings(probe, "simulation")
    states = probe.listen(JointState, "joint_states")
    orders = probe.node.create_publisher(JointState, "joint_command", 10)
    clock = probe.node.create_publisher(Clock, "/clock", 10)
    start("simulation", use_sim_time=True)
    around.connect(orders, clock)
    around.until_status(WARN, "no /clock yet")
    probe.until(lambda: len(states) > 3, "joint states before the clock starts")
    assert ns_from_msg(states[-1].header.stamp) == 0
    target = YUMI.home_rad + 0.2
    command = joint_command_to_msg(JointCommand(0, YUMI.joint_names, target, np.zeros(7)))

    def at(time_ns: int) -> np.ndarray:
        """Where the robot is when the clock says so."""

        def answered() -> bool:
            orders.publish(command)
            clock.publish(Clock(clock=time_to_msg(time_ns)))
            return ns_from_msg(states[-1].header.stamp) == time_ns

        probe.until(answered, f"joint states at {time_ns}")
        return where(states[-1])

    np.testing.assert_allclose(at(1_000_000_000), YUMI.home_rad, rtol=0.0, atol=np.deg2rad(0.1))
    way = [np.abs(at(1_000_000_000 + step * 10_000_000) - target).max() for step in range(1, 150)]
    assert way[0] > 0.15
    assert way[-1] < np.deg2rad(0.5)

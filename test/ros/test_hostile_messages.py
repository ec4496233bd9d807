# SPDX-License-Identifier: Apache-2.0
"""No message kills a node, on any of its topics: it is alive afterwards, has counted, and takes the next good one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64

from mild_core.errors import DataError
from mild_core.perception.stage import Perception
from mild_core.signals import (
    ARM_FRAME,
    ARM_JOINTS,
    FeatureWindow,
    JointCommand,
    JointMeasurement,
    MotionWindow,
    PersonPose,
)
from mild_ros.messages.feature_window import feature_window_to_msg
from mild_ros.messages.joint_state import joint_command_to_msg, joint_measurement_to_msg
from mild_ros.messages.motion import motion_state_to_msg, motion_to_msg
from mild_ros.messages.person import person_to_msg
from mild_ros.messages.skeletons import ADAPTERS
from mild_ros.node_kit.diagnostics import UNREMARKABLE
from mild_ros.nodes.tracker import FROM_BYTES
from mild_ros.simulation.person import bodies, skeleton_frames
from test.core.perception.scene import SETTINGS, swing
from test.ros.driver_messages import DRIVERS
from test.ros.hostile import hostile
from test.ros.processes import NodeProcess, Probe
from test.ros.surroundings import YUMI, Surroundings

EACH = 60
"""Hostile messages for each topic."""

GAP_S = 0.003
"""Between two, so that queues do not drop them."""

Good = Callable[[int], Iterator[tuple[str, Any]]]
"""Topics and good messages with a stamp [ns]."""


def joint_states(stamp_ns: int) -> Iterator[tuple[str, Any]]:
    yield "joint_states", joint_measurement_to_msg(JointMeasurement(stamp_ns, YUMI.joint_names, YUMI.home_rad))


def motion(stamp_ns: int) -> Iterator[tuple[str, Any]]:
    window = MotionWindow(
        stamp_ns, 25_000_000, 25_000_000, YUMI.joint_names, np.tile(YUMI.home_rad, (40, 1)), np.eye(7) * 1e-4,
        "hand_shake", 0.9, np.array([0.25, 0.75]), 0.5, 0.1,
    )  # fmt: skip
    yield "motion", motion_to_msg(window)
    yield "motion_state", motion_state_to_msg(window, ("hand_shake",))
    pose = PersonPose(stamp_ns, ARM_FRAME, np.zeros(3), np.ones(3), np.ones((2, 3)))
    yield "person", person_to_msg(pose)
    yield from joint_states(stamp_ns)


def window(stamp_ns: int) -> Iterator[tuple[str, Any]]:
    features = np.random.default_rng(stamp_ns % 1000).normal(0.0, 0.1, (40, 3 * len(ARM_JOINTS)))
    yield "feature_window", feature_window_to_msg(FeatureWindow(stamp_ns, ARM_FRAME, ARM_JOINTS, features))
    yield from joint_states(stamp_ns)


def command(stamp_ns: int) -> Iterator[tuple[str, Any]]:
    sent = JointCommand(stamp_ns, YUMI.joint_names, YUMI.home_rad, np.zeros(7))
    yield "joint_command", joint_command_to_msg(sent)
    yield "stiffness", Float64(data=0.5)


def tracker(driver: str) -> Good:
    def seen(stamp_ns: int) -> Iterator[tuple[str, Any]]:
        frame = next(skeleton_frames(bodies(swing(np.zeros(1))), 30.0, stamp_ns))
        yield from DRIVERS[driver].messages(frame)

    return seen


def with_states(driver: str) -> Good:
    def seen(stamp_ns: int) -> Iterator[tuple[str, Any]]:
        yield from tracker(driver)(stamp_ns)
        yield from joint_states(stamp_ns)

    return seen


NODES: dict[str, tuple[str, dict[str, object], Good, tuple[str, ...]]] = {
    "retargeting": ("retargeting", {}, motion, ("motion", "joint_states")),
    "inference": ("inference", {}, window, ("feature_window",)),
    "markers": ("markers", {}, window, ("feature_window",)),
    "simulation": ("simulation", {}, command, ("joint_command",)),
    "pipeline": ("pipeline", {}, with_states("azure_kinect"), ("skeleton", "joint_states")),
    "perception": ("perception", {"source": "nuitrack"}, tracker("nuitrack"), ("skeleton",)),
}


@pytest.mark.parametrize("driver", DRIVERS)
def test_of_any_tracker_only_bad_data_comes(driver: str) -> None:
    """Whatever a driver may send ends as people or as bad data with a reason, in perception too."""
    source = DRIVERS[driver].source
    feeds = {feed.topic: feed for feed in ADAPTERS[source.message].feeds(source)}
    perception, refused, taken = Perception(SETTINGS), 0, 0
    state, now_ns = perception.init(), 10**18
    for seed in range(3):
        for topic, message in tracker(driver)(now_ns + seed * 10**7):
            for number, bad in enumerate(hostile(message, seed, EACH)):
                feed = feeds[topic]
                readable = bad
                if feed.type_name in FROM_BYTES:
                    readable = FROM_BYTES[feed.type_name](bytes(serialize_message(bad)))
                try:
                    people = feed.read(readable, now_ns + number)
                except DataError:
                    refused += 1
                    continue
                if people is not None:
                    taken += 1
                    state, _ = perception.step(state, people, now_ns + number)
    assert refused + taken > EACH


@pytest.mark.slow
@pytest.mark.parametrize(("name", "parameters", "good", "flowing"), NODES.values(), ids=NODES)
def test_no_message_ends_a_node(
    start: Callable[..., NodeProcess],
    probe: Probe,
    random_model: Path,
    name: str,
    parameters: dict[str, object],
    good: Good,
    flowing: tuple[str, ...],
) -> None:
    around = Surroundings(probe, name)
    publishers: dict[str, Any] = {}
    for topic, message in good(probe.now_ns()):
        latched = DurabilityPolicy.TRANSIENT_LOCAL if topic == "stiffness" else DurabilityPolicy.VOLATILE
        if topic == "joint_states":
            publishers[topic] = around.states
        elif topic not in publishers:
            publishers[topic] = probe.node.create_publisher(
                type(message), topic, QoSProfile(depth=200, durability=latched)
            )
    node = start(name, **({} if name == "simulation" else {"model": random_model}), **parameters)
    around.connect(*publishers.values())
    for seed, (topic, message) in enumerate(good(probe.now_ns())):
        for bad in hostile(message, seed, EACH):
            publishers[topic].publish(bad)
            probe.spin(GAP_S)
    probe.until(lambda: len(around.reports) > 3, "reports afterwards")
    assert node.process.poll() is None, node.output()[-2000:]

    def taken() -> bool:
        for topic, message in good(probe.now_ns()):
            publishers[topic].publish(message)
        probe.spin(0.05)
        return node.process.poll() is not None or all(counted(topic) > before[topic] + 3 for topic in flowing)

    def counted(topic: str) -> int:
        return int(around.status()[2][f"{topic} count"])

    before = {topic: counted(topic) for topic in flowing}
    probe.until(taken, "good messages are taken")
    assert node.process.poll() is None, node.output()[-2000:]
    values = around.status()[2]
    stages = ("messages", *UNREMARKABLE)
    counted_as = {key for key in values if key.split(" ")[0] in stages and len(key.split(" ")) == 2}
    well = {f"{stage} {outcome}" for stage, outcomes in UNREMARKABLE.items() for outcome in outcomes}
    assert counted_as - well, "hostile messages are counted"
    assert "messages unusable" not in values, node.output()[-3000:]  # each is bad data with a reason of its own
    assert all(text.isprintable() for text in (*values, *values.values()))
    assert "\x1b" not in node.output().replace("\x1b[0m", "").replace("\x1b[33m", "").replace("\x1b[31m", "")

# SPDX-License-Identifier: Apache-2.0
"""Replay in process is deterministic, and nodes over DDS give the same commands, in one process or in three."""

from __future__ import annotations

import hashlib
import itertools
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from mild_core.inference.manifest import ControlledAgent
from mild_core.perception.skeletons import SOURCES
from mild_core.pipeline import Pipeline
from mild_core.retargeting.robots.pepper import PEPPER
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Request
from mild_core.retargeting.trajectory_stream import STAND_S
from mild_core.signals import ARM_JOINTS
from mild_ros.assembly.bag_settings import ReplayParameters
from mild_ros.assembly.inference import load
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.settings import NODES, PipelineParameters
from mild_ros.bag.encoding import encode, type_name_of
from mild_ros.bag.reader import open_bag
from mild_ros.bag.writer import create_bag
from mild_ros.commands.controller_messages import ControllerMessages
from mild_ros.replay.events import TICK, with_ticks
from mild_ros.replay.in_process import Inputs, ReplaySummary, fold, replay_in_process
from mild_ros.simulation.person import bodies, skeleton_frames
from test.replay.made_model import save_random_model
from test.replay.processes import node, wait_until
from test.ros.driver_messages import DRIVERS
from tools.scenes import SCENES, arm_track, write_scene

INTERACTION = "hand_shake"
"""Given, not recognised: a model with random weights recognises nothing."""

INPUTS = Inputs(SOURCES["azure_kinect"], YUMI)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_random_model(tmp_path_factory.mktemp("models") / "random")


@pytest.fixture(scope="module")
def pipeline(model: Path) -> Pipeline:
    parameters = PipelineParameters(model=str(model), interaction=INTERACTION)
    return make_pipeline(parameters, load(parameters.model))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first six seconds of a handshake: calibration, the first window, the hand is offered and shaken."""
    whole, cut = tmp_path_factory.mktemp("bags") / "whole", tmp_path_factory.mktemp("bags") / "cut"
    write_scene(next(scene for scene in SCENES if scene.name == "handshake"), whole)
    with open_bag(whole) as bag, create_bag(cut) as shorter:
        messages = list(bag.messages())
        for raw in messages:
            if raw.time_ns - messages[0].time_ns < 6_000_000_000:
                shorter.write(raw.topic, raw.type_name, raw.time_ns, raw.data)
    return cut


@pytest.fixture(scope="module")
def in_process(scene: Path, pipeline: Pipeline, tmp_path_factory: pytest.TempPathFactory) -> tuple[ReplaySummary, Path]:
    output = tmp_path_factory.mktemp("replayed") / "out"
    return replay_in_process(scene, pipeline, INPUTS, output), output


def test_a_reset_forgets_in_all_three_stages_but_keeps_their_counts(scene: Path, pipeline: Pipeline) -> None:
    state = pipeline.init()
    with open_bag(scene) as bag:
        for step in fold(bag, pipeline, INPUTS):
            state, now_ns = step.state, step.event.time_ns
    assert state.perception.person is not None
    assert state.retargeting.plan is not None
    after, output = pipeline.step(state, Request("reset"), now_ns)
    fresh = pipeline.init()
    assert after.perception.person is None
    assert after.perception.calibration is None
    assert state.inference.index > 0
    assert state.inference.stamp_ns is not None
    assert (after.inference.index, after.inference.stamp_ns) == (fresh.inference.index, fresh.inference.stamp_ns)
    assert after.retargeting.plan is None
    assert after.retargeting.outcome == "reset"
    assert after.perception.counts == state.perception.counts
    assert after.inference.counts == state.inference.counts
    assert after.retargeting.counts == {**state.retargeting.counts, "reset": 1}
    assert output.commands == ()
    assert output.motions == ()


def command_bytes(path: Path) -> list[bytes]:
    with open_bag(path) as bag:
        return [raw.data for raw in bag.messages(["/joint_command"])]


def test_the_same_bag_gives_the_same_bytes(
    scene: Path, pipeline: Pipeline, in_process: tuple[ReplaySummary, Path], tmp_path: Path
) -> None:
    first, output = in_process
    second = replay_in_process(scene, pipeline, INPUTS, tmp_path / "again")
    assert first == second
    assert command_bytes(output) == command_bytes(tmp_path / "again")
    assert hashlib.sha256(b"".join(command_bytes(output))).hexdigest() == first.digest
    assert first.commands == len(command_bytes(output)) > 500
    assert first.counts["retargeting"]["accepted"] > 50, "the robot follows, so equal commands mean something"


def test_every_message_is_accounted_for(in_process: tuple[ReplaySummary, Path], scene: Path) -> None:
    summary, output = in_process
    with open_bag(scene) as bag:
        skeletons = bag.topics["/body_tracking_data"].count
    perception = summary.counts["perception"]
    assert perception["calibrating"] + perception["accepted"] == skeletons
    with open_bag(output) as bag:
        assert bag.topics["/skeleton"].count == skeletons
        assert bag.topics["/motion"].count == bag.topics["/motion_state"].count == summary.motions


def test_unreadable_messages_are_counted_and_passed_over(scene: Path, pipeline: Pipeline, tmp_path: Path) -> None:
    with open_bag(scene) as bag, create_bag(tmp_path / "bag") as broken:
        for index, raw in enumerate(bag.messages()):
            data = raw.data[:100] if index % 20 == 10 else raw.data
            broken.write(raw.topic, raw.type_name, raw.time_ns, data)
    summary = replay_in_process(tmp_path / "bag", pipeline, INPUTS)
    assert summary.counts["messages"] == {"undecodable": 9}
    assert summary.commands > 500


def test_ticks_lie_on_a_grid_from_the_first_message_and_come_before_messages(scene: Path) -> None:
    with open_bag(scene) as bag:
        events = list(with_ticks(INPUTS.messages(bag)))
    ticks = [event.time_ns for event in events if event.input == TICK]
    assert ticks == list(range(events[0].time_ns, events[-1].time_ns + 1, 10_000_000))
    assert all(a.time_ns <= b.time_ns for a, b in itertools.pairwise(events))
    assert [event.input for event in events[:3]] == [TICK, "joint_states", "skeleton"]


def with_joints_named(scene: Path, path: Path, names: tuple[str, ...]) -> Path:
    """The scene with other names in its joint_states; without any if there are no names."""
    with open_bag(scene) as bag, create_bag(path) as changed:
        for raw in bag.messages(["/body_tracking_data", *["/joint_states"][: len(names)]]):
            data = raw.data
            if raw.topic == "/joint_states":
                values = bag.decode(raw)
                values.name = list(names)
                data = encode(values)
            changed.write(raw.topic, raw.type_name, raw.time_ns, data)
    return path


@pytest.mark.parametrize("names", [(), ("panda_joint1", "a", "b", "c", "d", "e", "f")])
def test_without_joint_states_of_its_own_the_robot_is_taken_to_stand_at_home(
    scene: Path, pipeline: Pipeline, in_process: tuple[ReplaySummary, Path], tmp_path: Path, names: tuple[str, ...]
) -> None:
    summary = replay_in_process(with_joints_named(scene, tmp_path / "bag", names), pipeline, INPUTS)
    assert summary.digest == in_process[0].digest
    note = "its joint_states (a and 6 others) are not of yumi, which begins at home"
    assert summary.note == (note if names else "")


def test_joints_may_have_other_names_in_the_bag(
    scene: Path, pipeline: Pipeline, in_process: tuple[ReplaySummary, Path], tmp_path: Path
) -> None:
    names = tuple(f"yumi_robr_joint_{number}" for number in range(1, 8))
    bag = with_joints_named(scene, tmp_path / "bag", names)
    summary = replay_in_process(bag, pipeline, replace(INPUTS, joint_names=names))
    assert summary == in_process[0]


def test_a_replay_can_be_followed_step_by_step(
    scene: Path, pipeline: Pipeline, in_process: tuple[ReplaySummary, Path]
) -> None:
    with open_bag(scene) as bag:
        commands = [command for step in fold(bag, pipeline, INPUTS) for command in step.output.commands]
    assert len(commands) == in_process[0].commands
    assert {command.mode for command in commands} >= {"idle", "following"}


class Listener(Node):
    """Keeps every command."""

    def __init__(self) -> None:
        super().__init__("listener")
        self.commands: list[JointState] = []
        self.create_subscription(JointState, "joint_command", self.commands.append, QoSProfile(depth=5000))


@pytest.fixture
def listener(ros_domain: int) -> Iterator[Listener]:
    rclpy.init()
    listener = Listener()
    yield listener
    listener.destroy_node()
    rclpy.try_shutdown()


STAGES = {"pipeline": ("pipeline",), "three nodes": ("perception", "inference", "retargeting")}


@pytest.fixture(scope="module")
def partner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of two people: its motions are about a half offered arm."""
    bent_m = np.array([0.0, 0.0, 0.0, 0.15, -0.05, -0.2, 0.4, -0.05, -0.1])
    agent = ControlledAgent("human_arm", "human", ARM_JOINTS, "m")
    return save_random_model(tmp_path_factory.mktemp("models") / "partner", agent, bent_m, 0.05)


@pytest.mark.slow
def test_motion_capture_and_a_partners_arm_reach_pepper_through_three_nodes(
    partner: Path, listener: Listener, tmp_path: Path
) -> None:
    """A tracker with a topic for each joint at one end, a model of two people at the other."""
    driver = DRIVERS["motion_capture"]
    places = {name: place for name, (place,) in driver.source.places.items()}
    tracker = {"source": "motion_capture", "joint_names": tuple(places), "joint_places": tuple(places.values())}
    handshake = next(scene for scene in SCENES if scene.name == "handshake")
    with create_bag(tmp_path / "bag") as bag:
        for frame in skeleton_frames(bodies(arm_track(handshake, 20.0)[:70]), 20.0, 10**18):
            for topic, message in driver.messages(frame):
                bag.write(topic, type_name_of(message), frame.stamp_ns, encode(message))
    given = {**tracker, "model": str(partner), "robot": "pepper", "source_axes": "rep103"}
    pipeline = make_pipeline(PipelineParameters(**given, interaction=INTERACTION), load(str(partner)))
    inputs = Inputs(driver.source, PEPPER, joint_states="home")
    summary = replay_in_process(tmp_path / "bag", pipeline, inputs, tmp_path / "out")
    assert summary.counts["retargeting"]["accepted"] > 20
    expected = command_bytes(tmp_path / "out")
    listed = {name: f"[{', '.join(value)}]" if isinstance(value, tuple) else value for name, value in given.items()}
    same_bits(through_nodes(STAGES["three nodes"], tmp_path / "bag", listener, len(expected), listed), expected)


@pytest.mark.slow
@pytest.mark.parametrize("nodes", list(STAGES.values()), ids=list(STAGES))
def test_two_roads_give_the_same_commands(
    nodes: tuple[str, ...],
    scene: Path,
    model: Path,
    in_process: tuple[ReplaySummary, Path],
    listener: Listener,
    tmp_path: Path,
) -> None:
    """A recorder is part of the lock-step: it writes down all, at times of the bag."""
    expected, recorded = command_bytes(in_process[1]), tmp_path / "recorded"
    same_bits(through_nodes(nodes, scene, listener, len(expected), {"model": model}, recorded), expected)
    with open_bag(scene) as given, open_bag(recorded) as bag:
        assert [encode(bag.decode(raw)) for raw in bag.messages(["/joint_command"])] == expected
        sent = sum(summary.count for topic, summary in given.topics.items() if topic != "/joint_states")
        assert bag.topics["/skeleton"].count == sent
        assert 0 <= bag.start_ns - given.start_ns < 10**9
        assert bag.duration_s <= given.duration_s + 0.1


def through_nodes(
    nodes: tuple[str, ...],
    scene: Path,
    listener: Listener,
    count: int,
    shared: dict[str, object],
    recorded: Path | None = None,
) -> list[JointState]:
    """The first `count` commands of real nodes with `shared` parameters, the scene replayed to them in lock-step."""
    executor = SingleThreadedExecutor()
    executor.add_node(listener)
    started: list[subprocess.Popen[str]] = []
    with ExitStack() as stack:
        for name in nodes:
            known = {entry.name for entry in fields(NODES[name])}
            values = {name: value for name, value in (shared | {"interaction": INTERACTION}).items() if name in known}
            started.append(stack.enter_context(node(name, {"report_handled": True, "use_sim_time": True} | values)))
        wait_until(lambda: listener.count_publishers("joint_command") > 0, "publisher of joint_command")
        replaying = {"bag": scene, "mode": "lock_step", "reporters": len(nodes)}
        known = {entry.name for entry in fields(ReplayParameters)}
        replaying |= {name: value for name, value in shared.items() if name in known}
        replaying |= {"joint_states": "home"} if "robot" in shared else {}
        if recorded is not None:
            replaying |= {"recorders": 1, "subscribers": 2}
            recording = {"bag": recorded, "topics": "[skeleton, joint_command, handled]", "report_recorded": True}
            started.append(stack.enter_context(node("record", recording | {"use_sim_time": True})))
        replay = stack.enter_context(node("replay", replaying))
        started.append(replay)

        def complete() -> bool:
            executor.spin_once(timeout_sec=0.01)
            for ended in (one for one in started if one.poll()):
                raise AssertionError(ended.communicate()[1])
            return len(listener.commands) >= count

        wait_until(complete, f"{count} commands", seconds=180.0)
        output, errors = replay.communicate(timeout=60)
    assert replay.returncode == 0, output + errors
    return listener.commands


def same_bits(commands: list[JointState], expected: list[bytes]) -> None:
    """Names, stamps, positions and velocities are equal to the last bit."""
    assert len(commands) == len(expected)
    for index, (command, data) in enumerate(zip(commands, expected, strict=True)):
        assert encode(command) == data, f"command {index}"
    moved = np.ptp([command.position for command in commands], axis=0)
    assert moved.max() > 0.05, "the robot moved"


def test_messages_for_controllers_are_written_too(model: Path, scene: Path, tmp_path: Path) -> None:
    """The same every time, and those of types that are not installed are named."""
    parameters = PipelineParameters(
        model=str(model), interaction=INTERACTION, outputs=("joint_trajectory", "position_command", "joint_angles")
    )
    pipeline = make_pipeline(parameters, load(parameters.model))
    written, notes = [], []
    for name in ("first", "second"):
        controllers = ControllerMessages(parameters, pipeline.retargeting, INPUTS.naming)
        summary = replay_in_process(scene, pipeline, INPUTS, tmp_path / name, controllers=controllers)
        notes.append(summary.note)
        with open_bag(tmp_path / name) as bag:
            counts = {topic: bag.topics[topic].count for topic in ("/joint_trajectory", "/position_command")}
            written.append([raw.data for raw in bag.messages(["/joint_trajectory", "/position_command"])])
            assert "/joint_angles" not in bag.topics
    assert written[0] == written[1]
    assert counts["/position_command"] == summary.commands
    stands = round(2 * STAND_S * 100)  # a stream begins with one point at rest, and once more after it has held
    assert 0.8 * (summary.commands - stands) < counts["/joint_trajectory"] <= summary.commands
    absent = "joint_angles is not written: the type naoqi_bridge_msgs/msg/JointAnglesWithSpeed is not installed here"
    assert notes == [absent, absent]

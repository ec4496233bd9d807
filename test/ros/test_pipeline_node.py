# SPDX-License-Identifier: Apache-2.0
"""The pipeline node over real DDS: a person moves, the robot moves; whatever else comes, it goes on and holds."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from mild_core.perception.skeletons import SOURCES, SkeletonSource
from mild_core.signals import SkeletonFrame
from mild_ros.messages.feature_window import feature_window_from_msg
from mild_ros.messages.motion import motion_from_msgs
from mild_ros.messages.stamps import ns_from_msg
from mild_ros.simulation.person import BODY_JOINTS
from test.core.inference.random_model import INTERACTIONS
from test.ros.processes import NodeProcess, Probe
from test.ros.surroundings import OK, WARN, YUMI, Person, Surroundings

AZURE_KINECT = SOURCES["azure_kinect"]
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

pytestmark = pytest.mark.slow


class Room:
    """A person and a robot, and the pipeline node between them."""

    def __init__(self, probe: Probe, name: str = "pipeline", source: SkeletonSource = AZURE_KINECT) -> None:
        self.probe = probe
        self.around = Surroundings(probe, name)
        self.person = Person(probe, source)

    def live(self, done: Callable[[], Any], what: str, change: Callable[[SkeletonFrame], Any] = lambda it: it) -> None:
        """The person acts and the robot obeys until something has happened."""

        def lived() -> Any:
            self.person.act(change)
            self.around.obey()
            return done()

        self.probe.until(lived, what)

    def moved(self) -> bool:
        """The robot has left home by more than a hundredth of a radian."""
        commands = self.around.commands
        return bool(commands) and float(np.abs(np.array(commands[-1].position) - YUMI.home_rad).max()) > 0.01

    def counted(self, key: str, least: int = 1) -> Callable[[], bool]:
        return lambda: int(self.around.status()[2].get(key, "0")) >= least


@pytest.fixture
def room(probe: Probe) -> Room:
    return Room(probe)


def test_a_person_moves_the_robot_and_everybody_can_see_why(
    start: Callable[..., NodeProcess], room: Room, probe: Probe, random_model: Path
) -> None:
    windows, motions, states = (
        probe.listen(kind, topic)
        for kind, topic in ((PointCloud2, "feature_window"), (JointTrajectory, "motion"), (PointCloud2, "motion_state"))
    )
    beliefs = probe.listen(Float64MultiArray, "belief")
    start("pipeline", model=random_model, interaction="hand_shake", home_after_s=2.0)
    room.around.connect(room.person.publisher, room.around.states)
    room.live(room.counted("retargeting accepted", 40), "a second of following")
    room.live(lambda: room.around.status()[2].get("mode") == "following", "a report of following")
    level, message, _ = room.around.status()
    assert level == OK or "camera" in message, "an unmeasured camera is warned of, and nothing else"

    values = room.around.status()[2]
    assert values["interaction"] == "hand_shake"
    assert values["mode"] == "following"
    assert float(values["skeleton rate [Hz]"]) > 10.0
    assert float(values["joint_command rate [Hz]"]) > 50.0
    assert 0.0 < float(values["step p50 [ms]"]) <= float(values["step max [ms]"])
    assert 0.0 < float(values["age of an answer p50 [ms]"]) <= float(values["age of a tick max [ms]"])
    assert int(values["perception calibrated"]) == 1

    interaction = probe.listen(String, "interaction", LATCHED)
    probe.until(lambda: interaction, "the latched interaction")
    assert interaction[0].data == "hand_shake"
    assert beliefs[-1].layout.dim[0].label == "hand_shake component"
    # The belief is a distribution; its sum is rounded.
    assert sum(beliefs[-1].data) == pytest.approx(1.0, abs=1e-9)
    window = feature_window_from_msg(windows[-1], ("shoulder", "elbow", "hand"))
    assert window.features.shape == (40, 9)
    paired = [(m, s) for m in motions for s in states if m.header.stamp == s.header.stamp]
    motion = motion_from_msgs(*paired[-1])
    assert motion.joint_names == YUMI.joint_names
    assert motion.interaction in INTERACTIONS
    assert {ns_from_msg(m.header.stamp) for m in motions} & {ns_from_msg(w.header.stamp) for w in windows}

    room.live(lambda: room.around.status()[2]["mode"] == "holding", "holding", lambda frame: None)
    room.live(lambda: room.around.commands_reach(YUMI.home_rad), "home again", lambda frame: None)
    assert room.counted("perception no_person")()
    room.around.until_status(WARN, "no skeleton for")


def test_a_person_as_a_pose_array_moves_the_robot_too(
    start: Callable[..., NodeProcess], probe: Probe, random_model: Path
) -> None:
    room = Room(probe, source=SOURCES["pose_array"].with_joints(BODY_JOINTS, "optical"))
    tracker = {"source": "pose_array", "joint_names": BODY_JOINTS, "source_axes": "optical"}
    start("pipeline", model=random_model, interaction="hand_shake", **tracker)
    room.around.connect(room.person.publisher, room.around.states)
    room.live(room.moved, "the robot moved")
    room.live(room.counted("perception no_person"), "no_person counted", lambda frame: None)
    assert room.around.status()[2]["interaction"] == "hand_shake"


def test_the_operator_is_obeyed(start: Callable[..., NodeProcess], room: Room, random_model: Path) -> None:
    start("pipeline", model=random_model, interaction="hand_shake", enabled=False)
    room.around.connect(room.person.publisher, room.around.states)
    room.live(room.counted("retargeting not_enabled"), "refused motions")
    assert room.around.commands == []
    assert room.probe.call(SetBool, "/pipeline/enable", SetBool.Request(data=True)).success
    room.live(room.moved, "the robot moved")
    assert room.probe.call(Trigger, "/pipeline/reset", Trigger.Request()).success
    room.live(room.counted("perception calibrated", 2), "calibrated again")
    room.live(room.counted("retargeting reset"), "reset")


def test_three_nodes_do_it_too_and_each_can_be_stopped(
    start: Callable[..., NodeProcess], probe: Probe, random_model: Path
) -> None:
    room = Room(probe, "retargeting")
    start("perception", model=random_model)
    start("inference", model=random_model, interaction="hand_shake")
    start("retargeting")
    room.around.connect(room.person.publisher, room.around.states)
    room.live(room.moved, "the robot moved")
    for name in ("perception", "inference"):
        assert probe.call(SetBool, f"/{name}/enable", SetBool.Request(data=False)).success
        room.live(lambda: room.around.status()[2]["mode"] == "holding", f"holding without {name}")
        assert probe.call(SetBool, f"/{name}/enable", SetBool.Request(data=True)).success
        room.live(lambda: room.around.status()[2]["mode"] == "following", f"following with {name}")
        assert probe.call(Trigger, f"/{name}/reset", Trigger.Request()).success
        room.live(lambda: room.around.status()[2]["mode"] == "following", f"following after a reset of {name}")


def test_a_signal_at_work_ends_it_with_code_0(
    start: Callable[..., NodeProcess], room: Room, random_model: Path
) -> None:
    node = start("pipeline", model=random_model, interaction="hand_shake", report_handled=True)
    room.around.connect(room.person.publisher, room.around.states)
    room.live(lambda: len(room.around.commands) > 20, "commands")
    assert node.stop(signal.SIGINT) == 0
    assert "Traceback" not in node.output()

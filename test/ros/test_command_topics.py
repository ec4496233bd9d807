# SPDX-License-Identifier: Apache-2.0
"""Nothing that commands a robot comes out of a bag, whatever its name there, and a new output is known at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header, String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from mild_core.errors import SetupError
from mild_core.perception.skeletons import SOURCES
from mild_core.retargeting.robots import ROBOTS
from mild_ros.bag.encoding import encode, type_name_of
from mild_ros.bag.reader import open_bag
from mild_ros.bag.writer import create_bag
from mild_ros.commands.command_topics import JOINT_COMMAND, command_types, commands_a_robot
from mild_ros.controllers import OUTPUTS
from mild_ros.controllers.output import ControllerOutput
from mild_ros.nodes import commanding
from mild_ros.replay.in_process import Inputs
from tools import documentation

HARMLESS = {"/note": String(), "/belief": Float64MultiArray(), "/camera/joint_command_note": String()}
COMMANDS = {
    "/joint_command": JointState(),
    "/robot1/joint_command": JointState(),
    "/robot1/position_command": Float64MultiArray(),
    "/arm/joint_trajectory": JointTrajectory(),
    "/right_arm_controller/anything": JointTrajectory(),
    "/right_arm_positions/commands": Float64MultiArray(),
}


def bag_of(folder: Path, messages: dict[str, Any]) -> Path:
    with create_bag(folder / "bag") as bag:
        bag.write("/bodies", "visualization_msgs/msg/MarkerArray", 1, encode(MarkerArray()))
        for topic, message in messages.items():
            bag.write(topic, type_name_of(message), 2, encode(message))
    return folder / "bag"


def sent(bag: Path, *also: str) -> set[str]:
    """Topics that a replay sends under their own names."""
    inputs = Inputs(SOURCES["azure_kinect"], ROBOTS["yumi"], joint_states="none", also=also)
    with open_bag(bag) as opened:
        return set(inputs.topics(opened)) - {"/bodies"}


def test_all_of_a_bag_is_all_but_commands(tmp_path: Path) -> None:
    assert sent(bag_of(tmp_path, HARMLESS | COMMANDS), "all") == set(HARMLESS)


@pytest.mark.parametrize("topic", sorted(COMMANDS))
def test_a_command_is_not_replayed_by_name_either(tmp_path: Path, topic: str) -> None:
    bag = bag_of(tmp_path, HARMLESS | COMMANDS)
    assert sent(bag, "note") == {"/note"}
    with pytest.raises(SetupError, match=f"{topic} commands a robot and is never replayed"):
        sent(bag, topic)


@pytest.mark.parametrize(
    ("type_name", "message", "topics"),
    [
        ("std_msgs/msg/Header", Header(), {"/new_output", "/left/new_output"}),
        ("trajectory_msgs/msg/JointTrajectoryPoint", None, {"/new_output", "/elsewhere"}),
    ],
)
def test_a_new_output_is_never_replayed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, type_name: str, message: Any, topics: set[str]
) -> None:
    """It is enough to put it into the table."""
    if message is None:
        from trajectory_msgs.msg import JointTrajectoryPoint

        message = JointTrajectoryPoint()
    bag = bag_of(tmp_path, HARMLESS | dict.fromkeys(topics, message))
    assert sent(bag, "all") == set(HARMLESS) | topics
    output = ControllerOutput("new_output", type_name, "its controller", "its numbers", lambda kind, outgoing: kind())
    monkeypatch.setitem(OUTPUTS, output.topic, output)
    assert sent(bag, "all") == set(HARMLESS)
    assert "new_output" in command_types()


def test_a_command_that_was_remapped_is_not_among_all(tmp_path: Path) -> None:
    remapped = {"/arm/setpoints": JointState(), "/forward/targets": Float64MultiArray()}
    measured = {"/left/joint_states": JointState(), "/belief": Float64MultiArray()}
    bag = bag_of(tmp_path, remapped | measured)
    assert sent(bag, "all") == set(measured)
    assert sent(bag, "/arm/setpoints") == {"/arm/setpoints"}, "who names it knows what it is"


def test_every_output_commands_a_robot_in_any_namespace() -> None:
    for topic, type_name in command_types().items():
        for name in (topic, f"/{topic}", f"/left/{topic}"):
            assert commands_a_robot(name, type_name)
    assert not commands_a_robot("/joint_states", "sensor_msgs/msg/JointState")
    assert commands_a_robot("/pepper/anything", "naoqi_bridge_msgs/msg/JointAnglesWithSpeed")


def test_there_is_one_list_of_command_topics() -> None:
    assert commanding.TOPIC == JOINT_COMMAND
    assert documentation.DELIVERY["COMMAND"][0] == ", ".join(f"`{topic}`" for topic in command_types())
    assert set(command_types()) <= {topic.name for topic in documentation.TOPICS}

# SPDX-License-Identifier: Apache-2.0
"""A bag in place of a tracker, and a simulated robot; ends when the bag does.

ros2 launch mild_ros replay.launch.py bag:=bags/handshake
ros2 launch mild_ros replay.launch.py bag:=old.bag skeleton_topic:=/bodies rate:=0.5 record:=what_happened
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
    Shutdown,
    TimerAction,
)
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import (
    LaunchConfiguration,
    NotEqualsSubstitution,
    PathJoinSubstitution,
    PythonExpression,
)
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from mild_ros.bag_camera import camera_for

ARGUMENTS = {
    "namespace": ("", "Before every name: one for each robot and its person."),
    "config": (
        "yumi",
        "Parameters: a name in share/mild_ros/config, or a path; with a section for `replay` the bag's `source`.",
    ),
    "skeleton_topic": ("", "Topic of the skeletons in the bag; empty finds it by its type."),
    "rate": ("1.0", "2.0 is twice as fast."),
    "start_s": ("0.0", "How much of the beginning to skip."),
    "loop": ("false", "Begin again after the end."),
    "paused": ("false", "Wait until `replay/pause` is called with false."),
    "gui": ("false", "Open a window with the robot."),
    "record": ("", "Folder of a new bag with what happens; empty for none."),
}


def _replay(given: dict[str, LaunchConfiguration], config: list) -> Node:
    """The node that sends the bag, and ends everything when it has."""
    texts = {name: ParameterValue(given[name], value_type=str) for name in ("bag", "skeleton_topic")}
    numbers = {name: ParameterValue(given[name], value_type=float) for name in ("rate", "start_s")}
    flags = {name: ParameterValue(given[name], value_type=bool) for name in ("loop", "paused")}
    recorders = PythonExpression(["2 if '", given["record"], "' else 1"])  # a recorder listens before the pipeline does
    listeners = ParameterValue(recorders, value_type=int)
    return Node(
        package="mild_ros",
        executable="replay",
        name="replay",
        namespace=given["namespace"],
        ros_arguments=config,
        parameters=[{**texts, **numbers, **flags, "subscribers": listeners, "patience_s": 300.0}],
        output="screen",
        on_exit=Shutdown(reason="the bag has ended"),
    )


def _simulation(context: LaunchContext, given: dict[str, LaunchConfiguration]) -> list[IncludeLaunchDescription]:
    """Pipeline and simulated robot, who see people where the bag's camera saw them."""
    simulated = PathJoinSubstitution([FindPackageShare("mild_ros"), "launch", "simulation.launch.py"])
    camera = camera_for(given["config"].perform(context), Path(given["bag"].perform(context)))
    passed_on = [(name, given[name]) for name in ("namespace", "config", "gui")]
    # A node that fails ends the replay: one that starts in its midst would make another of it.
    passed_on += [("robot_from_camera", camera), ("respawn", "false")]
    return [IncludeLaunchDescription(PythonLaunchDescriptionSource(simulated), launch_arguments=passed_on)]


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    given = {name: LaunchConfiguration(name) for name in ("bag", *ARGUMENTS)}
    share = FindPackageShare("mild_ros")
    stem = PythonExpression(["'", given["config"], "'.removesuffix('.yaml')"])
    # Not as `parameters`: a file that is not there would be passed over, and another robot commanded.
    config = ["--params-file", [PathJoinSubstitution([share, "config", stem]), ".yaml"]]
    simulation = OpaqueFunction(function=_simulation, args=[given])
    record = Node(
        package="mild_ros",
        executable="record",
        name="record",
        namespace=given["namespace"],
        parameters=[{"bag": ParameterValue(given["record"], value_type=str)}],
        output="screen",
        condition=IfCondition(NotEqualsSubstitution(given["record"], "")),
    )
    # Whoever could not start has said why, and replay would wait for it; others may be about to say the same.
    failed = OnProcessExit(
        on_exit=lambda event, _: (
            TimerAction(period=5.0, actions=[Shutdown(reason="a node has failed")]) if event.returncode else None
        )
    )
    arguments = [DeclareLaunchArgument("bag", description="Folder or file of the bag.")]
    arguments += [
        DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, RegisterEventHandler(failed), simulation, record, _replay(given, config)])

# SPDX-License-Identifier: Apache-2.0
"""A tracker and a robot that are there: all three stages, in one process.

ros2 launch mild_ros live.launch.py skeleton:=/k4a/body_tracking_data config:=yumi_abb
ros2 launch mild_ros live.launch.py namespace:=left skeleton:=/camera_left/bodies joint_states:=/yumi_l/joint_states
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "namespace": ("", "Before every name: one for each robot and its person."),
    "config": ("yumi", "Parameters: a name in share/mild_ros/config, or a path."),
    "skeleton": ("skeleton", "Topic of the tracker."),
    "joint_states": ("joint_states", "Topic where the robot says where it is."),
    "joint_command": ("joint_command", "Topic of the commands."),
    "trajectory": ("joint_trajectory", "Topic of the JointTrajectoryController, if the configuration has that output."),
    "robot_from_camera": ("", "Pose of the tracker's frame in the robot's base; empty takes the configuration's."),
    "use_sim_time": ("false", "Take the time from `/clock`."),
    "respawn": ("true", "Start a node again that has ended by itself, after two seconds."),
}


RESPAWN_DELAY_S = 2.0
"""DDS needs up to this long to miss the commands of a node that died, and the new one looks for others first."""


def _pipeline(context: LaunchContext, given: dict[str, LaunchConfiguration], config: list) -> list[Node]:
    """The node; a parameter that is given here counts more than the same one in the file."""
    parameters = {"use_sim_time": given["use_sim_time"]}
    camera = given["robot_from_camera"].perform(context)
    if camera:
        parameters["robot_from_camera"] = ParameterValue(camera, value_type=str)
    node = Node(
        package="mild_ros",
        executable="pipeline",
        name="pipeline",
        namespace=given["namespace"],
        ros_arguments=config,
        parameters=[parameters],
        remappings=[
            *((name, given[name]) for name in ("skeleton", "joint_states", "joint_command")),
            ("joint_trajectory", given["trajectory"]),
        ],
        output="screen",
        respawn=given["respawn"],
        respawn_delay=RESPAWN_DELAY_S,
    )
    return [node]


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    stem = PythonExpression(["'", given["config"], "'.removesuffix('.yaml')"])
    # Not as `parameters`: a file that is not there would be passed over, and another robot commanded.
    config = ["--params-file", [PathJoinSubstitution([FindPackageShare("mild_ros"), "config", stem]), ".yaml"]]
    arguments = [
        DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_pipeline, args=[given, config])])

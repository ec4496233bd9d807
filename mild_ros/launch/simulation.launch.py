# SPDX-License-Identifier: Apache-2.0
"""A tracker that is there and a simulated robot.

ros2 launch mild_ros simulation.launch.py skeleton:=/k4a/body_tracking_data gui:=true
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "namespace": ("", "Before every name: one for each robot and its person."),
    "config": ("yumi", "Parameters: a name in share/mild_ros/config, or a path."),
    "skeleton": ("skeleton", "Topic of the tracker."),
    "robot_from_camera": ("", "Pose of the tracker's frame in the robot's base; empty takes the configuration's."),
    "gui": ("false", "Open a window with the robot."),
    "use_sim_time": ("false", "Take the time from `/clock`."),
    "respawn": ("true", "Start a node again that has ended by itself, after two seconds."),
}


PASSED_ON = ("namespace", "config", "skeleton", "robot_from_camera", "use_sim_time", "respawn")
"""To the pipeline."""

RESPAWN_DELAY_S = 2.0
"""DDS needs up to this long to miss the commands of a node that died, and the new one looks for others first."""


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    share = FindPackageShare("mild_ros")
    stem = PythonExpression(["'", given["config"], "'.removesuffix('.yaml')"])
    # Not as `parameters`: a file that is not there would be passed over, and another robot commanded.
    config = ["--params-file", [PathJoinSubstitution([share, "config", stem]), ".yaml"]]
    live = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(PathJoinSubstitution([share, "launch", "live.launch.py"])),
        launch_arguments=[(name, given[name]) for name in PASSED_ON],
    )
    simulation = Node(
        package="mild_ros",
        executable="simulation",
        name="simulation",
        namespace=given["namespace"],
        ros_arguments=config,
        parameters=[{"gui": given["gui"], "use_sim_time": given["use_sim_time"]}],
        output="screen",
        respawn=given["respawn"],
        respawn_delay=RESPAWN_DELAY_S,
    )
    arguments = [
        DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, live, simulation])

# SPDX-License-Identifier: Apache-2.0
"""A tracker and a robot that are there: all three stages, in one process.

ros2 launch mild_ros live.launch.py skeleton:=/k4a/body_tracking_data config:=yumi_abb
ros2 launch mild_ros live.launch.py namespace:=left skeleton:=/camera_left/bodies joint_states:=/yumi_l/joint_states

Without `ros2 launch`: ./mild launch live with the same arguments. See mild_ros/launching/table.py.
"""

from launch import LaunchDescription

from mild_ros.launching.description import describe


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    return describe("live")

# SPDX-License-Identifier: Apache-2.0
"""A bag in place of a tracker, and a simulated robot; ends when the bag does.

ros2 launch mild_ros replay.launch.py bag:=bags/handshake
ros2 launch mild_ros replay.launch.py bag:=old.bag skeleton_topic:=/bodies rate:=0.5 record:=what_happened

Without `ros2 launch`: ./mild launch replay with the same arguments. See mild_ros/launching/table.py.
"""

from launch import LaunchDescription

from mild_ros.launching.description import describe


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    return describe("replay")

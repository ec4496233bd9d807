# SPDX-License-Identifier: Apache-2.0
"""A tracker that is there and a simulated robot.

ros2 launch mild_ros simulation.launch.py skeleton:=/k4a/body_tracking_data gui:=true

Without `ros2 launch`: ./mild launch simulation with the same arguments. See mild_ros/launching/table.py.
"""

from launch import LaunchDescription

from mild_ros.launching.description import describe


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    return describe("simulation")

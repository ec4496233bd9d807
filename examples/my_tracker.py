# SPDX-License-Identifier: Apache-2.0
"""A tracker of one's own: a node that publishes joints as geometry_msgs/PoseArray.

Start the pipeline beside it:

./mild run pipeline -p source:=pose_array -p source_axes:=rep103 -p interaction:=handshake \
    -p joint_names:="[pelvis, left_shoulder, right_shoulder, right_elbow, right_hand]"
"""

import contextlib

import numpy as np
import rclpy
from geometry_msgs.msg import Point, Pose, PoseArray
from rclpy.node import Node

STANDING = np.array([[2.0, 0.0, 0.9], [2.0, -0.2, 1.4], [2.0, 0.2, 1.4], [2.0, 0.25, 1.1], [1.95, 0.25, 0.8]])


class MyTracker(Node):
    """Publishes a person who stands two metres before the camera (x forward, y left, z up), 30 times a second."""

    def __init__(self) -> None:
        super().__init__("my_tracker")
        self.publisher = self.create_publisher(PoseArray, "skeleton", 10)
        self.create_timer(1.0 / 30.0, self.publish)

    def publish(self) -> None:
        """Send one message; put your own measurement [m] in place of `positions`."""
        positions = STANDING + np.random.default_rng().normal(0.0, 0.001, STANDING.shape)
        message = PoseArray(poses=[Pose(position=Point(x=x, y=y, z=z)) for x, y, z in positions.tolist()])
        message.header.frame_id, message.header.stamp = "camera", self.get_clock().now().to_msg()
        self.publisher.publish(message)


if __name__ == "__main__":
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        rclpy.spin(MyTracker())

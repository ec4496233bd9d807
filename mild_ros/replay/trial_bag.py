# SPDX-License-Identifier: Apache-2.0
"""A trial of a dataset as a bag: a tracker's messages for the person, and what the robot did in truth.

Such a bag holds a recording, so it is made where it is needed and never shipped.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mild_core.perception.skeletons import SOURCES
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray, require_shape
from mild_core.signals import JointMeasurement
from mild_ros.bag.encoding import encode, type_name_of
from mild_ros.bag.writer import BagWriter, create_bag
from mild_ros.messages.joint_state import joint_measurement_to_msg
from mild_ros.messages.marker_array import people_to_marker_array
from mild_ros.replay.events import TRUE_MOTION
from mild_ros.simulation.person import bodies, skeleton_frames, with_neutral_second

START_NS = 1_600_000_000_000_000_000
NEUTRAL_S = 2.0
"""The first pose is held for longer than the second that calibration needs: a busy machine may miss some messages."""


def write_trial(
    folder: Path, observed_m: FloatArray, robot: RobotModel | None, controlled_rad: FloatArray, rate_hz: float
) -> None:
    """Write the bag of a trial into `folder`, which must not exist.

    Args:
        folder: Of the bag.
        observed_m: (T, 3, 3) shoulder, elbow, hand in the arm frame [m].
        robot: Whose joints these are; None where a second person answered, whose arm no robot can be compared with.
        controlled_rad: (T, J) what the robot did, in its order of joints.
        rate_hz: Of both.

    Raises:
        BagError: The bag cannot be written.
    """
    person = bodies(with_neutral_second(np.asarray(observed_m), rate_hz, NEUTRAL_S))
    truth = np.zeros(0)
    if robot is not None:
        require_shape("controlled_rad", controlled_rad, (len(observed_m), len(robot.joint_names)))
        truth = with_neutral_second(np.asarray(controlled_rad), rate_hz, NEUTRAL_S)
    with create_bag(folder) as bag:
        if robot is not None:
            _write_joints(bag, "/joint_states", robot, START_NS, robot.home_rad)
        for index, frame in enumerate(skeleton_frames(person, rate_hz, START_NS)):
            message = people_to_marker_array((frame,), SOURCES["azure_kinect"])
            bag.write("/skeleton", type_name_of(message), frame.stamp_ns, encode(message))
            if robot is not None:
                _write_joints(bag, f"/{TRUE_MOTION}", robot, frame.stamp_ns, truth[index])


def _write_joints(bag: BagWriter, topic: str, robot: RobotModel, stamp_ns: int, positions_rad: FloatArray) -> None:
    message = joint_measurement_to_msg(JointMeasurement(stamp_ns, robot.joint_names, positions_rad))
    bag.write(topic, type_name_of(message), stamp_ns, encode(message))

# SPDX-License-Identifier: Apache-2.0
"""A person's arm onto any robot's: in closed form where the robot has one, otherwise by inverse kinematics.

The robot's arm is taken for a shoulder that stays where it is, an elbow and a hand. From shoulder to elbow and from
elbow to hand it shall point where the person's arm points, whatever the lengths of its own segments.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.arm_mapping import LONGEST_M, SHORTEST_M
from mild_core.retargeting.robot_model.chain import arm_side, from_base
from mild_core.retargeting.robot_model.inverse_kinematics import InverseKinematics, Reach
from mild_core.retargeting.robot_model.kinematics import forward_kinematics, read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray

STEPS = 3
"""Of the solver per command. From the command before, one is nearly enough; the person may have been quick."""

STAYS_M = 1e-3
"""A shoulder that moves by more when the arm does is none."""


class ArmFollower(Protocol):
    """Joints for a person's arm."""

    def joints(self, arm_m: FloatArray, near_rad: tuple[float, ...]) -> tuple[float, ...]:
        """N joints [rad] inside the limits, near to those of before, for (3, 3) shoulder, elbow and hand [m].

        The arm is in axes x forward, y left, z up of the trunk. Where it is lost, `near_rad` is returned.
        """


class LinkFollower:
    """Moves the elbow and the tool of an arm by inverse kinematics; a left arm does as a right one does, mirrored.

    Args:
        robot: With `arm_links`.

    Raises:
        SetupError: A link is missing, the shoulder moves with the arm, or the libraries are not installed.
    """

    def __init__(self, robot: RobotModel) -> None:
        if robot.arm_links is None:
            raise SetupError(f"robot {robot.name}", "does not say which links are shoulder and elbow", "name them")
        shoulder, self._elbow = robot.arm_links
        self._tool, self._home = robot.tool_link, robot.home_rad
        self._solver = InverseKinematics(robot, (self._elbow, self._tool))
        shoulders, elbows, tools = (_ends(robot, link) for link in (shoulder, self._elbow, self._tool))
        if not _stays(shoulders):
            problem = f"its shoulder link '{shoulder}' moves with the arm"
            carried, _ = from_base(robot, read_tree(robot.urdf_path))
            standing = [link for link in (joint.child for joint in carried) if _stays(_ends(robot, link))]
            remedy = f"name a link about whose origin the arm turns: '{(standing or [robot.base_link])[-1]}'"
            raise SetupError(f"robot {robot.name}", problem, remedy)
        self._shoulder_m = shoulders[0]
        self._mirror = np.array([1.0, -1.0 if arm_side(robot) == "left" else 1.0, 1.0])
        self._upper_arm_m = float(np.linalg.norm(elbows[0] - shoulders[0]))
        self._forearm_m = float(np.linalg.norm(tools[0] - elbows[0]))

    def joints(self, arm_m: FloatArray, near_rad: tuple[float, ...]) -> tuple[float, ...]:
        """N joints [rad]; see `ArmFollower`."""
        bones = np.diff(arm_m, axis=0) * self._mirror
        lengths = np.sqrt((bones**2).sum(axis=1))
        if not (lengths.min() > SHORTEST_M and lengths.max() < LONGEST_M):
            return near_rad
        elbow_m = self._shoulder_m + bones[0] * (self._upper_arm_m / lengths[0])
        hand_m = elbow_m + bones[1] * (self._forearm_m / lengths[1])
        reaches = (Reach(self._elbow, elbow_m), Reach(self._tool, hand_m))
        found: tuple[float, ...] = tuple(self._solver.step(np.array(near_rad), reaches, self._home, STEPS).tolist())
        return found


def _ends(robot: RobotModel, link: str) -> FloatArray:
    """(3, 3) where a link is [m] with the arm at home and at either end of all joints."""
    joints_rad = np.stack([robot.home_rad, robot.lower_rad, robot.upper_rad])
    places: FloatArray = np.broadcast_to(forward_kinematics(robot, joints_rad, link)[..., :3, 3], (3, 3))
    return places


def _stays(places_m: FloatArray) -> bool:
    return float(np.ptp(places_m, axis=0).max()) <= STAYS_M


def arm_follower(robot: RobotModel) -> ArmFollower:
    """The follower of a robot.

    Raises:
        SetupError: The robot says nothing of its arm, or its description does not fit.
    """
    return robot.arm or LinkFollower(robot)

# SPDX-License-Identifier: Apache-2.0
"""Hands, bodies and predictions as markers in the robot's base frame: a few, each gone when it is not renewed."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from mild_core.retargeting.robot_model.arm_following import ArmFollower, arm_follower
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray
from mild_core.signals import BODY_PARTS, WATCHED_PERSON, BodySegments, MotionWindow
from mild_ros.messages.stamps import duration_to_msg, time_to_msg

Colour = tuple[float, float, float]

PERSON_COLOUR: Colour = (0.85, 0.1, 0.1)
ROBOT_COLOUR: Colour = (0.1, 0.2, 0.9)
FIRST_COLOUR, LAST_COLOUR = np.array([0.27, 0.0, 0.33]), np.array([0.99, 0.91, 0.14])
"""Of the first and the last component; the others lie between."""

HAND_M, LINE_M, LIFETIME_NS = 0.075, 0.01, 500_000_000
BYSTANDER_COLOUR: Colour = (0.95, 0.55, 0.1)
BODY_ALPHA, MOST_BALLS = 0.25, 24
MOST_NUMBERS = 100_000_000
"""Numbers of people in the ids of markers begin again here: an id has 32 bits."""

FAINT = 0.1
"""A component without any belief is still to be seen."""


class Drawing:
    """Markers of one robot.

    Args:
        robot: In whose base frame they are.
    """

    def __init__(self, robot: RobotModel) -> None:
        self._robot = robot

    def hand(self, namespace: str, colour: Colour, place_m: FloatArray, stamp_ns: int) -> list[Marker]:
        """A ball at (3,) a hand; nothing where that is not known."""
        if not np.isfinite(place_m).all():
            return []
        marker = self._marker(namespace, 0, Marker.SPHERE, colour, stamp_ns)
        marker.pose.position = _point(place_m)
        return [marker]

    def robot_hand(self, positions_rad: FloatArray, stamp_ns: int) -> list[Marker]:
        """A ball at the hand of the robot with (J,) joints."""
        return self.hand("robot_hand", ROBOT_COLOUR, self._hands(positions_rad), stamp_ns)

    def predicted(self, motion: MotionWindow, stamp_ns: int) -> list[Marker]:
        """The way of the robot's hand through the predicted window, the fainter the less probable."""
        marker = self._marker("predicted", 0, Marker.LINE_STRIP, ROBOT_COLOUR, stamp_ns, max(motion.probability, FAINT))
        marker.scale = Vector3(x=LINE_M)
        marker.points = [_point(place) for place in self._hands(self._joints(motion))]
        return [marker]

    def components(self, motions: tuple[MotionWindow, ...], belief: FloatArray, stamp_ns: int) -> list[Marker]:
        """Where each component expects the robot's hand at the window's end, the fainter the less it is believed in."""
        markers = []
        for number, (motion, weight) in enumerate(zip(motions, belief.tolist(), strict=True)):
            share = number / max(len(motions) - 1, 1)
            red, green, blue = ((1.0 - share) * FIRST_COLOUR + share * LAST_COLOUR).tolist()
            alpha = FAINT + (1.0 - FAINT) * weight
            marker = self._marker("components", number, Marker.SPHERE, (red, green, blue), stamp_ns, alpha)
            marker.pose.position = _point(self._hands(self._joints(motion)[-1]))
            markers.append(marker)
        return markers

    def bodies(self, segments: BodySegments, ends_m: FloatArray, stamp_ns: int) -> list[Marker]:
        """Everyone's capsules as rows of balls: the watched person red, bystanders orange.

        Args:
            segments: Everyone in view.
            ends_m: (N, 2, 3) ends of their axes in the robot's base frame.
            stamp_ns: Of the markers.
        """
        markers = []
        for person, part, (start, end), radius in zip(
            segments.people, segments.parts, ends_m, segments.radii_m.tolist(), strict=True
        ):
            watched = person == WATCHED_PERSON
            namespace, colour = ("watched_person", PERSON_COLOUR) if watched else ("bystanders", BYSTANDER_COLOUR)
            number = person % MOST_NUMBERS * len(BODY_PARTS) + BODY_PARTS.index(part)
            marker = self._marker(namespace, number, Marker.SPHERE_LIST, colour, stamp_ns, BODY_ALPHA)
            marker.scale = Vector3(x=2.0 * radius, y=2.0 * radius, z=2.0 * radius)
            balls = min(2 + int(2.0 * float(np.linalg.norm(end - start)) / radius), MOST_BALLS)
            marker.points = [_point(start + share * (end - start)) for share in np.linspace(0.0, 1.0, balls)]
            markers.append(marker)
        return markers

    @cached_property
    def _follower(self) -> ArmFollower:
        return arm_follower(self._robot)

    def _joints(self, motion: MotionWindow) -> FloatArray:
        """(W, J) in the robot's order, of a partner's arm too."""
        if motion.positions.ndim == 2:
            return motion.positions[:, [motion.joint_names.index(name) for name in self._robot.joint_names]]
        rows = [tuple(self._robot.home_rad.tolist())]
        for arm_m in motion.positions:
            rows.append(self._follower.joints(arm_m, rows[-1]))
        return np.array(rows[1:])

    def _hands(self, positions_rad: FloatArray) -> FloatArray:
        """(..., 3) of (..., J) joints."""
        hands: FloatArray = forward_kinematics(self._robot, positions_rad, self._robot.tool_link)[..., :3, 3]
        return hands

    def _marker(
        self, namespace: str, number: int, kind: int, colour: Colour, stamp_ns: int, alpha: float = 0.8
    ) -> Marker:
        red, green, blue = colour
        header = Header(stamp=time_to_msg(stamp_ns), frame_id=self._robot.base_link)
        marker = Marker(header=header, ns=namespace, id=number, type=kind, color=ColorRGBA(r=red, g=green, b=blue))
        marker.color.a, marker.scale = float(alpha), Vector3(x=HAND_M, y=HAND_M, z=HAND_M)
        marker.lifetime = duration_to_msg(LIFETIME_NS)
        return marker


def _point(place_m: FloatArray) -> Point:
    x, y, z = map(float, place_m)
    return Point(x=x, y=y, z=z)

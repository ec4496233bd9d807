# SPDX-License-Identifier: Apache-2.0
"""Where the person stood: the place before the robot from which hands meet as they did in the recorded trials.

Recordings give the person's arm from the person's own shoulder and the robot's joints, but not one in the frame of the
other. While they touch, hand and tool are at one place, which determines the transform.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mild_core.errors import DatasetError
from mild_core.inference.manifest import HumanPlacement
from mild_core.learning.data.baseline import by_interaction
from mild_core.learning.data.demonstration import Demonstration
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray, require_shape

ADULT_ARM_M = (0.29, 0.335)
"""Shoulder to elbow and elbow to the middle of the hand of an adult; the recorded rig has 0.18 and 0.234."""

FACE_TO_FACE_RAD = math.pi
"""The person's x axis points at the robot. Contacts of one interaction lie within centimetres of each other, so they
does not determine the yaw; it is given."""

TOUCHING = 0.95
"""Hands touch while the person's hand is this near its farthest from rest, as a fraction of that distance."""


@dataclass(frozen=True, eq=False)
class FittedPlace:
    """The person's calibration shoulder in the robot's base frame.

    Attributes:
        yaw_rad: Of the person's x axis in the robot's base frame.
        translation_m: (3,) one place for all interactions, the mean of theirs.
        by_interaction: (3,) a place for each interaction in which hands touch: people stepped about between them.
        arm_lengths_m: Upper arm and forearm of the person for whom this holds.
        distance_m: Mean distance of hand and tool during contact over the trials of each interaction, from its place.
    """

    yaw_rad: float
    translation_m: FloatArray
    by_interaction: Mapping[str, FloatArray]
    arm_lengths_m: tuple[float, float]
    distance_m: Mapping[str, float]

    def placement(self) -> HumanPlacement:
        """The same for a model's manifest, to 0.1 mm."""
        return HumanPlacement(
            translation_m=_rounded(self.translation_m),
            yaw_rad=round(self.yaw_rad, 6),
            by_interaction={name: _rounded(place) for name, place in self.by_interaction.items()},
            arm_lengths_m=self.arm_lengths_m,
        )


def _rounded(place: FloatArray) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 4) for value in place)
    return x, y, z


def hand_of(observed_m: FloatArray, arm_lengths_m: tuple[float, float] | None) -> FloatArray:
    """(T, 3) the hand of an arm given other bones; the way of the shoulder and all directions stay.

    Args:
        observed_m: (T, 3, 3) shoulder, elbow, hand [m].
        arm_lengths_m: New lengths; None keeps the arm as recorded.
    """
    require_shape("observed_m", observed_m, (None, 3, 3))
    if arm_lengths_m is None:
        return observed_m[:, 2]
    bones = np.diff(observed_m, axis=1)
    bones = bones / np.linalg.norm(bones, axis=2, keepdims=True) * np.array(arm_lengths_m)[:, None]
    hand: FloatArray = observed_m[:, 0] + bones.sum(axis=1)
    return hand


def touching(hand_m: FloatArray) -> NDArray[np.bool_]:
    """(T,) frames in which the hand (T, 3) is near its farthest from where it rests in the first frame."""
    distance = np.linalg.norm(hand_m - hand_m[0], axis=1)
    near: NDArray[np.bool_] = distance >= TOUCHING * distance.max()
    return near


def turned_about_z(angle_rad: float) -> FloatArray:
    """(3, 3) rotation about the vertical."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _places(
    demonstrations: Sequence[Demonstration], robot: RobotModel, arm_lengths_m: tuple[float, float] | None, yaw: float
) -> FloatArray:
    """(trials, 3) where the shoulder of each trial would have to be for hand and tool to coincide on average."""
    places = []
    for trial in demonstrations:
        hand = hand_of(trial.observed_m, arm_lengths_m)
        tool = forward_kinematics(robot, trial.controlled, robot.tool_link)[:, :3, 3]
        places.append((tool - hand @ turned_about_z(yaw).T)[touching(hand)].mean(axis=0))
    return np.array(places)


def fit_contact(
    demonstrations: Sequence[Demonstration],
    robot: RobotModel,
    interactions: Sequence[str],
    arm_lengths_m: tuple[float, float] = ADULT_ARM_M,
    yaw_rad: float = FACE_TO_FACE_RAD,
) -> FittedPlace:
    """Fit the place of the person.

    Args:
        demonstrations: Trials; their controlled joints are the robot's, in its order.
        robot: Whose tool link is touched.
        interactions: Those in which hands touch.
        arm_lengths_m: Bones of the person who shall stand there.
        yaw_rad: Which way they look.

    Returns:
        Per interaction the median over trials: it bears a trial whose robot came late.

    Raises:
        DatasetError: There is no trial of one of the interactions.
    """
    groups = by_interaction(demonstrations)
    missing = [name for name in interactions if name not in groups]
    if missing or not interactions:
        raise DatasetError("contact", f"no trial of {missing or 'any interaction'}", "give trials in which hands touch")
    places = {name: _places(groups[name], robot, arm_lengths_m, yaw_rad) for name in interactions}
    own = {name: np.median(place, axis=0) for name, place in places.items()}
    return FittedPlace(
        yaw_rad=yaw_rad,
        translation_m=np.mean(list(own.values()), axis=0),
        by_interaction=own,
        arm_lengths_m=arm_lengths_m,
        distance_m={name: float(np.linalg.norm(place - own[name], axis=1).mean()) for name, place in places.items()},
    )

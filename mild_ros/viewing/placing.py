# SPDX-License-Identifier: Apache-2.0
"""The person in the robot's base frame: where the model was taught that people stand, so that hands meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.inference.manifest import Manifest
from mild_core.perception.calibration import Calibration
from mild_core.perception.stage import Perception
from mild_core.shapes import FloatArray
from mild_core.signals import MotionWindow, SkeletonFrame
from mild_ros.simulation.person import KNEELING_M
from mild_ros.viewing.body import NEEDED, Places

SOLE_M = 0.07
"""How far below an ankle the drawn shoe ends."""

SMALLEST, LARGEST = 0.7, 1.4
"""A person is not drawn smaller or larger than this for their arm to have the model's length."""

LEGS = ("_knee", "_ankle", "_foot")

SHORTEST_LEGS = 0.6
"""Whose legs would have to be drawn shorter than this share kneels: so low are the shoulders of who meets Pepper."""


@dataclass(frozen=True, eq=False)
class Placement:
    """From the tracker's axes to the robot's base frame.

    Attributes:
        calibration: The person's arm frame.
        rotation: (3, 3) robot from arm frame.
        translation_m: (3,) the calibration shoulder in the robot's base frame.
        scale: The person is drawn so much larger, for the arm to reach what it reached in training.
    """

    calibration: Calibration
    rotation: FloatArray
    translation_m: FloatArray
    scale: float = 1.0

    def places(self, person: SkeletonFrame) -> Places:
        """Joint name to (3,) metres in the robot's base frame."""
        turned = (person.positions_m - self.calibration.shoulder_m) @ self.calibration.arm_from_source.T
        placed = self.scale * turned @ self.rotation.T + self.translation_m
        return dict(zip(person.joint_names, placed, strict=True))


def find_calibration(perception: Perception, people: Sequence[SkeletonFrame]) -> Calibration | None:
    """The calibration that perception comes to on these frames; None when the person never stands still."""
    state = perception.init()
    for person in people:
        state, _ = perception.step(state, (person,), person.stamp_ns)
        if state.calibration is not None:
            return state.calibration
    return None


def place_person(
    calibration: Calibration, manifest: Manifest, interaction: str, robot_from_source: FloatArray | None = None
) -> Placement:
    """Where the person stands: as the camera sees them, if its (4, 4) pose in the robot's base frame is known.

    Otherwise as the model takes them to stand for an interaction; "" for one place that suits all.
    """
    if robot_from_source is not None:
        turn = robot_from_source[:3, :3]
        shoulder_m = turn @ calibration.shoulder_m + robot_from_source[:3, 3]
        return Placement(calibration, turn @ calibration.arm_from_source.T, shoulder_m)
    standing = manifest.robot_from_human
    translation = getattr(standing, "by_interaction", {}).get(interaction, standing.translation_m)
    arm_m = sum(getattr(standing, "arm_lengths_m", ()) or calibration.bone_lengths_m)
    scale = float(np.clip(arm_m / sum(calibration.bone_lengths_m), SMALLEST, LARGEST))
    cosine, sine = np.cos(standing.yaw_rad), np.sin(standing.yaw_rad)
    rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return Placement(calibration, rotation, np.asarray(translation, dtype=np.float64), scale)


def main_interaction(motions: Sequence[MotionWindow]) -> str:
    """The interaction that was recognised with most certainty over the run; "" when none was."""
    total: dict[str, float] = {}
    for motion in motions:
        if motion.interaction:
            total[motion.interaction] = total.get(motion.interaction, 0.0) + motion.probability * motion.phase
    return max(total, key=lambda name: total[name], default="")


def floor_height(frames: Sequence[Places]) -> float:
    """Height of the floor under the person's shoes [m, robot's base frame]."""
    return _height(frames, "ankle") - SOLE_M


def stood_on(frames: Sequence[Places], floor_m: float) -> tuple[Places, ...]:
    """The same person with legs as long as it takes to stand or kneel on the floor; hands stay where they met."""
    hips_m, ankles_m = _height(frames, "hip"), _height(frames, "ankle")
    if (hips_m - floor_m - SOLE_M) < SHORTEST_LEGS * (hips_m - ankles_m):
        frames = [_kneeling(at) for at in frames]
        ankles_m = _height(frames, "ankle")
    share = (hips_m - floor_m - SOLE_M) / max(hips_m - ankles_m, 0.1)

    def stretched(name: str, place_m: FloatArray) -> FloatArray:
        leg = name.endswith(LEGS)
        return place_m * (1.0, 1.0, share) + (0.0, 0.0, (1.0 - share) * hips_m) if leg else place_m

    return tuple({name: stretched(name, place_m) for name, place_m in at.items()} for at in frames)


def _kneeling(at: Places) -> Places:
    """The same person with the legs of one who kneels."""
    left = (at["left_hip"] - at["right_hip"]) * (1.0, 1.0, 0.0)
    left = left / max(float(np.linalg.norm(left)), 1e-9)
    axes = np.stack([np.cross(left, (0.0, 0.0, 1.0)), left, (0.0, 0.0, 1.0)])
    return {**at, **{name: at["pelvis"] + place @ axes for name, place in KNEELING_M.items() if name.endswith(LEGS)}}


def _height(frames: Sequence[Places], joint: str) -> float:
    """Of both sides' joints, in most frames [m]."""
    return float(np.median([at[f"{side}_{joint}"][2] for at in frames for side in ("left", "right")]))


def is_whole(person: SkeletonFrame) -> bool:
    """Whether a body can be drawn: every joint is there and somewhere."""
    return set(person.joint_names) >= NEEDED and bool(np.isfinite(person.positions_m).all())

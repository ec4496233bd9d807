# SPDX-License-Identifier: Apache-2.0
"""Settings of perception: the model's input, which person and arm, and when a frame is rejected."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

from mild_core.errors import SetupError, unknown_name
from mild_core.parameters import check, parameter
from mild_core.perception.calibration import Calibration
from mild_core.perception.skeletons.source import JOINTS, Axes
from mild_core.shapes import FloatArray, read_only, require_shape


@dataclass(frozen=True, kw_only=True)
class TrackingSettings:
    """Which person and arm is tracked, and when a frame is not used: what may be chosen with any model and tracker."""

    side: Literal["right", "left"] = parameter("right", "The person's arm to track.", choices=("right", "left"))
    axes: Literal["torso", "given"] = parameter(
        "torso",
        "Take the person's axes from the torso at calibration, or as given: x forward, y left, z up.",
        choices=("torso", "given"),
    )
    calibration_s: float = parameter(
        1.0, "Time of standing still for the calibration.", unit="s", minimum=0.1, maximum=10.0
    )
    calibration_still_m: float = parameter(
        0.05,
        "Farthest that shoulders and pelvis may stray from their mean meanwhile.",
        unit="m",
        minimum=0.001,
        maximum=1.0,
        offered=False,
    )
    max_gap_s: float = parameter(0.5, "Longest gap bridged by interpolation.", unit="s", minimum=0.01, maximum=2.0)
    min_confidence: float = parameter(0.5, "Joints with a lower confidence are not used.", minimum=0.0, maximum=1.0)
    bone_tolerance: float = parameter(
        0.3,
        "Largest relative deviation of a bone from its calibrated length that raises no doubt: beyond it a bone must "
        "not leap, and arms that are so for `forget_s` belong to another person.",
        minimum=0.01,
        maximum=10.0,
        offered=False,
    )
    reacquire_distance_m: float = parameter(
        0.5,
        "Largest distance from the last position at which a detection is the same person.",
        unit="m",
        minimum=0.05,
        maximum=5.0,
    )
    forget_s: float = parameter(5.0, "How long to wait for a lost person.", unit="s", minimum=0.5, maximum=3600.0)
    frozen_after_s: float = parameter(
        0.5,
        "A body that repeats bit for bit for longer is no measurement and is not tracked.",
        unit="s",
        minimum=0.1,
        maximum=10.0,
    )
    keep_body_s: float = parameter(
        2.0,
        "How long a body that is missing from the tracker's messages stays an obstacle, with a growing radius.",
        unit="s",
        minimum=0.1,
        maximum=60.0,
    )


@dataclass(frozen=True, kw_only=True)
class PerceptionSettings(TrackingSettings):
    """Everything that perception needs to know. The first five come from the model folder.

    Attributes:
        joint_names: J joints the model observes, from the shoulder outwards, without their side ("shoulder", ...).
        bone_lengths_m: J - 1 lengths the arm is brought to, those of the model's training data; empty keeps the
            person's own.
        rate_hz: The model's rate.
        window: W, rows of a window.
        features: "positions", or "positions_velocities".
        source_axes: The axes of the tracker, for telling a wrong camera frame; "unknown" turns this check off.
        frame_id: The only tf frame to accept; empty accepts the first that comes.
        robot_from_source: (4, 4) pose of the tracker's frame in the robot's base frame, for a camera that is
            calibrated to the robot; None when unknown.
        calibration: One made before, to start without the neutral second; a later person calibrates again.
    """

    joint_names: tuple[str, ...]
    bone_lengths_m: tuple[float, ...]
    rate_hz: float
    window: int
    features: Literal["positions", "positions_velocities"] = "positions"
    source_axes: Axes = "unknown"
    frame_id: str = ""
    robot_from_source: FloatArray | None = field(default=None, compare=False)
    calibration: Calibration | None = None

    def __post_init__(self) -> None:
        """Raise SetupError for settings that cannot work."""
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        object.__setattr__(self, "bone_lengths_m", tuple(float(length) for length in self.bone_lengths_m))
        if self.robot_from_source is not None:
            object.__setattr__(self, "robot_from_source", read_only(self.robot_from_source))
            require_shape("robot_from_source", self.robot_from_source, (4, 4))
        check(self)
        for name, allowed in _CHOICES.items():
            if getattr(self, name) not in allowed:
                raise unknown_name(name, str(getattr(self, name)), allowed)
        self._check_joints()
        for name in ("rate_hz", "window"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise SetupError(name, f"is {value}", "give a number above 0")
        if self.calibration is not None and self.calibration.side != self.side:
            raise SetupError("calibration", f"is of the {self.calibration.side} arm", f"calibrate the {self.side} one")
        if self.calibration is not None and len(self.calibration.bone_lengths_m) != len(self.joint_names) - 1:
            raise SetupError("calibration", "was made for other joints", "calibrate again")
        if self.calibration is not None and self.frame_id not in ("", self.calibration.frame_id):
            problem = f"was made in '{self.calibration.frame_id}', but frame_id is '{self.frame_id}'"
            raise SetupError("calibration", problem, "calibrate again, or leave frame_id empty")

    def _check_joints(self) -> None:
        for name in self.sided_names:
            if name not in JOINTS:
                raise unknown_name("joint_names", name, [joint for joint in JOINTS if joint.startswith(self.side)])
        bones = len(self.joint_names) - 1
        if bones < 1:
            raise SetupError("joint_names", f"{list(self.joint_names)} is no arm", "give two joints or more")
        lengths = self.bone_lengths_m
        if lengths and (len(lengths) != bones or not all(0.0 < length < 2.0 for length in lengths)):
            raise SetupError("bone_lengths_m", f"is {list(lengths)}", f"give {bones} lengths in metres, or none")

    @cached_property
    def sided_names(self) -> tuple[str, ...]:
        """The model's joints as a skeleton names them ("right_shoulder", ...)."""
        return tuple(f"{self.side}_{name}" for name in self.joint_names)

    @cached_property
    def max_gap_ns(self) -> int:
        """`max_gap_s` in nanoseconds."""
        return round(self.max_gap_s * 1e9)

    @cached_property
    def frozen_after_ns(self) -> int:
        """`frozen_after_s` in nanoseconds."""
        return round(self.frozen_after_s * 1e9)

    @cached_property
    def forget_ns(self) -> int:
        """`forget_s` in nanoseconds."""
        return round(self.forget_s * 1e9)


_CHOICES: dict[str, tuple[str, ...]] = {
    "features": ("positions", "positions_velocities"),
    "source_axes": ("optical", "rep103", "unknown"),
}

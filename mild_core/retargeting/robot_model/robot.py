# SPDX-License-Identifier: Apache-2.0
"""What retargeting and simulation need to know of a robot: names, limits, poses and where its description lies."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mild_core.retargeting.robot_model.arm_mapping import FourJointArm
from mild_core.shapes import FloatArray, read_only, require_shape


@dataclass(frozen=True, eq=False)
class RobotModel:
    """One arm of a robot that follows a person; J controlled joints in kinematic order, base to tool.

    Attributes:
        name: The name in the table `ROBOTS`.
        joint_names: J names as in the robot description.
        lower_rad: (J,) smallest positions.
        upper_rad: (J,) largest positions.
        velocity_rad_s: (J,) largest speeds.
        acceleration_rad_s2: (J,) largest accelerations of a command.
        jerk_rad_s3: (J,) largest jerks of a command.
        home_rad: (J,) where the arm waits.
        urdf_path: The robot description; its links have primitive shapes or a vendor's meshes.
        notes: What people should know of how it was read, a line for each.
        described_by: Where the description came from, as the user named it; "" for `urdf_path`.
        base_link: The frame that stands in the world: REP-103 axes, x forward.
        tool_link: The frame that meets the person's hand.
        rest: Positions [rad, or m of a sliding joint] of the joints that nothing commands, as (name, position).
        floor_m: Height of the floor in the base frame, where it is known; None takes it from the person's feet.
        on_table: Whether the robot stands on a table, which is drawn under it.
        keeps_off_table: Whether the arm keeps out of that table. Recorded motions of our YuMi, which stood on another,
            go through it.
        arm: How a person's arm becomes positions of the joints, where that is known in closed form.
        arm_links: Otherwise, for a robot that shall do as a person's arm does: its shoulder, a link whose origin
            stays where it is, and its elbow.

    Raises:
        ValueError: An array has another shape, a limit is empty, or `home_rad` lies outside the limits.
    """

    name: str
    joint_names: tuple[str, ...]
    lower_rad: FloatArray
    upper_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray
    jerk_rad_s3: FloatArray
    home_rad: FloatArray
    urdf_path: Path
    base_link: str
    tool_link: str
    rest: tuple[tuple[str, float], ...] = field(default=())
    floor_m: float | None = None
    on_table: bool = False
    keeps_off_table: bool = False
    arm: FourJointArm | None = None
    arm_links: tuple[str, str] | None = None
    notes: tuple[str, ...] = ()
    described_by: str = ""

    @property
    def source(self) -> str:
        """The description as messages name it."""
        return self.described_by or str(self.urdf_path)

    @property
    def at_home(self) -> dict[str, float]:
        """Positions of the joints by name: home and rest."""
        return {**dict(self.rest), **dict(zip(self.joint_names, self.home_rad.tolist(), strict=True))}

    @property
    def follows_arms(self) -> bool:
        """Whether it can do as a person's arm does."""
        return self.arm is not None or self.arm_links is not None

    def __post_init__(self) -> None:
        limits = ("velocity_rad_s", "acceleration_rad_s2", "jerk_rad_s3")
        for name in ("lower_rad", "upper_rad", "home_rad", *limits):
            object.__setattr__(self, name, read_only(getattr(self, name)))
            require_shape(name, getattr(self, name), (len(self.joint_names),))
        for joint, lower, upper, home in zip(
            self.joint_names, self.lower_rad.tolist(), self.upper_rad.tolist(), self.home_rad.tolist(), strict=True
        ):
            if not lower < upper:
                raise ValueError(f"robot {self.name}: the limits of '{joint}' are {lower:g} to {upper:g}, not in order")
            if not lower <= home <= upper:
                problem = f"home_rad lies outside the limits of '{joint}': {home:g}, not within {lower:g} to {upper:g}"
                raise ValueError(f"robot {self.name}: {problem}")
        for name in limits:
            if np.any(getattr(self, name) <= 0):
                joint = self.joint_names[int(np.argmin(getattr(self, name)))]
                raise ValueError(f"robot {self.name}: {name} of '{joint}' is not positive")

# SPDX-License-Identifier: Apache-2.0
"""A run made ready to be shown: the person in the robot's frame, the robot's joints at any time, how near hands are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mild_core.errors import BagError
from mild_core.inference.manifest import Manifest
from mild_core.perception.stage import Perception
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray
from mild_core.signals import MotionWindow
from mild_ros.replay.recorded import JointTrack, RecordedRun
from mild_ros.viewing.body import Places
from mild_ros.viewing.placing import (
    find_calibration,
    floor_height,
    is_whole,
    main_interaction,
    place_person,
    stood_on,
)


@dataclass(frozen=True, eq=False)
class Staged:
    """What the filmstrip and the page show.

    Attributes:
        times_s: (T,) of the person's frames, since the first.
        bodies: T frames of joints [m, robot's base frame].
        hand_m: (T, 3) the hand that is watched.
        track: The robot's joints: measured where they were, otherwise commanded; None when there are neither.
        home: Joint positions where nothing else is known.
        gap_m: (T,) distance between that hand and the robot's tool.
        floor_m: Height of the floor.
        interaction: For which the person was placed; "" for none in particular.
        motions: What was inferred.
        start_ns: Stamp of time zero.
    """

    times_s: FloatArray
    bodies: tuple[Places, ...]
    hand_m: FloatArray
    track: JointTrack | None
    home: dict[str, float]
    gap_m: FloatArray
    floor_m: float
    interaction: str
    motions: tuple[MotionWindow, ...]
    start_ns: int

    def nearest(self) -> tuple[float, float]:
        """When hand and tool are nearest to each other [s], and how near [m]."""
        frame = int(np.argmin(self.gap_m))
        return float(self.times_s[frame]), float(self.gap_m[frame])

    def seconds(self, stamp_ns: int) -> float:
        """Of a stamp, since the first frame."""
        return (stamp_ns - self.start_ns) * 1e-9

    def frame_at(self, moment_s: float) -> int:
        """The person's newest frame then."""
        return int(np.clip(np.searchsorted(self.times_s, moment_s, side="right") - 1, 0, len(self.times_s) - 1))

    def joints_at(self, moment_s: float) -> dict[str, float]:
        """The robot's joints then."""
        if self.track is None:
            return self.home
        values = self.track.at(np.array([self.start_ns + round(moment_s * 1e9)]))[0]
        return self.home | dict(zip(self.track.joint_names, values.tolist(), strict=True))


def stage(run: RecordedRun, perception: Perception, manifest: Manifest, robot: RobotModel) -> Staged:
    """Put a run on stage.

    Raises:
        BagError: The person never stands still or is never seen whole.
    """
    calibration = find_calibration(perception, run.people)
    whole = [person for person in run.people if is_whole(person)]
    if calibration is None or not whole:
        problem = "shows no person who stands still for a second" if whole else "never shows a whole person"
        raise BagError(str(run.path), problem, "there is nothing to show; plots need less")
    interaction = main_interaction(run.motions)
    placement = place_person(calibration, manifest, interaction, perception.settings.robot_from_source)
    placed = tuple(placement.places(person) for person in whole)
    floor_m = floor_height(placed) if robot.floor_m is None else robot.floor_m
    bodies = stood_on(placed, floor_m)
    stamps = np.array([person.stamp_ns for person in whole], dtype=np.int64)
    hand = np.stack([at[f"{perception.settings.side}_hand"] for at in bodies])
    track = next((t for t in (run.measured, run.commands) if t and len(t.stamps_ns) > 1), None)
    commanded = np.tile(robot.home_rad, (len(stamps), 1)) if track is None else track.of(robot.joint_names).at(stamps)
    tool = forward_kinematics(robot, commanded, robot.tool_link)[:, :3, 3]
    return Staged(
        times_s=run.seconds(stamps),
        bodies=bodies,
        hand_m=hand,
        track=track,
        home=dict(robot.rest) | dict(zip(robot.joint_names, robot.home_rad.tolist(), strict=True)),
        gap_m=np.linalg.norm(tool - hand, axis=1),
        floor_m=floor_m,
        interaction=interaction,
        motions=run.motions,
        start_ns=run.start_ns,
    )

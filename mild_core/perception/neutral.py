# SPDX-License-Identifier: Apache-2.0
"""Finding a person's arm frame while they stand still for a second.

The trunk gives the axes, not the camera's mounting: z from the pelvis to the middle of the shoulders, y along the
shoulders to the left, x forward. The origin is the mean place of the watched shoulder. Both then stay, so that a
shoulder that leans forward moves in the arm frame, as it does in the recordings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mild_core.errors import DataError
from mild_core.perception.calibration import Calibration
from mild_core.perception.joint_validity import Body, Point, believed, believed_place, middle, seen_joint
from mild_core.perception.skeletons.source import Axes
from mild_core.shapes import FloatArray

FULL_SECOND = 0.99
"""Of the neutral second, as stamps jitter."""

_SHOULDERS, _HIPS = ("left_shoulder", "right_shoulder"), ("left_hip", "right_hip")
_FACING = (("head", "nose"), ("left_ankle", "left_foot"), ("right_ankle", "right_foot"))
_UP: dict[str, Point] = {"optical": (0.0, -1.0, 0.0), "rep103": (0.0, 0.0, 1.0)}

STEEPEST_COSINE = 0.5
"""A camera may be tilted and a trunk may lean, but not by 60 degrees together; swapped axes are off by 90."""

NARROWEST_M = 0.1
"""Shoulders nearer than this, or nearer to the pelvis, span no axes."""

JITTERIEST_M = 0.045
"""A trunk whose joints jitter by more in each coordinate says too little about where it points in a second."""

MEDIAN_STEP, FARTHEST_JITTER = 2.175, 4.5
"""In deviations of a coordinate: the median of jitter's successive differences, and the farthest of a second's jitter.
Source: chi distribution of three degrees of freedom."""

MISPLACED = ("mirrored", "wrong_up_axis")
"""Reasons of `check_trunk`: the place of such a body is unknown."""

_FLAT = "are the names of the joints in the tracker's order?"


@dataclass(frozen=True, eq=False)
class NeutralFrame:
    """One frame of the neutral second, in the source's axes [m].

    Attributes:
        stamp_ns: Its stamp.
        shoulder_m: (3,) the watched shoulder.
        trunk_m: (3, 3) left shoulder, right shoulder, pelvis; None for trackers that see an arm only.
        facing_m: (3,) sum of the vectors that point where the person looks: head to nose, ankles to toes.
        bone_lengths_m: Of the watched arm.
    """

    stamp_ns: int
    shoulder_m: FloatArray
    trunk_m: FloatArray | None
    facing_m: FloatArray
    bone_lengths_m: tuple[float, ...]


def neutral_frame(
    body: Body, shoulder_m: Point, bone_lengths_m: tuple[float, ...], torso: bool, min_confidence: float
) -> NeutralFrame:
    """What calibration needs of a frame.

    Args:
        body: The frame.
        shoulder_m: Its watched shoulder.
        bone_lengths_m: Of its watched arm.
        torso: Whether the trunk is needed, because the axes come from it.
        min_confidence: Least confidence of the trunk's joints.

    Raises:
        DataError: As `gates.believed`, when the trunk is needed.
    """
    trunk = None
    try:
        trunk = np.array([*believed(body, _SHOULDERS, min_confidence), _pelvis(body, min_confidence)])
    except DataError:
        if torso:
            raise
    facing = np.zeros(3)
    for start, end in _FACING:
        a, b = seen_joint(body, start), seen_joint(body, end)
        if a is not None and b is not None:
            facing += np.subtract(b, a)
    return NeutralFrame(body.frame.stamp_ns, np.array(shoulder_m), trunk, facing, bone_lengths_m)


def with_newest(
    frames: tuple[NeutralFrame, ...], newest: NeutralFrame, span_s: float, max_gap_s: float
) -> tuple[NeutralFrame, ...]:
    """The frames of the last `span_s` seconds, or the newest alone when the one before is too old."""
    if frames and newest.stamp_ns - frames[-1].stamp_ns > max_gap_s * 1e9:
        return (newest,)
    full_ns = span_s * FULL_SECOND * 1e9
    first = sum(newest.stamp_ns - frame.stamp_ns >= full_ns for frame in frames[1:])
    return (*frames[first:], newest)


def unsteadiness(frames: tuple[NeutralFrame, ...]) -> tuple[float, float]:
    """How far the watched shoulder or a joint of the trunk moved from its mean [m], and how much the tracker jitters.

    A tracker's jitter differs from frame to frame, while a body moves on: the mean square of successive differences
    determines the first, and what is left of the variance the second. A joint that was elsewhere for a frame is beyond
    what jitter explains.

    Returns:
        For the joint that moved most, the farthest that an even motion of this variance takes it from its mean, or
        it was beyond its jitter, and no more than it was; for the one that jitters most, the deviation of each of its
        coordinates.

    Source: J. von Neumann, "Distribution of the ratio of the mean square successive difference to the variance",
    Annals of Mathematical Statistics 1941.
    """
    trunks = [frame.trunk_m for frame in frames if frame.trunk_m is not None]
    joints = list(np.moveaxis(np.stack(trunks), 1, 0)) if trunks else []
    tracks = [np.stack([frame.shoulder_m for frame in frames]), *joints]
    displacement_m = jitter = 0.0
    for track in tracks:
        if len(track) < 2:
            continue
        away, steps = track - track.mean(axis=0), np.diff(track, axis=0)
        noise = float(np.square(steps).sum()) / (2.0 * len(steps))
        moved = float(np.square(away).sum()) / len(steps) - noise
        usual = float(np.median(np.linalg.norm(steps, axis=1))) / MEDIAN_STEP
        farthest = float(np.linalg.norm(away, axis=1).max())
        unexplained = max(math.sqrt(3.0 * max(moved, 0.0)), farthest - FARTHEST_JITTER * usual)
        displacement_m, jitter = max(displacement_m, min(farthest, unexplained)), max(jitter, noise)
    return displacement_m, math.sqrt(jitter / 3.0)


def calibrate(
    frames: tuple[NeutralFrame, ...],
    frame_id: str,
    side: Literal["right", "left"],
    torso: bool,
    source_axes: Axes,
) -> Calibration:
    """The arm frame of a person who stood still.

    Args:
        frames: One or more.
        frame_id: The tf frame of their positions.
        side: The watched arm.
        torso: Take the axes from the trunk; otherwise they are given.
        source_axes: Axes of the tracker, "unknown" to check none.

    Raises:
        DataError: `flat_torso` when the trunk spans no axes; `wrong_up_axis` when the trunk does not point up in
            the camera's frame; `mirrored` when nose and toes point backwards, or without these the whole person does
            before a camera, so that left is right;
            `wrong_forward_axis` when the axes are given and the person faces another way.
    """
    axes = np.eye(3)
    trunks = [frame.trunk_m for frame in frames if frame.trunk_m is not None]
    if trunks:
        trunk = np.mean(trunks, axis=0)
        body = torso_axes(trunk[0], trunk[1], trunk[2])
        facing = np.mean([frame.facing_m for frame in frames], axis=0)
        _check_axes(body, trunk.mean(axis=0), facing, frame_id, source_axes if torso else "rep103")
        if torso:
            axes = body
        elif body[0, 0] < STEEPEST_COSINE:
            seen = f"the person faces along {_nearest_axis(body[0])} in '{frame_id}', not along +x"
            raise DataError("wrong_forward_axis", f"{seen}: set axes to torso")
    shoulder = np.mean([frame.shoulder_m for frame in frames], axis=0)
    lengths = np.mean([frame.bone_lengths_m for frame in frames], axis=0)
    return Calibration(frames[-1].stamp_ns, frame_id, side, shoulder, axes, tuple(lengths.tolist()))


def torso_axes(left_shoulder_m: FloatArray, right_shoulder_m: FloatArray, pelvis_m: FloatArray) -> FloatArray:
    """(3, 3) whose rows are forward, left and up of a trunk.

    Raises:
        DataError: `flat_torso`.

    Source: REP-103, body axes.
    """
    up = (left_shoulder_m + right_shoulder_m) / 2.0 - pelvis_m
    height = float(np.linalg.norm(up))
    if height < NARROWEST_M:
        raise DataError("flat_torso", f"shoulders are {height:.3f} m above the pelvis: {_FLAT}")
    up = up / height
    left = left_shoulder_m - right_shoulder_m
    left = left - (left @ up) * up
    width = float(np.linalg.norm(left))
    if width < NARROWEST_M:
        raise DataError("flat_torso", f"shoulders are {width:.3f} m apart: {_FLAT}")
    left = left / width
    return np.stack([np.cross(left, up), left, up])


def check_trunk(body: Body, calibration: Calibration, min_confidence: float) -> None:
    """Raise DataError unless a calibrated person still stands upright in the camera's frame, not facing away from it.

    A mirrored picture, swapped names or turned axes show in a trunk that lies down or turns round from one frame to
    the next. A trunk that is not seen says nothing.

    Args:
        body: The frame.
        calibration: Of the person in it.
        min_confidence: Least confidence of the trunk's joints.

    Raises:
        DataError: `mirrored` or `wrong_up_axis`.
    """
    left, right = [believed_place(body, name, min_confidence) for name in _SHOULDERS]
    pelvis = believed_place(body, "pelvis", min_confidence)
    if "pelvis" not in body.places:
        pelvis = middle(*[believed_place(body, name, min_confidence) for name in _HIPS])
    if math.isnan(pelvis[0]):
        return
    _, along, up = calibration.arm_from_source.tolist()
    if _cosine(right, left, along) < -STEEPEST_COSINE:
        raise DataError("mirrored", "left and right are swapped all of a sudden, or the person has turned round")
    if _cosine(pelvis, middle(left, right), up) < STEEPEST_COSINE:
        raise DataError("wrong_up_axis", "the trunk does not stand upright any more: have the axes changed?")


def _check_axes(body: FloatArray, middle_m: FloatArray, facing_m: FloatArray, frame_id: str, source_axes: Axes) -> None:
    if source_axes in _UP and float(body[2] @ np.array(_UP[source_axes])) < STEEPEST_COSINE:
        fitting = [axes for axes, up in _UP.items() if float(body[2] @ np.array(up)) >= STEEPEST_COSINE]
        remedy = f"these are {fitting[0]} axes" if fitting else "is the camera upright, and the source the right one?"
        seen = f"the trunk points along {_nearest_axis(body[2])} in '{frame_id}', up in {source_axes} axes is"
        raise DataError("wrong_up_axis", f"{seen} {_nearest_axis(np.array(_UP[source_axes]))}: {remedy}")
    if float(facing_m @ body[0]) < 0.0:
        seen = f"nose and toes point backwards in '{frame_id}': left and right are swapped"
        raise DataError("mirrored", f"{seen}, by a mirrored image, left-handed axes or the names of joints")
    away = float(body[0] @ middle_m) / float(np.linalg.norm(middle_m))
    if source_axes == "optical" and not facing_m.any() and away > STEEPEST_COSINE:  # people face their camera
        seen = f"the person seems to look away from the camera of '{frame_id}': turn around"
        raise DataError("mirrored", f"{seen}; or left and right are swapped, by left-handed axes or joint names")


def _cosine(start: Point, end: Point, unit: Sequence[float]) -> float:
    """Of the angle between a way and a unit vector; not a number for no way, or an end that was not seen."""
    x, y, z = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    length = math.sqrt(x * x + y * y + z * z)
    return (x * unit[0] + y * unit[1] + z * unit[2]) / length if length else math.nan


def _nearest_axis(direction: FloatArray) -> str:
    """The axis that a direction is nearest to, e.g. "-y"."""
    axis = int(np.argmax(np.abs(direction)))
    return f"{'+' if direction[axis] > 0.0 else '-'}{'xyz'[axis]}"


def _pelvis(body: Body, min_confidence: float) -> Point:
    """The pelvis, or the middle of the hips for trackers without one."""
    if "pelvis" in body.places or "left_hip" not in body.places:
        return believed(body, ("pelvis",), min_confidence)[0]
    (ax, ay, az), (bx, by, bz) = believed(body, _HIPS, min_confidence)
    return ((ax + bx) / 2.0, (ay + by) / 2.0, (az + bz) / 2.0)

# SPDX-License-Identifier: Apache-2.0
"""What a bag's two agents did, frame by frame: people by the perception that watches live, a robot beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mild_core.errors import SetupError
from mild_core.perception.calibration import Calibration
from mild_core.perception.settings import PerceptionSettings
from mild_core.perception.stage import Perception
from mild_core.shapes import FloatArray
from mild_core.signals import ARM_JOINTS, JointMeasurement
from mild_ros.assembly.perception import skeleton_source
from mild_ros.bag.tracker_clock import Clock
from mild_ros.demonstrations.settings import PersonParameters
from mild_ros.messages.joint_by_joint import People

Stamps = NDArray[np.int64]
Sightings = Sequence[tuple[int, People]]
"""Everyone in each message of a tracker, and when it came [ns]."""


@dataclass(frozen=True, eq=False)
class ArmTrack:
    """An arm at an even rate, but for gaps.

    Attributes:
        stamps_ns: (T,) of the frames, on the recorder's clock.
        arm_m: (T, 3, 3) shoulder, elbow and hand in the arm frame of the calibration, with the person's own bones.
        calibration: The last one; None when no person stood still for it.
        counts: What perception made of the messages.
    """

    stamps_ns: Stamps
    arm_m: FloatArray
    calibration: Calibration | None
    counts: Mapping[str, int]


def perception_of(parameters: PersonParameters, rate_hz: float) -> Perception:
    """Perception of an arm as it is: frame by frame, with the person's own bones.

    Raises:
        SetupError: A parameter cannot work.
    """
    same = ("side", "axes", "frame_id", "calibration_s", "max_gap_s", "min_confidence", "reacquire_distance_m")
    settings = PerceptionSettings(
        joint_names=ARM_JOINTS,
        bone_lengths_m=(),
        rate_hz=rate_hz,
        window=1,
        source_axes=skeleton_source(parameters).axes,
        forget_s=parameters.forget_s,
        **{name: getattr(parameters, name) for name in same},
    )
    return Perception(settings)


def follow(sightings: Sightings, clock: Clock, perception: Perception) -> tuple[ArmTrack, Sightings]:
    """The arm of the person whom perception watches, and everybody else.

    Args:
        sightings: Everyone in each message, and when it came [ns].
        clock: Of the tracker.
        perception: Of one frame at a time.

    Returns:
        The person's track, and the same sightings without the person.
    """
    state, stamps, arms, others = perception.init(), [], [], []
    for received_ns, seen in sightings:
        people = tuple(replace(one, stamp_ns=clock.time_ns(one.stamp_ns, received_ns)) for one in seen)
        state, windows = perception.step(state, people, received_ns)
        stamps += [window.stamp_ns for window in windows]
        arms += [window.features for window in windows]
        lock = state.lock
        mine = (lock.person_id, lock.stamp_ns) if lock else None
        rest = [one for one, now in zip(seen, people, strict=True) if (now.person_id, now.stamp_ns) != mine]
        others.append((received_ns, tuple(rest)))
    arm = np.array(arms, dtype=np.float64).reshape(-1, len(ARM_JOINTS), 3)
    return ArmTrack(np.array(stamps, dtype=np.int64), arm, state.calibration, state.counts), others


def on_grid(grid_ns: Stamps, stamps_ns: Stamps, values: FloatArray, max_gap_s: float) -> FloatArray:
    """(T, ...) `values` (N, ...) at the times of the grid, between neighbours; NaN where these are too far apart."""
    result = np.full((len(grid_ns), *values.shape[1:]), np.nan)
    if len(stamps_ns) < 2:
        return result
    after = np.clip(np.searchsorted(stamps_ns, grid_ns), 1, len(stamps_ns) - 1)
    before = after - 1
    span = stamps_ns[after] - stamps_ns[before]
    inside = (grid_ns >= stamps_ns[before]) & (grid_ns <= stamps_ns[after]) & (span > 0) & (span <= max_gap_s * 1e9)
    share = ((grid_ns - stamps_ns[before]) / np.maximum(span, 1)).reshape(-1, *[1] * (values.ndim - 1))
    mixed = values[before] + share * (values[after] - values[before])
    result[inside] = mixed[inside]
    return result


def joints_on_grid(
    grid_ns: Stamps,
    measured: Sequence[tuple[int, JointMeasurement]],
    names: Sequence[str],
    clock: Clock,
    max_gap_s: float,
) -> FloatArray:
    """(T, J) a robot's joints at the times of the grid; each by itself, as drivers may split them over messages.

    Args:
        grid_ns: Times.
        measured: Messages and when they came.
        names: Of the joints; others may be among the messages.
        clock: Of the robot.
        max_gap_s: Longest time between two values of a joint that is bridged.

    Raises:
        SetupError: No message has a position of a joint.
    """
    timed = [(clock.time_ns(one.stamp_ns, received_ns), one) for received_ns, one in measured]
    missing = [name for name in names if not any(name in one.joint_names for _, one in timed)]
    if missing:
        there = ", ".join(sorted({name for _, one in timed for name in one.joint_names})) or "no joint at all"
        remedy = "give the names that the bag has as robot_joint_names in [robot], in our order"
        raise SetupError(f"joint {missing[0]}", f"has a position in no message; there are {there}", remedy)
    columns = []
    for name in names:
        pairs = {
            time_ns: one.positions_rad[one.joint_names.index(name)] for time_ns, one in timed if name in one.joint_names
        }
        stamps = np.array(sorted(pairs), dtype=np.int64)
        columns.append(on_grid(grid_ns, stamps, np.array([pairs[int(stamp)] for stamp in stamps]), max_gap_s))
    return np.stack(columns, axis=1)

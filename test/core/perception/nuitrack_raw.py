# SPDX-License-Identifier: Apache-2.0
"""The raw stream of the Nuitrack SDK as NuiSI's recordings hold it, and what the authors' node would publish of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mild_core.perception.skeletons import SOURCES
from mild_core.shapes import FloatArray
from mild_core.signals import SkeletonFrame

_MIDDLE = {1: "head", 2: "neck", 3: "chest", 4: "pelvis"}
_ARMS = {
    first + place: f"{side}_{part}"
    for side, first in (("left", 5), ("right", 11))
    for place, part in enumerate(("clavicle", "shoulder", "elbow", "wrist", "hand"))
}
_LEGS = {
    first + place: f"{side}_{part}"
    for side, first in (("left", 17), ("right", 21))
    for place, part in enumerate(("hip", "knee", "ankle"))
}
JOINT_IDS: dict[int, str] = {**_MIDDLE, **_ARMS, **_LEGS}
"""Numbers of the SDK's `JointType`; fingertips and feet are never tracked."""

ROOM_FROM_SDK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""(z, -x, y): the SDK has x right, y up, z away, which is left-handed; x forward, y left, z up is not."""

OPTICAL_FROM_ROOM = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])

Recorded = list[tuple[int, tuple[SkeletonFrame, ...]]]


def read(path: Path) -> Recorded:
    """Time of each line [ns] and who is in it, in metres, x forward, y left, z up of the camera.

    A line is `index, unix_ms, n_joints` and 25 x (id, confidence, projective x y z, real x y z [mm]).
    """
    frames: Recorded = []
    for line in path.read_text().splitlines():
        values = np.array(line.rstrip(",").split(","), dtype=np.float64)
        stamp_ns = int(values[1]) * 1_000_000
        joints = {int(row[0]): row for row in values[3:].reshape(-1, 8)}
        frames.append((stamp_ns, (_person(stamp_ns, joints),) if joints else ()))
    return frames


def as_published(frames: Recorded) -> Recorded:
    """The node's messages of it: 14 joints of the upper body, optical axes, no confidence, none without a person."""
    names = tuple(SOURCES["nuitrack"].joint_ids.values())
    return [(stamp_ns, (_upper_body(people[0], names),)) for stamp_ns, people in frames if people]


def _person(stamp_ns: int, joints: dict[int, FloatArray]) -> SkeletonFrame:
    rows = np.stack([joints[number] for number in JOINT_IDS])
    positions = rows[:, 5:] @ ROOM_FROM_SDK.T * 0.001
    return SkeletonFrame(stamp_ns, "nuitrack", 0, tuple(JOINT_IDS.values()), positions, rows[:, 1])


def _upper_body(person: SkeletonFrame, names: tuple[str, ...]) -> SkeletonFrame:
    places = [person.joint_names.index(name) for name in names]
    positions = person.positions_m[places] @ OPTICAL_FROM_ROOM.T
    return SkeletonFrame(person.stamp_ns, "nuitrack", 0, names, positions, np.ones(len(names)))

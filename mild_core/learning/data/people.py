# SPDX-License-Identifier: Apache-2.0
"""People files: recordings of whole bodies, several people in one frame, to measure a model on strangers."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mild_core.errors import DatasetError
from mild_core.learning.data.safe_npz import read_safe_npz
from mild_core.perception.skeletons import JOINTS
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import SkeletonFrame

UNSEEN = -32768
"""Stands in the file for a joint that was not seen."""

STANDING_S, NOISE_M = 1.5, 0.002
"""The first pose stands for so long before each recording, with so much noise: people in recordings walk at once, and
perception wants a second of standing."""

FRAME = "people"
REMEDY = "see `mild evaluate --help` for the layout of a people file"


@dataclass(frozen=True, eq=False)
class PeopleRecording:
    """Some people at the same time.

    Attributes:
        name: In the file.
        label: The interaction; "" for none.
        active_s: When it is performed: from, to; NaN where unknown.
        joint_names: J names of `JOINTS`.
        positions_m: (T, P, J, 3) in one frame with z up; NaN where not seen.
        times_s: (T,) from the beginning.
    """

    name: str
    label: str
    active_s: tuple[float, float]
    joint_names: tuple[str, ...]
    positions_m: FloatArray
    times_s: FloatArray

    @property
    def people(self) -> int:
        """P."""
        return int(self.positions_m.shape[1])

    def joint(self, person: int, name: str) -> FloatArray:
        """(T, 3) of a person's joint [m]; NaN where it was not seen."""
        return self.positions_m[:, person, self.joint_names.index(name)]


def read_people(path: Path) -> tuple[PeopleRecording, ...]:
    """All recordings of a people file.

    Raises:
        DatasetError: The file is none; names the array.
    """
    thing = f"people file '{path}'"
    named = read_safe_npz(path, ("joint_names", "labels", "active_s"))
    with zipfile.ZipFile(path) as archive:  # `read_safe_npz` has judged it
        entries = [name.removesuffix(".npy") for name in archive.namelist()]
    arrays = named | read_safe_npz(path, [name for name in entries if name.endswith(("_times_ms", "_positions_mm"))])
    joints = tuple(str(name) for name in np.atleast_1d(arrays["joint_names"]))
    unknown = sorted(set(joints) - set(JOINTS))
    if unknown or len(set(joints)) != len(joints):
        raise DatasetError(thing, f"names joints {', '.join(unknown) or 'twice'}", REMEDY)
    names = sorted(name.removesuffix("_times_ms") for name in arrays if name.endswith("_times_ms"))
    labels, active = np.atleast_1d(arrays["labels"]), np.asarray(arrays["active_s"], dtype=np.float64)
    if len(labels) != len(names) or active.shape != (len(names), 2):
        raise DatasetError(thing, f"has {len(names)} recordings but {len(labels)} labels", REMEDY)
    found = []
    for index, name in enumerate(names):
        label, (begin, end) = str(labels[index]), active[index].tolist()
        found.append(_recording(thing, name, label, (begin, end), joints, arrays))
    return tuple(found)


def _recording(
    thing: str, name: str, label: str, active_s: tuple[float, float], joints: tuple[str, ...], arrays: Mapping[str, Any]
) -> PeopleRecording:
    times, positions = np.asarray(arrays[f"{name}_times_ms"]), arrays.get(f"{name}_positions_mm")
    if positions is None or positions.shape != (len(times), *positions.shape[1:2], len(joints), 3):
        raise DatasetError(thing, f"recording {name} has no positions (T, P, {len(joints)}, 3)", REMEDY)
    if len(times) < 2 or not (np.diff(times.astype(np.int64)) > 0).all():
        raise DatasetError(thing, f"recording {name} has times that do not increase", REMEDY)
    metres = np.where(positions == UNSEEN, np.nan, positions * 1e-3)
    times_s = (times.astype(np.int64) - int(times[0])) * 1e-3
    return PeopleRecording(name, label, active_s, joints, read_only(metres), read_only(times_s))


def skeletons(recording: PeopleRecording, person: int, seed: int = 0) -> Iterator[tuple[float, SkeletonFrame]]:
    """Time in the recording [s] and skeleton of one person: first standing (negative times), then as recorded."""
    rng, period_s = np.random.default_rng(seed), float(np.median(np.diff(recording.times_s)))
    standing = max(1, round(STANDING_S / period_s))
    still = recording.positions_m[0, person]
    for index in range(-standing, 0):
        yield index * period_s, _skeleton(recording, index * period_s, still + NOISE_M * rng.normal(size=still.shape))
    for time_s, positions_m in zip(recording.times_s.tolist(), recording.positions_m[:, person], strict=True):
        yield time_s, _skeleton(recording, time_s, positions_m)


def _skeleton(recording: PeopleRecording, time_s: float, positions_m: FloatArray) -> SkeletonFrame:
    seen = np.isfinite(positions_m).all(axis=1)
    stamp_ns = round((time_s + 2.0 * STANDING_S) * 1e9)
    return SkeletonFrame(stamp_ns, FRAME, 1, recording.joint_names, positions_m, np.where(seen, 1.0, 0.0))

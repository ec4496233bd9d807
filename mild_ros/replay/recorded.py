# SPDX-License-Identifier: Apache-2.0
"""A recorded run as arrays: what the person did, what was inferred, commanded and measured, all on one time axis."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mild_core.errors import BagError, DataError
from mild_core.perception.skeletons import SkeletonSource
from mild_core.shapes import FloatArray
from mild_core.signals import JointMeasurement, MotionWindow, SkeletonFrame
from mild_ros.bag.people import people_in_bag, source_fault
from mild_ros.bag.reader import BagReader, RawMessage, open_bag
from mild_ros.messages.handled import Handled, handled_from_msg
from mild_ros.messages.joint_state import joint_command_from_msg, joint_measurement_from_msg
from mild_ros.messages.motion import motion_from_msgs
from mild_ros.replay.events import TRUE_MOTION
from mild_ros.replay.pairing import StampPairs


@dataclass(frozen=True, eq=False)
class JointTrack:
    """Joint positions over time.

    Attributes:
        joint_names: J names.
        stamps_ns: (T,) as the messages say.
        arrived_ns: (T,) when they were recorded.
        positions_rad: (T, J).
        velocities_rad_s: (T, J); zeros where messages had none.
    """

    joint_names: tuple[str, ...]
    stamps_ns: np.ndarray
    arrived_ns: np.ndarray
    positions_rad: FloatArray
    velocities_rad_s: FloatArray

    def of(self, joint_names: tuple[str, ...]) -> JointTrack:
        """The same of some joints only, in the order given."""
        columns = [self.joint_names.index(name) for name in joint_names]
        positions, velocities = self.positions_rad[:, columns], self.velocities_rad_s[:, columns]
        return JointTrack(joint_names, self.stamps_ns, self.arrived_ns, positions, velocities)

    def at(self, stamps_ns: np.ndarray) -> FloatArray:
        """(N, J) positions interpolated at these stamps; its ends before and after."""
        columns = [np.interp(stamps_ns, self.stamps_ns, column) for column in self.positions_rad.T]
        return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """Everything of one run.

    Attributes:
        path: The bag.
        people: Each tracker message's first person, in order.
        tracker_arrived_ns: When the tracker's messages were recorded, those without people too.
        commands: None when there were none.
        measured: The robot's own states; None when there were none.
        truth: What the recorded robot did in truth; None when unknown.
        motions: What was inferred.
        outcomes: The outcome of each input, as far as published.
        diagnostics: Values of each node's diagnostics, message by message.
        counts: Messages by topic.
        duration_s: Of the whole bag.
    """

    path: Path
    people: tuple[SkeletonFrame, ...]
    tracker_arrived_ns: np.ndarray
    commands: JointTrack | None
    measured: JointTrack | None
    truth: JointTrack | None
    motions: tuple[MotionWindow, ...]
    outcomes: tuple[Handled, ...] = ()
    diagnostics: dict[str, list[dict[str, str]]] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    duration_s: float = 0.0

    @property
    def start_ns(self) -> int:
        """Time zero of everything shown: the first person's stamp."""
        return self.people[0].stamp_ns

    def seconds(self, stamps_ns: Any) -> FloatArray:
        """Seconds since `start_ns`."""
        since_ns = np.asarray(stamps_ns, dtype=np.int64) - self.start_ns
        return since_ns.astype(np.float64) * 1e-9


def read_run(path: Path, source: SkeletonSource, *, salvage: bool = False) -> RecordedRun:
    """Read a bag that `record` or `replay` wrote, or a tracker's own.

    Raises:
        BagError: It cannot be read or shows no person.
    """
    with open_bag(path, salvage=salvage) as bag:
        tracked = list(people_in_bag(bag, source))
        people = tuple(found[0] for _, found in tracked if found)
        if not people:
            fault, remedy = source_fault(bag, source, looked_at=None)
            fault = f"shows no person to {source.name}" + (f": {fault}" if fault else "")
            raise BagError(str(path), fault, remedy or "choose a bag with a person in it")
        first_ns, last_ns = _ends(bag)
        return RecordedRun(
            path=path,
            people=people,
            tracker_arrived_ns=np.array([time_ns for time_ns, _ in tracked], dtype=np.int64),
            commands=_track(bag, "/joint_command", joint_command_from_msg),
            measured=_track(bag, "/joint_states", joint_measurement_from_msg),
            truth=_track(bag, f"/{TRUE_MOTION}", joint_measurement_from_msg),
            motions=_motions(bag),
            outcomes=tuple(handled_from_msg(message) for _, message in _all(bag, "/handled")),
            diagnostics=_diagnostics(bag),
            counts={topic: summary.count for topic, summary in bag.topics.items()},
            duration_s=(last_ns - first_ns) * 1e-9,
        )


def _all(bag: BagReader, topic: str) -> Iterable[tuple[RawMessage, Any]]:
    """Every message of a topic that can be read; none when there is no such topic."""
    for raw in bag.messages([topic]):
        try:
            yield raw, bag.decode(raw)
        except DataError:
            continue  # shown is what can be; the nodes have counted the rest


def _ends(bag: BagReader) -> tuple[int, int]:
    times = [raw.time_ns for raw in bag.messages()]
    return min(times), max(times)


def _track(bag: BagReader, topic: str, read: Callable[[Any], Any]) -> JointTrack | None:
    arrived: list[int] = []
    values: list[Any] = []
    for raw, message in _all(bag, topic):
        try:
            value = read(message)
        except DataError:
            continue
        if isinstance(value, JointMeasurement):  # others' joints may be anything
            finite = np.isfinite(value.positions_rad)
            names = tuple(itertools.compress(value.joint_names, finite))
            value = JointMeasurement(value.stamp_ns, names, value.positions_rad[finite])
        if not values or value.joint_names == values[0].joint_names:
            arrived.append(raw.time_ns)
            values.append(value)
    if not values:
        return None
    positions = np.stack([value.positions_rad for value in values])
    still = isinstance(values[0], JointMeasurement)
    velocities = np.zeros_like(positions) if still else np.stack([value.velocities_rad_s for value in values])
    stamps = np.array([value.stamp_ns for value in values], dtype=np.int64)
    return JointTrack(values[0].joint_names, stamps, np.array(arrived, dtype=np.int64), positions, velocities)


def _motions(bag: BagReader) -> tuple[MotionWindow, ...]:
    found: list[MotionWindow] = []

    def keep(trajectory: Any, state: Any) -> None:
        try:
            found.append(motion_from_msgs(trajectory, state))
        except DataError:
            return

    pairs = StampPairs(keep, lambda stamp_ns: None)
    for raw in bag.messages(["/motion", "/motion_state"]):
        (pairs.left if raw.topic == "/motion" else pairs.right)(bag.decode(raw))
    return tuple(found)


def _diagnostics(bag: BagReader) -> dict[str, list[dict[str, str]]]:
    reports: dict[str, list[dict[str, str]]] = {}
    for _, message in _all(bag, "/diagnostics"):
        for status in message.status:
            reports.setdefault(status.name, []).append({value.key: value.value for value in status.values})
    return reports

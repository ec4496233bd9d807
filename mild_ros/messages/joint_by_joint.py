# SPDX-License-Identifier: Apache-2.0
"""People whose joints come one at a time, put together to frames.

A frame is done when it holds the joints of everybody who was in the frame before, and at the latest when one of them
comes again. So no rate has to be known, an occluded joint delays one frame, and a lost person likewise. A joint that
comes after its frame was done is merged into the next one unless it comes again: a joint that is always late is still
used.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from mild_core.signals import SkeletonFrame

People = tuple[SkeletonFrame, ...]
Point = tuple[float, float, float]

SPREAD_NS = 50_000_000
"""A joint seen longer than this before the newest one does not belong to the same frame."""

BACK_NS = 1_000_000_000
"""Stamps that are older than the frame before by this much come from a clock that was turned back."""


class Sample(NamedTuple):
    """Where a joint was.

    Attributes:
        stamp_ns: When.
        frame_id: The tf frame of its position.
        position: Its place there [m].
    """

    stamp_ns: int
    frame_id: str
    position: Point


class JointByJoint:
    """The frame that is being put together.

    Args:
        joint_names: All that a person may have.
    """

    def __init__(self, joint_names: Sequence[str]) -> None:
        self._joint_names = tuple(joint_names)
        self._numbers: dict[str, int] = {}
        self._clear()

    def _clear(self) -> None:
        self._frame: dict[str, dict[str, Sample]] = {}
        self._expected: dict[str, set[str]] = {}
        self._done: dict[str, dict[str, Sample]] = {}
        self._late: dict[str, dict[str, Sample]] = {}
        self._newest_ns = -1

    def add(self, person: str, joint: str, sample: Sample) -> People | None:
        """Take one joint.

        Args:
            person: The tracker's name of whose it is.
            joint: Its name.
            sample: Where it was.

        Returns:
            Everyone in the frame that this joint ends; None when it ends none.
        """
        if sample.stamp_ns < self._newest_ns - BACK_NS:
            self._clear()
        if sample.stamp_ns <= self._newest_ns:  # its frame is done: the next one waits for this joint too
            self._expected.setdefault(person, set()).add(joint)
            before = self._done.get(person, {}).get(joint)
            if before is None or before.stamp_ns < sample.stamp_ns:
                self._late.setdefault(person, {})[joint] = sample
            return None
        joints = self._frame.get(person, {})
        if joint in joints and joints[joint].stamp_ns == sample.stamp_ns:
            return None
        done = self._taken() if joint in joints else None
        self._frame.setdefault(person, {})[joint] = sample
        return done or (self._taken() if self._is_whole() else None)

    def forget(self, persons: Collection[str]) -> None:
        """These are no longer seen: wait for none of their joints."""
        for person in persons:
            for known in (self._expected, self._frame, self._late):
                known.pop(person, None)

    def _is_whole(self) -> bool:
        wanted = self._expected or {person: set(self._joint_names) for person in self._frame}
        return all(self._frame.get(person, {}).keys() >= joints for person, joints in wanted.items())

    def _taken(self) -> People:
        frame = {name: {**self._late.get(name, {}), **joints} for name, joints in self._frame.items()}
        self._done, self._frame, self._late = frame, {}, {}
        self._newest_ns = max(sample.stamp_ns for joints in frame.values() for sample in joints.values())
        people = {name: self._person(name, joints) for name, joints in frame.items()}
        seen = {name: person for name, person in people.items() if person is not None}
        self._expected = {name: set(person.joint_names) for name, person in seen.items()}
        return tuple(seen.values())

    def _person(self, name: str, joints: dict[str, Sample]) -> SkeletonFrame | None:
        """A person of the joints that belong together: seen at one time, in one tf frame."""
        recent = {joint: s for joint, s in joints.items() if s.stamp_ns >= self._newest_ns - SPREAD_NS}
        if not recent:
            return None
        frame_id = next(iter(recent.values())).frame_id
        names = [joint for joint in self._joint_names if joint in recent and recent[joint].frame_id == frame_id]
        return SkeletonFrame(
            stamp_ns=max(recent[joint].stamp_ns for joint in names),
            frame_id=frame_id,
            person_id=self._number(name),
            joint_names=tuple(names),
            positions_m=np.array([recent[joint].position for joint in names], dtype=np.float64),
            confidence=np.ones(len(names)),
        )

    def _number(self, name: str) -> int:
        """The person's number where the name is one, otherwise one in order of appearance."""
        return int(name) if name.isdecimal() else self._numbers.setdefault(name, len(self._numbers))

# SPDX-License-Identifier: Apache-2.0
"""People as tf frames: `tf2_msgs/TFMessage`, of any tracker or of ROS4HRI with `hri_msgs/IdsList` beside it.

This needs no tf2: a joint's position is its frame's origin, brought down the tree to the root or the frame asked for,
by the newest transforms. A joint is as new as the first transform above it that is not static.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

from mild_core.errors import DataError
from mild_core.perception.skeletons import SkeletonSource
from mild_core.perception.skeletons.source import PERSON
from mild_ros.messages.feeds import Feed
from mild_ros.messages.joint_by_joint import JointByJoint, People, Point, Sample
from mild_ros.messages.stamps import ns_from_msg

TRANSFORMS, TRACKED = "tf2_msgs/msg/TFMessage", "hri_msgs/msg/IdsList"
TRACKED_TOPIC = "/humans/bodies/tracked"
_DEEPEST = 100
"""No tree is deeper; a loop in one ends here."""

UNIT_TO = 0.01
"""How far the square of a quaternion's length may be from 1; nearer ones are of short decimals, and made to be of 1."""

_LISTED = 8
"""So many names fit into a line."""


@dataclass(frozen=True)
class Link:
    """A frame in its parent.

    Attributes:
        parent: The parent's name.
        stamp_ns: When it was so; None for always.
        rotation: Quaternion x y z w.
        translation: Of the frame's origin [m].
    """

    parent: str
    stamp_ns: int | None
    rotation: tuple[float, float, float, float]
    translation: Point


def transform_feeds(source: SkeletonSource) -> tuple[Feed, ...]:
    """The tree of frames, moving and static."""
    return _feeds(TransformPeople(source))


def tracked_body_feeds(source: SkeletonSource) -> tuple[Feed, ...]:
    """The tree of frames, and the list of bodies that are seen now."""
    people = TransformPeople(source)
    people.tracked = ()
    return (*_feeds(people), Feed(TRACKED_TOPIC, TRACKED, people.list_tracked))


def _feeds(people: TransformPeople) -> tuple[Feed, ...]:
    moving = Feed("/tf", TRANSFORMS, people.move, lacks=people.lacking)
    return moving, Feed("/tf_static", TRANSFORMS, people.fix, latched=True)


class TransformPeople:
    """The newest tree of frames and the people in it.

    Args:
        source: Names of frames by joint.

    Attributes:
        tracked: Names of the people who are seen now; None for everybody with frames.
    """

    def __init__(self, source: SkeletonSource) -> None:
        self.tracked: tuple[str, ...] | None = None
        self._root, self._places = source.root, source.places
        self._links: dict[str, Link] = {}
        self._movers: set[str] = set()
        self._frames: dict[tuple[str, str], tuple[int, str]] = {}
        self._joints = JointByJoint(tuple(source.places))
        self._patterns = [
            (rank, re.compile(re.escape(place.lstrip("/")).replace(re.escape(PERSON), "(.+)")), joint)
            for joint, places in source.places.items()
            for rank, place in enumerate(places)
        ]

    def move(self, message: Any, now_ns: int) -> People | None:
        """Take transforms of now; what moves no joint, as most of a robot's, ends here.

        Raises:
            DataError: `not_a_transform` when one that a joint hangs on is none; the others have been taken.
        """
        moved, wrong = False, []
        for transform in message.transforms:
            if why := _fault(transform):
                wrong.append((_name(transform.child_frame_id), why))
                continue
            frame = self._link(transform, ns_from_msg(transform.header.stamp) or now_ns)
            moved = moved or frame in self._movers
        if wrong:
            self._check(wrong)
        done = None
        for (person, joint), (_, frame) in self._frames.items() if moved else ():
            if self.tracked is None or person in self.tracked:
                sample = self._sample(frame)
                done = (sample and self._joints.add(person, joint, sample)) or done
        return done

    def fix(self, message: Any, now_ns: int) -> None:
        """Take transforms of always.

        Raises:
            DataError: `not_a_transform` when one is none; the others have been taken.
        """
        wrong = []
        for transform in message.transforms:
            if why := _fault(transform):
                wrong.append((_name(transform.child_frame_id), why))
            else:
                self._link(transform, None)
        if wrong:
            raise DataError("not_a_transform", f"'{wrong[0][0]}' {wrong[0][1]}")

    def list_tracked(self, message: Any, now_ns: int) -> People | None:
        """Take the list of who is seen; an empty message means no one."""
        before, self.tracked = self.tracked or (), tuple(str(name) for name in message.ids)
        self._joints.forget([name for name in before if name not in self.tracked])
        return None if self.tracked else ()

    def lacking(self) -> str:
        """Which joints have no tf frame, as a line for an operator; "" when each has one."""
        found = {joint for _, joint in self._frames}
        missing = [places[0] for joint, places in self._places.items() if joint not in found]
        if not missing:
            return ""
        seen = ", ".join(sorted(self._links)[:_LISTED]) + (", ..." if len(self._links) > _LISTED else "")
        return f"/tf has no {', '.join(missing)}, but {seen or 'nothing'}: name the frames in joint_places"

    def _check(self, wrong: list[tuple[str, str]]) -> None:
        """Complain of a transform that is none if a joint hangs on its frame; those of a robot are not ours."""
        for frame, _ in wrong:
            if frame not in self._links:
                self._look_at_name(frame)
        above = {frame for _, frame in self._frames.values()}
        for frame in tuple(above):
            for _ in range(_DEEPEST):
                link = self._links.get(frame)
                if link is None or frame == self._root:
                    break
                frame = link.parent
                above.add(frame)
        for frame, why in wrong:
            if frame in above:
                raise DataError("not_a_transform", f"'{frame}' {why}")

    def _link(self, transform: Any, stamp_ns: int | None) -> str:
        rotation, translation = transform.transform.rotation, transform.transform.translation
        frame = _name(transform.child_frame_id)
        length = math.hypot(rotation.x, rotation.y, rotation.z, rotation.w)
        if frame not in self._links:
            self._look_at_name(frame)
        self._links[frame] = Link(
            _name(transform.header.frame_id),
            stamp_ns,
            (rotation.x / length, rotation.y / length, rotation.z / length, rotation.w / length),
            (translation.x, translation.y, translation.z),
        )
        return frame

    def _look_at_name(self, frame: str) -> None:
        """Note whose joint a new frame is, if it is one and no better one is there."""
        for rank, pattern, joint in self._patterns:
            if (found := pattern.fullmatch(frame)) is not None:
                owner = (found.group(1) if found.groups() else "0"), joint
                if owner not in self._frames or rank < self._frames[owner][0]:
                    self._frames[owner] = rank, frame
                    self._movers.add(frame)

    def _sample(self, frame: str) -> Sample | None:
        """Where a frame's origin is; None before anything above it has moved."""
        stamp_ns, position = None, (0.0, 0.0, 0.0)
        for _ in range(_DEEPEST):
            link = self._links.get(frame)
            if link is None or frame == self._root:
                break
            if stamp_ns is None and link.stamp_ns is not None:
                stamp_ns = link.stamp_ns
                self._movers.add(frame)
            x, y, z = _turned(link.rotation, position)
            position = (x + link.translation[0], y + link.translation[1], z + link.translation[2])
            frame = link.parent
        return None if stamp_ns is None else Sample(stamp_ns, frame, position)


def _name(frame_id: Any) -> str:
    return str(frame_id).lstrip("/")


def _fault(transform: Any) -> str:
    """Why a transform is none, as tf2 judges it; "" when it is one.

    Source: geometry2, tf2/src/buffer_core.cpp, BufferCore::setTransformImpl.
    """
    rotation, translation = transform.transform.rotation, transform.transform.translation
    parent, child = _name(transform.header.frame_id), _name(transform.child_frame_id)
    norm = math.hypot(rotation.x, rotation.y, rotation.z, rotation.w)  # squared it may overflow
    if not math.isfinite(norm + translation.x + translation.y + translation.z):
        return f"in '{parent}' is not finite"
    if abs(min(norm, 10.0) ** 2 - 1.0) > UNIT_TO:
        return f"in '{parent}' is turned by a quaternion of length {norm:.3g}, not 1"
    if not parent or not child or parent == child:
        return f"has the parent '{parent}'"
    return ""


def _turned(rotation: tuple[float, float, float, float], point: Point) -> Point:
    """A point turned by a unit quaternion: p + 2 w (q x p) + 2 q x (q x p)."""
    if point == (0.0, 0.0, 0.0):
        return point
    (x, y, z, w), (px, py, pz) = rotation, point
    cx, cy, cz = 2.0 * (y * pz - z * py), 2.0 * (z * px - x * pz), 2.0 * (x * py - y * px)
    return (
        px + w * cx + y * cz - z * cy,
        py + w * cy + z * cx - x * cz,
        pz + w * cz + x * cy - y * cx,
    )

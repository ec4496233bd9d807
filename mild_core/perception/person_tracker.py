# SPDX-License-Identifier: Apache-2.0
"""Who is watched: one person, by the tracker's number while it is where they were, by place when it changes.

Trackers renumber people who were hidden and swap the numbers of people who pass each other, so neither the number
nor the order in a message is enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from mild_core.perception.joint_validity import Body, Point, body_of, seen_joint
from mild_core.signals import SkeletonFrame

TRUNK = ("pelvis", "chest", "left_shoulder", "right_shoulder", "head")
"""Joints that locate a person; limbs move too fast for that."""

RUNNING_M_S = 3.0
"""A person with the right number may have gone this fast while hidden."""

SAME_NUMBER_BONUS_M = 0.2
"""Of two bodies nearly in one place (a handshake, a hug), the one with the right number wins."""

Trunk = tuple[Point | None, ...]


@dataclass(frozen=True)
class PersonTrack:
    """The watched person as last seen.

    Attributes:
        person_id: The tracker's number then.
        frame_id: The tf frame of the places.
        trunk_m: Places [m] of `TRUNK`, None for those never seen.
        stamp_ns: Stamp of the frame.
        received_ns: When it came, on the clock of `now_ns`: people are forgotten by this one, because a message
            without people has no stamp.
    """

    person_id: int
    frame_id: str
    trunk_m: Trunk
    stamp_ns: int
    received_ns: int


class Detection(NamedTuple):
    """A person in a message, and where their `TRUNK` is [m]."""

    person: SkeletonFrame
    body: Body
    trunk_m: Trunk


def track_from(lock: PersonTrack | None, seen: Detection, received_ns: int) -> PersonTrack:
    """The lock after this frame; parts of the trunk that it hides stay where they were."""
    trunk, person = seen.trunk_m, seen.person
    if lock is not None and None in trunk:
        trunk = tuple(new or old for new, old in zip(trunk, lock.trunk_m, strict=True))
    return PersonTrack(person.person_id, person.frame_id, trunk, person.stamp_ns, received_ns)


def find_person(lock: PersonTrack | None, everyone: Sequence[Detection], reach_m: float) -> Detection | None:
    """The watched person among people; without a lock the one nearest to the origin of the axes.

    Args:
        lock: Who is watched.
        everyone: Any number.
        reach_m: How far from the last place a body with another number may be.

    Returns:
        None when no detection fits.
    """
    if lock is None:
        return min(everyone, key=_distance_from_origin, default=None)
    best, least = None, math.inf
    for seen in everyone:
        same = seen.person.person_id == lock.person_id
        distance = apart_m(lock.trunk_m, seen.trunk_m)
        if distance is None and same:
            distance = 0.0
        hidden_s = max(0.0, (seen.person.stamp_ns - lock.stamp_ns) * 1e-9)
        if distance is None or distance > reach_m + same * RUNNING_M_S * hidden_s:
            continue
        score = distance - same * SAME_NUMBER_BONUS_M
        if score < least:
            best, least = seen, score
    return best


def detection_of(person: SkeletonFrame) -> Detection:
    """A person of a message."""
    body = body_of(person)
    return Detection(person, body, tuple([seen_joint(body, name) for name in TRUNK]))


def apart_m(one: Trunk, other: Trunk) -> float | None:
    """Distance [m] between two trunks: the median of the joints', as trackers throw single ones away.

    None without a common joint.
    """
    pairs = zip(one, other, strict=True)
    distances = sorted([math.dist(here, there) for here, there in pairs if here is not None and there is not None])
    if not distances:
        return None
    half = len(distances) // 2
    return distances[half] if len(distances) % 2 else (distances[half - 1] + distances[half]) / 2.0


def _distance_from_origin(seen: Detection) -> float:
    places = [math.hypot(*place) for place in seen.trunk_m if place is not None]
    return min(places, default=math.inf)

# SPDX-License-Identifier: Apache-2.0
"""Everyone in view as the robot has to respect them: capsules in its base frame that move on, and what each is owed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mild_core.retargeting.human_track import AssumedPlacement, Point
from mild_core.retargeting.robot_model.chain import nearest_points
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import ARM_FRAME, NO_SEGMENTS, WATCHED_PERSON, BodySegments, PersonPose

HORIZON_S = 0.4
"""A segment goes on at its velocity for no longer than this after it was seen: then it may have turned."""

AGED_S, AGED_M_S, AGED_MOST_M = 0.15, 0.2, 0.2
"""From the first age on, a segment's radius grows at the second rate by the third at most: where it went is unknown.
Source: a standing person who is not watched steps aside rather than runs."""

KEPT_S = 5.0
"""Without a new pose, people are assumed to stay where they were for this long [s]."""

TOUCHED_M = 0.15
"""The watched hand is no further than this from the axis of its own forearm's segment, which reaches to the fingers."""

ZONE_MARGIN_M = 0.05
"""Speed is limited this much before the zone begins: what a tracker's noise, its latency and the size of a body may
take from a distance."""

HAND_PARTS = ("left_forearm", "right_forearm")


@dataclass(frozen=True, eq=False)
class Crowd:
    """The newest pose's segments, in the frame in which they came.

    Attributes:
        segments: Of everyone in view.
        frame_id: That frame.
        stamp_ns: When they were seen.
        facing: (3,) where the watched person's chest points; NaN when not known.
        watched_parts: Names of the parts of the watched person that are known.
    """

    segments: BodySegments
    frame_id: str
    stamp_ns: int
    facing: FloatArray
    watched_parts: frozenset[str] = field(init=False)

    def __post_init__(self) -> None:
        each = zip(self.segments.people, self.segments.parts, strict=True)
        known = frozenset(part for person, part in each if person == WATCHED_PERSON)
        object.__setattr__(self, "watched_parts", known)

    @staticmethod
    def of(pose: PersonPose) -> Crowd:
        """Those of a pose."""
        return Crowd(pose.segments, pose.frame_id, pose.stamp_ns, pose.facing)


@dataclass(frozen=True, eq=False)
class Obstacles:
    """S body segments at one time, in the robot's base frame.

    Attributes:
        people: S numbers, `WATCHED_PERSON` or a bystander's.
        parts: S names of `BODY_PARTS`.
        ends_m: (S, 2, 3) ends of each axis.
        velocities_m_s: (S, 2, 3) of these.
        radii_m: (S,) as they are believed to be.
        keep_m: (S,) what is kept from each; minus infinity from the hand that may be touched.
        zones_m: (S,) nearer than this, speed is limited.
        horizon_s: They go on at their velocities for so long.
        offered: Place of the forearm with the watched hand; -1 where it is not known.
        speeds_m_s: (S,) greatest speed of each.
    """

    people: tuple[int, ...]
    parts: tuple[str, ...]
    ends_m: FloatArray
    velocities_m_s: FloatArray
    radii_m: FloatArray
    keep_m: FloatArray
    zones_m: FloatArray
    horizon_s: float = HORIZON_S
    offered: int = -1
    speeds_m_s: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        for name in ("ends_m", "velocities_m_s", "radii_m", "keep_m", "zones_m"):
            # Compiled once for arrays of one kind.
            object.__setattr__(self, name, read_only(np.ascontiguousarray(getattr(self, name))))
        speeds = np.sqrt((self.velocities_m_s**2).sum(axis=2)).max(axis=1, initial=0.0)
        object.__setattr__(self, "speeds_m_s", speeds)

    def is_bystander(self, place: int) -> bool:
        """Whether the segment at a place belongs to a person who is not tracked."""
        return place >= 0 and self.people[place] != WATCHED_PERSON

    def touchable(self) -> Obstacles:
        """The same, of whom the offered hand and forearm may be touched."""
        if self.offered < 0 or self.keep_m[self.offered] == -np.inf:
            return self
        keep = self.keep_m.copy()
        keep[self.offered] = -np.inf
        return replace(self, keep_m=keep)


NO_ONE = Obstacles((), (), np.zeros((0, 2, 3)), np.zeros((0, 2, 3)), np.zeros(0), np.zeros(0), np.zeros(0))
"""No people, no obstacles."""


def obstacles_of(
    crowd: Crowd | None,
    settings: RetargetingSettings,
    standing: AssumedPlacement | None,
    place_m: Point | None,
    hand_m: FloatArray,
    now_ns: int,
) -> Obstacles:
    """Everyone at the time at which the robot will be where it is sent now.

    Args:
        crowd: As they were seen last.
        settings: What is kept.
        standing: Where people stand whom no calibrated camera sees; without it these are nowhere.
        place_m: Where the watched one of them stands now.
        hand_m: (3,) the watched hand in the robot's base frame; NaN when it is not known.
        now_ns: Time of the command.
    """
    if crowd is None or crowd.segments is NO_SEGMENTS or not len(crowd.segments.people):
        return NO_ONE
    age_s = max(0.0, (now_ns - crowd.stamp_ns) * 1e-9)
    if age_s > KEPT_S:
        return NO_ONE
    segments, unsure_m = crowd.segments, 0.0
    if crowd.frame_id == ARM_FRAME:
        if standing is None:
            return NO_ONE
        places = [place_m or standing.place_m]
        if not settings.allow_unmeasured_contact:  # who allows it says that people stand on a mark
            places += standing.others(places[0])
        segments = _at_places(segments, standing, places)
        unsure_m = settings.placement_uncertainty_m
    ends, velocities = segments.ends_m, segments.velocities_m_s
    ahead_s = min(age_s + settings.ahead_s, HORIZON_S)
    ends = ends + ahead_s * velocities
    radii = segments.radii_m + min(max(age_s - AGED_S, 0.0) * AGED_M_S, AGED_MOST_M)
    keep = np.full(len(radii), settings.keep_out_m + unsure_m)
    zones = np.full(len(radii), settings.near_m + ZONE_MARGIN_M + unsure_m)
    offered = _forearm_of(segments, ends, hand_m)
    if offered >= 0 and unsure_m > 0.0:
        # One shift places the whole body: an upper arm lies behind its hand, which is met first.
        own = segments.parts[offered].replace("forearm", "upper_arm")
        for place_of, (person, part) in enumerate(zip(segments.people, segments.parts, strict=True)):
            if person == WATCHED_PERSON and part == own:
                keep[place_of] = settings.keep_out_m
    for array in (ends, radii, keep, zones):
        array.flags.writeable = False  # not shared, so `Obstacles` need not copy them
    return Obstacles(
        segments.people,
        segments.parts,
        ends,
        velocities,
        radii,
        keep,
        zones,
        max(0.0, HORIZON_S - ahead_s),
        offered,
    )


def _at_places(segments: BodySegments, standing: AssumedPlacement, places_m: Sequence[Point]) -> BodySegments:
    """Segments relative to a person, at each of the places where that person may stand, in the base frame."""
    ends = [standing.placed(segments.ends_m, ARM_FRAME, place) for place in places_m]
    velocities = standing.placed(segments.velocities_m_s, ARM_FRAME, (0.0, 0.0, 0.0))
    return BodySegments(
        segments.people * len(ends),
        segments.parts * len(ends),
        read_only(np.concatenate(ends)),
        read_only(np.concatenate([velocities] * len(ends))),
        read_only(np.concatenate([segments.radii_m] * len(ends))),
    )


def _forearm_of(segments: BodySegments, ends_m: FloatArray, hand_m: FloatArray) -> int:
    """Place of the watched person's forearm that ends in this hand; -1 if there is none."""
    nearest, found = TOUCHED_M, -1
    if math.isfinite(float(hand_m[0])):
        for place, (person, part) in enumerate(zip(segments.people, segments.parts, strict=True)):
            if person == WATCHED_PERSON and part in HAND_PARTS:
                apart = float(nearest_points(hand_m, hand_m, ends_m[place, 0], ends_m[place, 1])[0])
                if apart < nearest:
                    nearest, found = apart, place
    return found

# SPDX-License-Identifier: Apache-2.0
"""Every body in view as capsules, for a robot that must keep away from all of them.

A body is thirteen landmarks (`LANDMARKS`) that are filtered over messages. What a message does not show is inferred:
it keeps its last place relative to the trunk, or the place that it has in a standing person of the same size, and its
uncertainty grows up to what a body part can move against the trunk. A joint below the confidence bound counts half:
the capsule then covers both its place and the inferred one. A body that is missing from a message stays for a while,
with a radius that grows.

Bodies are matched by place, as trackers renumber people and swap their numbers (`person_tracker.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from mild_core.compiled import compiled
from mild_core.perception.joint_validity import FARTHEST_M, usable
from mild_core.perception.person_tracker import RUNNING_M_S, SAME_NUMBER_BONUS_M, Detection, Trunk, apart_m
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import BODY_PARTS, NO_SEGMENTS, UNKNOWN_DIRECTION, WATCHED_PERSON, BodySegments

LANDMARKS = (
    "head",
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_hand_tip", "right_hand_tip"),
    *("left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"),
)
HEAD, LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_ELBOW, RIGHT_ELBOW, LEFT_TIP, RIGHT_TIP = range(7)
LEFT_HIP, RIGHT_HIP = 7, 8

_ALSO = (
    *("neck", "pelvis", "nose", "left_ear", "right_ear", "left_hand", "right_hand", "left_wrist", "right_wrist"),
    *("left_foot", "right_foot"),
)
"""Joints that stand in for a landmark that a tracker does not give."""
NECK, PELVIS, NOSE, LEFT_EAR, RIGHT_EAR, LEFT_HAND, RIGHT_HAND, LEFT_WRIST, RIGHT_WRIST, LEFT_FOOT, RIGHT_FOOT = range(
    13, 24
)

PARENTS = np.array([-1, -1, -1, 1, 2, 3, 4, -1, -1, 7, 8, 9, 10])
"""Landmark that a limb's landmark hangs on; -1 for those of head and trunk."""

REACH_M = np.array([0.5, 0.8, 0.8, 0.55, 0.55, 0.8, 0.8, 1.0, 1.0, 0.8, 0.8, 0.8, 0.8])
"""A landmark farther than this from its parent, or from the middle of the shoulders, is a tracker's error: above the
bones of the tallest people (`gates.HUMAN_BONE_M`)."""

SPEED_M_S = np.array([4.0, 4.0, 4.0, 6.0, 6.0, 9.0, 9.0, 4.0, 4.0, 6.0, 6.0, 8.0, 8.0])
"""No landmark is faster. Source: sprinting starts for the trunk; a punch's fist reaches 8 to 9 m/s."""

ADULT_M = 1.75
"""Stature for which lengths and radii are stated; they scale with the person's own bones."""

SHOULDER_WIDTH, TRUNK_HEIGHT, HIP_WIDTH, HEAD_HEIGHT = 0.21, 0.28, 0.11, 0.095
UPPER_ARM, THIGH, SHIN = 0.175, 0.242, 0.243
"""Between joint centres, as shares of the stature. Source: R. Drillis, R. Contini, "Body Segment Parameters", 1966, as
in D. Winter, "Biomechanics and Motor Control of Human Movement", fig. 4.1; the shoulders' joint centres lie further in
than its shoulder width."""

SHORTEST_M, TALLEST_M = 0.85, 2.1
"""Statures from a child of two years to the tallest adults; bones say no more than this."""

SMALLEST_HEAD = 0.85
"""A child's head is nearly as large as an adult's: at three years 0.49 m around, an adult's 0.57 m."""

RADII_M = np.array([0.12, 0.16, 0.10, 0.065, 0.06, 0.065, 0.06, 0.11, 0.075, 0.11, 0.075])
"""Of `BODY_PARTS`, of an adult. Source: head and chest as in DIN 33402-2 (95th percentile: head length 0.21 m, chest
depth 0.28 m), the chest wider than deep, so between both; limbs from the circumferences of ANSUR II (C. Gordon et al.,
2014, 95th percentile of men: upper arm 0.41 m, forearm 0.35 m, thigh 0.73 m, calf 0.44 m) divided by 2 pi."""

CROWN_M = 0.06
"""From the middle of the head up to the upper end of its capsule."""

TIP_FROM_HAND_M, TIP_FROM_WRIST_M = 0.09, 0.175
"""From the middle of a hand, and from a wrist, to the finger tips of an adult. Source: as
`person.HAND_FROM_WRIST_M`."""

POSITION_GAIN = 0.75
VELOCITY_GAIN = POSITION_GAIN**2 / (2.0 - POSITION_GAIN)
"""Of the tracking filter. Source: T. Benedict, G. Bordner, IRE Transactions on Automatic Control 1962."""

SHORTEST_STEP_S = 0.02
"""Faster trackers' velocities are smoothed as those of one with this period."""

FORGOTTEN_S = 0.3
"""A landmark that was hidden for longer begins without a velocity."""

HIDDEN_M = np.array([0.16, 0.12, 0.12, 0.15, 0.15, 0.25, 0.25, 0.12, 0.12, 0.2, 0.2, 0.25, 0.25])
"""Uncertainty of an adult's landmark that has not been seen for long. A head: bent 45 degrees about a neck of 0.2 m."""

HIDDEN_M_S = 0.6
"""How fast that uncertainty grows."""

DOUBTED_M = 0.05
"""Least uncertainty of a place that comes from joints below the confidence bound."""

DISAGREEING_M = 0.5
"""A doubted joint that is farther than this from where it is inferred to be is not used."""

COASTING_S = 0.15
"""A body that is missing goes on at its speed for no longer than this."""

MISSING_M_S, MISSING_M = 0.5, 0.3
"""How fast, and how far at most, the radii of a missing body grow."""

COINCIDING_M = 0.15
"""Two bodies whose trunks are nearer to each other than this are one that the tracker shows twice."""

RENUMBERED_M = 0.3
"""A missing body this near to one that was not there before is the same one."""

MOST_BODIES = 16
"""More bodies than this are not followed: the nearest are."""

JITTER_NS, SHORTEST_NS = 500_000_000, 1_000_000
"""A message that is older than the newest by more than this belongs to another time; and the least time between two."""

FACING_S = 0.5
"""After a longer time without shoulders it is not known where a person faces."""

# Columns of a landmark: place, velocity, seconds since it was seen, uncertainty, whether it is known, and the place
# that is inferred for it while it is not seen.
_PLACE, _VELOCITY, _HIDDEN, _SPREAD, _KNOWN, _ANCHOR, _COLUMNS = 0, 3, 6, 7, 8, 9, 12
# Rows after the landmarks: stature, left and up of the trunk, seconds since both shoulders were seen, whether there is
# a trunk; and seconds since the body was seen.
_AXES, _WHOLE, _ROWS = 13, 14, 15


@dataclass(frozen=True, eq=False)
class TrackedBody:
    """One body as followed over messages.

    Attributes:
        number: Its own, for as long as it is followed; above 0.
        person_id: The tracker's number for it in its newest message.
        hidden_s: Since it was in a message.
        trunk_m: Its trunk as last seen; see `identity.TRUNK`.
        marks: (15, 12) its landmarks, read-only.
    """

    number: int
    person_id: int
    hidden_s: float
    trunk_m: Trunk
    marks: FloatArray


@dataclass(frozen=True, eq=False)
class Bodies:
    """Everyone in view, in the tracker's frame.

    Attributes:
        everyone: Who is followed.
        watched: Number of the watched one; 0 for none.
        newest_ns: Stamp of the newest message with people; None before the first.
        time_ns: To which everyone is brought forward, of the clock of the stamps ...
        received_ns: ... and when that message came.
        last_number: The newest body's.
        left_out: How many of the newest message were too many.
    """

    everyone: tuple[TrackedBody, ...] = ()
    watched: int = 0
    newest_ns: int | None = None
    time_ns: int = 0
    received_ns: int = 0
    last_number: int = 0
    left_out: int = 0

    def watched_body(self) -> TrackedBody | None:
        """The watched one."""
        return next((body for body in self.everyone if body.number == self.watched), None)


NO_BODIES = Bodies()


@dataclass(frozen=True, eq=False)
class Placing:
    """From the tracker's frame to that of a pose: `rotation (p - origin_m) + offset_m`.

    Attributes:
        rotation: (3, 3).
        origin_m: (3,) in the tracker's frame.
        offset_m: (3,) in the pose's frame.
    """

    rotation: FloatArray
    origin_m: FloatArray
    offset_m: FloatArray

    def __post_init__(self) -> None:
        for name in ("rotation", "origin_m", "offset_m"):
            object.__setattr__(self, name, _of_one_kind(getattr(self, name)))

    @cached_property
    def rows(self) -> list[list[float]]:
        """The rows of `rotation`."""
        rows: list[list[float]] = self.rotation.tolist()
        return rows

    def placed(self, points_m: FloatArray) -> FloatArray:
        """(N, 3) points of the tracker's frame in that of the pose."""
        moved: FloatArray = (points_m - self.origin_m) @ self.rotation.T + self.offset_m
        return moved


def followed(
    before: Bodies,
    people: Sequence[Detection],
    watched: Detection | None,
    up: FloatArray,
    min_confidence: float,
    reach_m: float,
    keep_s: float,
    now_ns: int,
) -> Bodies:
    """Everyone after one more message.

    Args:
        before: Before it; a message whose stamp is not later changes nothing.
        people: Everyone in it.
        watched: The one of them who is watched.
        up: (3,) unit vector up in the tracker's frame, for a body whose trunk does not show it.
        min_confidence: A joint below this is doubted.
        reach_m: How far a body with another number may be from where one was.
        keep_s: How long a missing body is kept.
        now_ns: When the message came.
    """
    newest_ns = before.newest_ns
    if people:
        stamp_ns = watched.person.stamp_ns if watched is not None else _middle_stamp(people)
        if newest_ns is not None and newest_ns - JITTER_NS <= stamp_ns <= newest_ns:
            return before
        if newest_ns is not None and stamp_ns < newest_ns:  # time has gone back
            before = Bodies(last_number=before.last_number)
        newest_ns = stamp_ns
    elif newest_ns is None:
        stamp_ns = now_ns
    else:
        stamp_ns = before.time_ns + max(now_ns - before.received_ns, 0)
    elapsed_s = max(stamp_ns - before.time_ns, SHORTEST_NS) * 1e-9
    shown = [seen for seen in people if _has_place(seen)]
    left_out = max(len(shown) - MOST_BODIES, 0)
    if left_out:
        shown = sorted(shown, key=lambda seen: (seen is not watched, _nearness(seen)))[:MOST_BODIES]
    number_watched, last_number = before.watched, before.last_number
    everyone: list[TrackedBody] = []
    for seen, body in _matched(before, shown, watched, reach_m):
        person, trunk, marks = seen.person, seen.trunk_m, _NO_MARKS
        if any(_near(trunk, other.trunk_m, COINCIDING_M) for other in everyone):
            continue
        if body is None:
            last_number += 1
            number = last_number
        else:
            number, marks = body.number, body.marks
            if None in trunk:
                trunk = tuple([new or old for new, old in zip(trunk, body.trunk_m, strict=True)])
        positions, confidence = _of_one_kind(person.positions_m), _of_one_kind(person.confidence)
        index = _indices(person.joint_names)
        marks = observed(marks, index, positions, confidence, elapsed_s, up, min_confidence)
        marks.flags.writeable = False
        everyone.append(TrackedBody(number, person.person_id, 0.0, trunk, marks))
        if seen is watched:
            number_watched = number
    taken, seen_now = {body.number for body in everyone}, tuple(everyone)
    for body in before.everyone:
        hidden_s = body.hidden_s + elapsed_s
        if body.number in taken or hidden_s > keep_s or len(everyone) == MOST_BODIES:
            continue
        if any(_is_same(body, other, other.number > before.last_number) for other in seen_now):
            continue
        marks = coasted(body.marks, elapsed_s)
        marks.flags.writeable = False
        everyone.append(TrackedBody(body.number, body.person_id, hidden_s, body.trunk_m, marks))
    return Bodies(tuple(everyone), number_watched, newest_ns, stamp_ns, now_ns, last_number, left_out)


def body_segments(bodies: Bodies, placing: Placing, up: FloatArray) -> BodySegments:
    """Capsules of everyone in the frame of a pose; `up` as in `followed`."""
    if not bodies.everyone:
        return NO_SEGMENTS
    marks = [body.marks for body in bodies.everyone]
    stacked = marks[0][None] if len(marks) == 1 else read_only(np.array(marks))
    ends, velocities, radii, whose = capsules(stacked, placing.rotation, placing.origin_m, placing.offset_m, up)
    numbers = tuple([WATCHED_PERSON if body.number == bodies.watched else body.number for body in bodies.everyone])
    people, parts = _named(numbers, whose.tobytes())
    for array in (ends, velocities, radii):
        array.flags.writeable = False
    return BodySegments(people, parts, ends, velocities, radii)


@lru_cache(maxsize=64)
def _named(numbers: tuple[int, ...], whose: bytes) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Number of the person and name of the part for each capsule; the same from message to message."""
    places, count = np.frombuffer(whose, dtype=np.int64).tolist(), len(BODY_PARTS)
    return tuple([numbers[place // count] for place in places]), tuple([BODY_PARTS[place % count] for place in places])


def facing_of(body: TrackedBody | None, placing: Placing) -> FloatArray:
    """(3,) unit vector to where the chest points, in the frame of a pose; NaN when that is not known.

    Source: REP-103, body axes.
    """
    if body is None:
        return UNKNOWN_DIRECTION
    _, lx, ly, lz, ux, uy, uz, hidden_s, there = body.marks[_AXES, :9].tolist()
    if not there or hidden_s + body.hidden_s > FACING_S:
        return UNKNOWN_DIRECTION
    forward = ly * uz - lz * uy, lz * ux - lx * uz, lx * uy - ly * ux
    return read_only([row[0] * forward[0] + row[1] * forward[1] + row[2] * forward[2] for row in placing.rows])


def compile_kernels() -> None:
    """Compile all that is compiled here, before the first person comes."""
    marks = observed(_NO_MARKS, _indices(("head",)), read_only(np.ones((1, 3))), read_only(np.ones(1)), 0.0, _UP, 0.5)
    marks.flags.writeable = False
    marks = coasted(marks, 0.1)
    marks.flags.writeable = False
    placing = Placing(np.eye(3), np.zeros(3), np.zeros(3))
    capsules(marks[None], placing.rotation, placing.origin_m, placing.offset_m, _UP)


def _of_one_kind(values: FloatArray) -> FloatArray:
    """A read-only array without gaps: numba would compile once more for any other kind."""
    if values.flags.c_contiguous and values.flags.aligned and not values.flags.writeable:
        return values
    return read_only(np.array(values, dtype=np.float64, order="C"))


def _has_place(seen: Detection) -> bool:
    """Whether any joint of a body is somewhere."""
    return any(seen.trunk_m) or any(usable(point) for point in seen.body.points)


def _nearness(seen: Detection) -> float:
    return min([math.hypot(*place) for place in seen.trunk_m if place is not None], default=math.inf)


def _is_same(missing: TrackedBody, seen: TrackedBody, is_new: bool) -> bool:
    """Whether a missing body is one that is seen; two that were there before may stand close to each other."""
    return _near(missing.trunk_m, seen.trunk_m, RENUMBERED_M if is_new else COINCIDING_M)


def _near(one: Trunk, other: Trunk, within_m: float) -> bool:
    distance = apart_m(one, other)
    return distance is not None and distance < within_m


def _middle_stamp(people: Sequence[Detection]) -> int:
    """The stamp of a message: one person whose clock is wrong does not count."""
    stamps = sorted([seen.person.stamp_ns for seen in people])
    return stamps[len(stamps) // 2]


def _matched(
    before: Bodies, people: Sequence[Detection], watched: Detection | None, reach_m: float
) -> list[tuple[Detection, TrackedBody | None]]:
    """People and the body that each was: first the one of `person_tracker.py`, then the nearest pairs.

    New bodies come last.
    """
    matched: list[tuple[Detection, TrackedBody | None]] = []
    body = before.watched_body()
    if watched is not None and body is not None and any(seen is watched for seen in people):
        matched.append((watched, body))
    pairs = []
    for place, seen in enumerate(people):
        if matched and seen is watched:
            continue
        for body in before.everyone:
            same = seen.person.person_id == body.person_id
            distance = apart_m(seen.trunk_m, body.trunk_m)
            if distance is None and same:
                distance = 0.0
            if distance is not None and distance <= reach_m + same * RUNNING_M_S * body.hidden_s:
                pairs.append((distance - same * SAME_NUMBER_BONUS_M, place, body.number, body))
    for _, place, _, body in sorted(pairs, key=lambda pair: pair[:3]):
        if all(people[place] is not seen and body is not taken for seen, taken in matched):
            matched.append((people[place], body))
    rest = [seen for seen in people if all(seen is not other for other, _ in matched)]
    return matched + [(seen, None) for seen in sorted(rest, key=lambda seen: seen is not watched)]


@lru_cache(maxsize=256)
def _indices(names: tuple[str, ...]) -> FloatArray:
    """Index of each landmark and of what stands in for it in a tracker's skeleton; -1 where it has none."""
    places = {name: place for place, name in reversed(list(enumerate(names)))}
    return read_only(np.array([places.get(name, -1) for name in (*LANDMARKS, *_ALSO)], dtype=np.float64))


_NO_MARKS = read_only(np.zeros((_ROWS, _COLUMNS)))
_UP = read_only((0.0, 0.0, 1.0))


@compiled
def _read(joint: int, index: FloatArray, positions: FloatArray, confidence: FloatArray, least: float) -> FloatArray:
    """(4,) place of a joint and its quality: 2 seen, 1 doubted, 0 not there."""
    found = np.zeros(4)
    place = int(index[joint])
    if place < 0:
        return found
    zero = True
    for i in range(3):
        value = positions[place, i]
        if not (-FARTHEST_M < value < FARTHEST_M):
            return np.zeros(4)
        zero = zero and value == 0.0
        found[i] = value
    if zero:
        return found
    found[3] = 2.0 if confidence[place] >= least else 1.0
    return found


@compiled
def _distance(a: FloatArray, b: FloatArray) -> float:
    return float(np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2))


@compiled
def _unit(v: FloatArray, otherwise: FloatArray) -> FloatArray:
    length = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    return v / length if length > 1e-6 else otherwise.copy()


@compiled
def _across(v: FloatArray, axis: FloatArray) -> FloatArray:
    """The part of a vector that is perpendicular to a unit vector."""
    across: FloatArray = v - (v[0] * axis[0] + v[1] * axis[1] + v[2] * axis[2]) * axis
    return across


@compiled
def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@compiled
def _joints(
    index: FloatArray, positions: FloatArray, confidence: FloatArray, least: float, tip_m: FloatArray
) -> FloatArray:
    """(15, 4) places of the landmarks, of neck and pelvis with their quality, joints standing in for each other."""
    read = np.empty((24, 4))
    for joint in range(24):
        read[joint] = _read(joint, index, positions, confidence, least)
    found = read[:15].copy()
    if found[HEAD, 3] < 2.0:
        if read[LEFT_EAR, 3] == 2.0 and read[RIGHT_EAR, 3] == 2.0:
            found[HEAD] = (read[LEFT_EAR] + read[RIGHT_EAR]) / 2.0
        elif found[HEAD, 3] == 0.0:
            for joint in (LEFT_EAR, RIGHT_EAR, NOSE):
                if read[joint, 3] > 0.0:
                    found[HEAD] = read[joint]
                    found[HEAD, 3] = 1.0  # a head's radius away from its middle
                    break
    for side in range(2):
        elbow, best, quality = LEFT_ELBOW + side, -1, 0.0
        for kind, joint in enumerate((LEFT_TIP + side, LEFT_HAND + side, LEFT_WRIST + side)):
            if read[joint, 3] > quality:
                best, quality = kind, read[joint, 3]
        if best >= 0:
            joint = (LEFT_TIP + side, LEFT_HAND + side, LEFT_WRIST + side)[best]
            found[LEFT_TIP + side] = read[joint]
            if best > 0 and read[elbow, 3] > 0.0:
                way = read[joint, :3] - read[elbow, :3]
                length = np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
                if length > 0.05:
                    found[LEFT_TIP + side, :3] += way * (tip_m[best] / length)
        if found[11 + side, 3] == 0.0:
            found[11 + side] = read[LEFT_FOOT + side]
    return found


@compiled
def observed(
    before: FloatArray,
    index: FloatArray,
    positions: FloatArray,
    confidence: FloatArray,
    elapsed_s: float,
    up: FloatArray,
    min_confidence: float,
) -> FloatArray:
    """(15, 12) landmarks of a body after one more message that shows it.

    Args:
        before: (15, 12) before it; zeros for a new body.
        index: (24,) place of each joint in the message, -1 for none.
        positions: (J, 3) of its joints [m].
        confidence: (J,) of its joints.
        elapsed_s: Since its message before.
        up: (3,) unit vector up.
        min_confidence: A joint below this is doubted.

    Source of the filter: T. Benedict, G. Bordner, 1962.
    """
    after = before.copy()
    size = before[_AXES, 0] if before[_AXES, 0] > 0.0 else ADULT_M
    scale = size / ADULT_M
    tip_m = np.array([0.0, TIP_FROM_HAND_M * scale, TIP_FROM_WRIST_M * scale])
    joints = _joints(index, positions, confidence, min_confidence, tip_m)
    trunk = (HEAD, LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_HIP, RIGHT_HIP, 14)

    # Too little of the trunk has been seen for sure for a while: then what is doubted has to do.
    sure = 0
    for mark in trunk:
        sure += joints[mark, 3] == 2.0
    recent = before[_AXES, 8] > 0.0 and before[_AXES, 7] + before[_WHOLE, 0] <= FORGOTTEN_S
    doubting = sure < 2 and not recent
    if doubting:
        for mark in trunk:
            if joints[mark, 3] == 1.0:
                joints[mark, 3] = 2.0

    # What cannot be: shoulders, hips and limbs out of a human's reach.
    if joints[LEFT_SHOULDER, 3] > 0.0 and joints[RIGHT_SHOULDER, 3] > 0.0:
        width = _distance(joints[LEFT_SHOULDER], joints[RIGHT_SHOULDER])
        if width > REACH_M[LEFT_SHOULDER]:
            wrong = -1
            if before[LEFT_SHOULDER, _KNOWN] > 0.0 and before[RIGHT_SHOULDER, _KNOWN] > 0.0:
                left_m = _distance(joints[LEFT_SHOULDER], before[LEFT_SHOULDER])
                right_m = _distance(joints[RIGHT_SHOULDER], before[RIGHT_SHOULDER])
                wrong = LEFT_SHOULDER if left_m > right_m else RIGHT_SHOULDER
            for mark in (LEFT_SHOULDER, RIGHT_SHOULDER):
                if wrong < 0 or wrong == mark:
                    joints[mark, 3] = 0.0
    for mark in range(13):
        if joints[mark, 3] == 0.0 or mark in (LEFT_SHOULDER, RIGHT_SHOULDER):
            continue
        parent = PARENTS[mark]
        if parent < 0:
            for shoulder in (LEFT_SHOULDER, RIGHT_SHOULDER):
                if joints[shoulder, 3] == 2.0 and _distance(joints[mark], joints[shoulder]) > REACH_M[mark]:
                    joints[mark, 3] = 0.0
        elif joints[parent, 3] == 2.0:
            if _distance(joints[mark], joints[parent]) > REACH_M[mark]:
                joints[mark, 3] = 0.0
        elif before[parent, _KNOWN] > 0.0 and _distance(joints[mark], before[parent]) > REACH_M[mark] + 0.3:
            joints[mark, 3] = 0.0

    # Filter what is seen.
    moved, count = np.zeros(3), 0
    swept, steps = np.zeros(3), 0
    for mark in range(13):
        if joints[mark, 3] < 2.0:
            continue
        place = joints[mark, :3]
        hidden_s = before[mark, _HIDDEN] + before[_WHOLE, 0]
        if before[mark, _KNOWN] > 0.0 and hidden_s <= FORGOTTEN_S and 0.0 < elapsed_s <= FORGOTTEN_S:
            guess = before[mark, :3] + elapsed_s * before[mark, 3:6]
            error = place - guess
            if _distance(place, before[mark]) > SPEED_M_S[mark] * elapsed_s + 0.3:
                after[mark, :3], after[mark, 3:6] = place, 0.0  # another place altogether
            else:
                after[mark, :3] = guess + POSITION_GAIN * error
                speed = before[mark, 3:6] + VELOCITY_GAIN / max(elapsed_s, SHORTEST_STEP_S) * error
                fast = np.sqrt(speed[0] ** 2 + speed[1] ** 2 + speed[2] ** 2)
                after[mark, 3:6] = speed * min(1.0, SPEED_M_S[mark] / max(fast, 1e-9))
        else:
            after[mark, :3], after[mark, 3:6] = place, 0.0
        after[mark, _ANCHOR : _ANCHOR + 3] = after[mark, :3]
        after[mark, _HIDDEN], after[mark, _KNOWN] = 0.0, 1.0
        after[mark, _SPREAD] = 2.0 * DOUBTED_M if doubting and PARENTS[mark] < 0 else 0.0
        if PARENTS[mark] < 0:
            swept += after[mark, 3:6]
            steps += 1
            if before[mark, _KNOWN] > 0.0:
                moved += after[mark, :3] - before[mark, :3]
                count += 1
    if count > 0:
        moved /= count
    else:
        limbs = 0
        for mark in range(13):
            if joints[mark, 3] == 2.0 and before[mark, _KNOWN] > 0.0:
                moved += after[mark, :3] - before[mark, :3]
                limbs += 1
        moved /= max(limbs, 1)
    if steps > 0:
        swept /= steps

    # Up and left of the trunk, as far as they are known before its missing corners are inferred.
    old_left, old_up, framed = before[_AXES, 1:4].copy(), before[_AXES, 4:7].copy(), before[_AXES, 8] > 0.0
    upright = old_up if framed else up
    hips = np.zeros(3)
    seen_hips = joints[LEFT_HIP, 3] == 2.0 and joints[RIGHT_HIP, 3] == 2.0
    if seen_hips:
        hips = (after[LEFT_HIP, :3] + after[RIGHT_HIP, :3]) / 2.0
    elif joints[14, 3] == 2.0:
        hips = joints[14, :3].copy()
    has_hips = seen_hips or joints[14, 3] == 2.0

    # The shoulders.
    middle, has_middle = np.zeros(3), True
    if joints[13, 3] == 2.0:
        middle = joints[13, :3] - 0.03 * scale * upright
    elif joints[HEAD, 3] == 2.0:
        middle = after[HEAD, :3] - HEAD_HEIGHT * size * upright
    elif has_hips:
        middle = hips + TRUNK_HEIGHT * size * upright
    else:
        has_middle = False
    left_seen, right_seen = joints[LEFT_SHOULDER, 3] == 2.0, joints[RIGHT_SHOULDER, 3] == 2.0
    known = before[LEFT_SHOULDER, _KNOWN] > 0.0 and before[RIGHT_SHOULDER, _KNOWN] > 0.0
    whole = True
    if not (left_seen and right_seen):
        if known:
            for mark in (LEFT_SHOULDER, RIGHT_SHOULDER):
                if joints[mark, 3] < 2.0:
                    other = LEFT_SHOULDER + RIGHT_SHOULDER - mark
                    step = after[other, :3] - before[other, :3] if joints[other, 3] == 2.0 else moved
                    after[mark, _ANCHOR : _ANCHOR + 3] = before[mark, _ANCHOR : _ANCHOR + 3] + step
        elif has_middle:
            left = _unit(_across(old_left, upright), up) if framed else np.zeros(3)
            if left_seen:
                left = _unit(_across(after[LEFT_SHOULDER, :3] - middle, upright), up)
            elif right_seen:
                left = _unit(_across(middle - after[RIGHT_SHOULDER, :3], upright), up)
            elif seen_hips:
                left = _unit(_across(after[LEFT_HIP, :3] - after[RIGHT_HIP, :3], upright), up)
            elif not framed:  # a person who faces the camera
                left = _unit(_cross(upright, -middle), np.array([0.0, 1.0, 0.0]))
            for mark, side in ((LEFT_SHOULDER, 0.5), (RIGHT_SHOULDER, -0.5)):
                if joints[mark, 3] < 2.0:
                    after[mark, _ANCHOR : _ANCHOR + 3] = middle + side * SHOULDER_WIDTH * size * left
        else:
            whole = False
        if whole:
            for mark in (LEFT_SHOULDER, RIGHT_SHOULDER):
                if joints[mark, 3] < 2.0:
                    _infer(after, mark, joints[mark], elapsed_s, scale, swept)

    # The trunk's axes, its hips, and the head.
    after[_AXES, 8] = 1.0 if whole else 0.0
    turned = np.eye(3)
    shoulders = (after[LEFT_SHOULDER, :3] + after[RIGHT_SHOULDER, :3]) / 2.0
    if whole:
        left = after[LEFT_SHOULDER, :3] - after[RIGHT_SHOULDER, :3]
        left = _unit(left, old_left if framed else _unit(_cross(up, -shoulders), np.array([0.0, 1.0, 0.0])))
        pole = shoulders - hips if has_hips else upright.copy()
        axis = _unit(_across(pole, left), _unit(_across(up, left), np.array([0.0, 0.0, 1.0])))
        after[_AXES, 1:4], after[_AXES, 4:7] = left, axis
        after[_AXES, 7] = 0.0 if left_seen and right_seen else before[_AXES, 7] + elapsed_s
        if framed:
            new, old = np.empty((3, 3)), np.empty((3, 3))
            new[0], new[1], new[2] = _cross(left, axis), left, axis
            old[0], old[1], old[2] = _cross(old_left, old_up), old_left, old_up
            for i in range(3):
                for j in range(3):
                    turned[i, j] = new[0, i] * old[0, j] + new[1, i] * old[1, j] + new[2, i] * old[2, j]
        at = (before[LEFT_SHOULDER, :3] + before[RIGHT_SHOULDER, :3]) / 2.0
        for mark in (LEFT_HIP, RIGHT_HIP, HEAD):
            if joints[mark, 3] == 2.0:
                continue
            side = 0.5 if mark == LEFT_HIP else -0.5
            if mark != HEAD and joints[14, 3] == 2.0:
                after[mark, _ANCHOR : _ANCHOR + 3] = hips + side * HIP_WIDTH * size * left
                joints[mark, 3] = 3.0
                after[mark, _KNOWN], after[mark, _HIDDEN] = 1.0, 0.0
            elif before[mark, _KNOWN] > 0.0 and framed:
                _carry(after, before, mark, at, shoulders, turned)
            elif mark == HEAD:
                base = joints[13, :3] - 0.03 * scale * axis if joints[13, 3] == 2.0 else shoulders
                after[mark, _ANCHOR : _ANCHOR + 3] = base + HEAD_HEIGHT * size * axis
            else:
                low = shoulders - TRUNK_HEIGHT * size * axis
                after[mark, _ANCHOR : _ANCHOR + 3] = low + side * HIP_WIDTH * size * left
            _infer(after, mark, joints[mark], elapsed_s, scale, swept)
            if not (left_seen and right_seen):  # it hangs on shoulders that are not sure themselves
                after[mark, _SPREAD] += (after[LEFT_SHOULDER, _SPREAD] + after[RIGHT_SHOULDER, _SPREAD]) / 2.0
    else:
        for mark in (HEAD, LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_HIP, RIGHT_HIP):
            if joints[mark, 3] < 2.0:
                after[mark, _KNOWN] = 0.0

    # The limbs, from the trunk outwards.
    for mark in range(13):
        parent = PARENTS[mark]
        if parent < 0 or joints[mark, 3] == 2.0:
            continue
        if after[parent, _KNOWN] == 0.0:
            after[mark, _KNOWN] = 0.0
        elif before[mark, _KNOWN] > 0.0 and before[parent, _KNOWN] > 0.0:
            _carry(after, before, mark, before[parent, :3], after[parent, :3], turned)
            _infer(after, mark, joints[mark], elapsed_s, scale, after[parent, 3:6])
        elif joints[mark, 3] == 1.0:
            after[mark, _ANCHOR : _ANCHOR + 3] = joints[mark, :3]
            _infer(after, mark, joints[mark], elapsed_s, scale, after[parent, 3:6])

    after[_AXES, 0] = _stature(before[_AXES, 0], after, joints)
    after[_WHOLE, 0] = 0.0
    return after


@compiled
def _carry(
    after: FloatArray, before: FloatArray, mark: int, start: FloatArray, end: FloatArray, turned: FloatArray
) -> None:
    """Let a landmark's inferred place move and turn with what it hangs on."""
    for i in range(3):
        moved = end[i]
        for j in range(3):
            moved += turned[i, j] * (before[mark, _ANCHOR + j] - start[j])
        after[mark, _ANCHOR + i] = moved


@compiled
def _infer(
    after: FloatArray, mark: int, joint: FloatArray, elapsed_s: float, scale: float, velocity: FloatArray
) -> None:
    """Put a landmark that is not seen where it is inferred to be, or between there and where it is doubted to be."""
    bound = HIDDEN_M[mark] * scale
    if joint[3] == 3.0:  # half a pelvis: as good as seen
        after[mark, :3] = after[mark, _ANCHOR : _ANCHOR + 3]
        after[mark, 3:6] = velocity
        after[mark, _SPREAD] = 0.0
        return
    if after[mark, _KNOWN] > 0.0:
        after[mark, _HIDDEN] += elapsed_s
        spread = min(bound, 0.02 + HIDDEN_M_S * after[mark, _HIDDEN])
    else:
        after[mark, _KNOWN], after[mark, _HIDDEN], spread = 1.0, FORGOTTEN_S, bound
    after[mark, :3] = after[mark, _ANCHOR : _ANCHOR + 3]
    if joint[3] == 1.0:
        apart = _distance(joint, after[mark])
        if apart < DISAGREEING_M:
            after[mark, :3] = (after[mark, :3] + joint[:3]) / 2.0
            spread = max(spread, DOUBTED_M + apart / 2.0)
    after[mark, 3:6] = velocity
    after[mark, _SPREAD] = spread


@compiled
def _stature(before: float, after: FloatArray, joints: FloatArray) -> float:
    """Stature [m] by the bones that are seen, slowly; 0 while none was."""
    total, bones = 0.0, 0
    for one, other, share in (
        (LEFT_SHOULDER, RIGHT_SHOULDER, SHOULDER_WIDTH),
        (LEFT_SHOULDER, LEFT_ELBOW, UPPER_ARM),
        (RIGHT_SHOULDER, RIGHT_ELBOW, UPPER_ARM),
        (LEFT_HIP, 9, THIGH),
        (RIGHT_HIP, 10, THIGH),
        (9, 11, SHIN),
        (10, 12, SHIN),
    ):
        if joints[one, 3] == 2.0 and joints[other, 3] == 2.0:
            total += _distance(joints[one], joints[other]) / share
            bones += 1
    if joints[1, 3] == 2.0 and joints[2, 3] == 2.0 and joints[7, 3] == 2.0 and joints[8, 3] == 2.0:
        total += _distance((after[1] + after[2]) / 2.0, (after[7] + after[8]) / 2.0) / TRUNK_HEIGHT
        bones += 1
    if bones == 0:
        return before
    found = min(max(total / bones, SHORTEST_M), TALLEST_M)
    return found if before == 0.0 else before + 0.05 * (found - before)


@compiled
def coasted(before: FloatArray, elapsed_s: float) -> FloatArray:
    """(15, 12) landmarks of a body that a message does not show, so long after the message before."""
    after = before.copy()
    hidden = before[_WHOLE, 0]
    after[_WHOLE, 0] = hidden + elapsed_s
    on_s = max(min(hidden + elapsed_s, COASTING_S) - hidden, 0.0)
    for mark in range(13):
        for i in range(3):
            after[mark, i] += on_s * before[mark, 3 + i]
            after[mark, _ANCHOR + i] += on_s * before[mark, 3 + i]
            if hidden + elapsed_s > COASTING_S:
                after[mark, 3 + i] = 0.0
        after[mark, _SPREAD] = max(
            before[mark, _SPREAD], min(before[mark, _SPREAD] + MISSING_M_S * elapsed_s, MISSING_M)
        )
    return after


@compiled
def capsules(
    marks: FloatArray, rotation: FloatArray, origin: FloatArray, offset: FloatArray, up: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Capsules of B bodies: ends (N, 2, 3), their velocities (N, 2, 3), radii (N,), and (N,) `body * 11 + part`.

    Args:
        marks: (B, 15, 12) landmarks.
        rotation: (3, 3), with the next two as `Placing`.
        origin: (3,).
        offset: (3,).
        up: (3,) unit vector up, for a head without a trunk.
    """
    most = len(marks) * 11
    ends, velocities, radii, whose = np.empty((most, 2, 3)), np.empty((most, 2, 3)), np.empty(most), np.empty(most)
    firsts = (0, 0, LEFT_SHOULDER, LEFT_SHOULDER, LEFT_ELBOW, RIGHT_SHOULDER, RIGHT_ELBOW, 7, 9, 8, 10)
    seconds = (0, 0, RIGHT_SHOULDER, LEFT_ELBOW, LEFT_TIP, RIGHT_ELBOW, RIGHT_TIP, 9, 11, 10, 12)
    count = 0
    line = np.empty((2, 6))
    for body in range(len(marks)):
        mark = marks[body]
        scale = (mark[_AXES, 0] if mark[_AXES, 0] > 0.0 else ADULT_M) / ADULT_M
        trunk = mark[_AXES, 8] > 0.0
        for part in range(11):
            if part == 0:
                if mark[HEAD, _KNOWN] == 0.0:
                    continue
                line[0] = mark[HEAD, :6]
                line[1] = mark[HEAD, :6]
                axis = mark[_AXES, 4:7] if trunk else up
                for i in range(3):
                    line[1, i] += CROWN_M * scale * axis[i]
                radius = RADII_M[0] * min(max(scale, SMALLEST_HEAD), 1.1) + mark[HEAD, _SPREAD]
            elif part == 1:
                if not trunk:
                    continue
                line[0] = (mark[LEFT_SHOULDER, :6] + mark[RIGHT_SHOULDER, :6]) / 2.0
                line[1] = (mark[LEFT_HIP, :6] + mark[RIGHT_HIP, :6]) / 2.0
                spread = mark[LEFT_SHOULDER, _SPREAD] + mark[RIGHT_SHOULDER, _SPREAD]
                spread += mark[LEFT_HIP, _SPREAD] + mark[RIGHT_HIP, _SPREAD]
                radius = RADII_M[1] * scale + spread / 4.0
            else:
                first, second = firsts[part], seconds[part]
                if mark[first, _KNOWN] == 0.0 or mark[second, _KNOWN] == 0.0:
                    continue
                line[0], line[1] = mark[first, :6], mark[second, :6]
                radius = RADII_M[part] * scale + (mark[first, _SPREAD] + mark[second, _SPREAD]) / 2.0
            total = radius
            for end in range(2):
                for i in range(3):
                    place, speed = offset[i], 0.0
                    for j in range(3):
                        place += rotation[i, j] * (line[end, j] - origin[j])
                        speed += rotation[i, j] * line[end, 3 + j]
                    ends[count, end, i] = place
                    velocities[count, end, i] = speed
                    total += place + speed
            if not np.isfinite(total):
                continue
            radii[count] = radius
            whose[count] = body * 11 + part
            count += 1
    return ends[:count].copy(), velocities[:count].copy(), radii[:count].copy(), whose[:count].astype(np.int64)

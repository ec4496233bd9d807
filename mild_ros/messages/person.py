# SPDX-License-Identifier: Apache-2.0
"""`PersonPose` as a `sensor_msgs/PointCloud2`: five points of the watched person, then two of each body segment.

Fields are `x y z vx vy vz radius person part`, all float64. The first five rows are hand, head, middle of the
shoulders, middle of the hips [m] and the unit vector along which the chest points; `person` is 0 there while the person
is in view and calibrated. Each segment then has two rows, the ends of its axis: their place [m] and velocity [m/s], its
radius [m], the number of the person (0: the watched one) and the place of its part in `BODY_PARTS`. NaN stands for what
is not known.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from mild_core.errors import DataError
from mild_core.shapes import FloatArray
from mild_core.signals import BODY_PARTS, NO_SEGMENTS, WATCHED_PERSON, BodySegments, PersonPose
from mild_ros.messages.point_cloud import array_from_msg, array_to_msg
from mild_ros.messages.stamps import ns_from_msg, time_to_msg

FIELDS = ("x", "y", "z", "vx", "vy", "vz", "radius", "person", "part")
POINTS = 5
"""Rows before the segments."""

MOST_SEGMENTS = 16 * len(BODY_PARTS)
"""Of sixteen bodies, as many as perception follows; a message with more is refused."""

LARGEST_NUMBER, LARGEST_RADIUS_M, FARTHEST_M, FASTEST_M_S = 2.0**53, 10.0, 1000.0, 100.0
"""No pose holds more than this."""

UNIT_TO = 1e-6
"""How far the length of a direction may be from 1."""

_PARTS = {part: float(place) for place, part in enumerate(BODY_PARTS)}


def person_to_msg(person: PersonPose) -> PointCloud2:
    """The message of a pose; what was not seen is NaN."""
    segments = person.segments
    count = len(segments.people)
    rows = np.full((1, POINTS + 2 * count, len(FIELDS)), np.nan)
    points = rows[0, :POINTS]
    points[0, :3], points[1, :3], points[2:4, :3], points[4, :3] = (
        *(person.hand_m, person.head_m),
        *(person.trunk_m, person.facing),
    )
    if person.watched:
        points[:, 7] = WATCHED_PERSON
    if count:
        ends = rows[0, POINTS:].reshape(count, 2, len(FIELDS))
        ends[:, :, :3], ends[:, :, 3:6] = segments.ends_m, segments.velocities_m_s
        ends[:, :, 6] = segments.radii_m[:, None]
        ends[:, :, 7] = np.array(segments.people, dtype=np.float64)[:, None]
        ends[:, :, 8] = np.array([_PARTS[part] for part in segments.parts])[:, None]
    message = array_to_msg(rows, FIELDS, Header(stamp=time_to_msg(person.stamp_ns), frame_id=person.frame_id))
    message.is_dense = False
    return message


def person_from_msg(message: Any) -> PersonPose:
    """The pose in a message.

    Raises:
        DataError: `wrong_layout` when the message holds something else, or what no pose holds.
    """
    values, names = array_from_msg(message)
    odd = len(values) != 1 or (values.shape[1] - POINTS) % 2 != 0
    if names != FIELDS or odd or not POINTS <= values.shape[1] <= POINTS + 2 * MOST_SEGMENTS:
        expected = f"1 x {POINTS} + 2 N values {' '.join(FIELDS)}, N at most {MOST_SEGMENTS}"
        raise DataError("wrong_layout", f"{values.shape} values {names}, expected {expected}")
    points = values[0, :POINTS]
    hand, head, *trunk, facing = points[:, :3]
    watched = points[:, 7]
    known, length = np.isfinite(facing).all(), float(np.linalg.norm(facing))
    if not (np.isnan(watched).all() or (watched == WATCHED_PERSON).all()):
        raise DataError("wrong_layout", "the first rows are of another person than the watched one")
    if not (abs(length - 1.0) < UNIT_TO if known else np.isnan(facing).all()):
        raise DataError("wrong_layout", f"a chest points along {facing.tolist()}, which is no unit vector")
    return PersonPose(
        ns_from_msg(message.header.stamp),
        str(message.header.frame_id),
        hand,
        head,
        np.stack(trunk),
        _segments(values[0, POINTS:]),
        facing,
        watched=bool(watched[0] == WATCHED_PERSON),
    )


def _segments(rows: FloatArray) -> BodySegments:
    """Segments of (2 N, 9) rows.

    Raises:
        DataError: `wrong_layout`.
    """
    if not len(rows):
        return NO_SEGMENTS
    if not np.isfinite(rows).all():
        raise DataError("wrong_layout", "a body segment has a number that is NaN or infinite")
    ends = rows.reshape(-1, 2, len(FIELDS))
    radii, people, parts = ends[:, 0, 6], ends[:, 0, 7], ends[:, 0, 8]
    if (np.abs(ends[:, :, :3]) > FARTHEST_M).any() or (np.abs(ends[:, :, 3:6]) > FASTEST_M_S).any():
        raise DataError("wrong_layout", "a body segment is too far away or too fast for a person")
    same = (ends[:, 0, 6:] == ends[:, 1, 6:]).all()
    numbered = (people == np.floor(people)).all() and (people >= 0.0).all() and (people <= LARGEST_NUMBER).all()
    named = (parts == np.floor(parts)).all() and (parts >= 0.0).all() and (parts < len(BODY_PARTS)).all()
    if not (same and numbered and named and (radii > 0.0).all() and (radii <= LARGEST_RADIUS_M).all()):
        raise DataError("wrong_layout", "a body segment has no radius, person or part, or two of them")
    return BodySegments(
        tuple([int(number) for number in people.tolist()]),
        tuple([BODY_PARTS[int(part)] for part in parts.tolist()]),
        ends[:, :, :3],
        ends[:, :, 3:6],
        radii,
    )

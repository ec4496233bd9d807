# SPDX-License-Identifier: Apache-2.0
"""`visualization_msgs/MarkerArray` straight from its bytes, and only what a tracker says in it.

rclpy builds some thirty Python objects per marker: 1.4 ms for a body of 32 joints, more than all else from skeleton to
command together. This reads the same bytes ten times as fast.

Source: OMG DDS-RTPS 2.3, 10.2 (classic CDR): fields in the order of the .msg file, each aligned to its size counted
from behind the four bytes of encapsulation.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from mild_core.errors import DataError

_LITTLE_ENDIAN = b"\x00\x01"
_BASE = 4
_COUNT = struct.Struct("<I")
_STAMP = struct.Struct("<iI")

_EMPTY_TEXT = "I4x"
_PLAIN = (
    "3i{gap} 3d 56x 3f 4x 8x 4x"  # id, type, action; pose and scale; colour; lifetime; frame_locked
    f" II {_EMPTY_TEXT} 8x {_EMPTY_TEXT} {_EMPTY_TEXT} II"  # points, colors; texture and its resource; uv_coordinates
    f" {_EMPTY_TEXT} {_EMPTY_TEXT} {_EMPTY_TEXT} I x"  # text; mesh_resource, mesh_file; its materials
)
_PLAIN_BY_GAP = {gap: struct.Struct("<" + _PLAIN.format(gap=f" {gap}x" if gap else "")) for gap in (0, 4)}
_PLAIN_LENGTHS = (0, 0, 1, 1, 1, 0, 0, 1, 1, 1, 0)
"""Behind its names, a marker without texts, points and files has a fixed form: one look at the lengths shows it."""

_NUMBERS = struct.Struct("<iii")
_POSITION = struct.Struct("<3d")
_COLOUR = struct.Struct("<3f")
_POSE_AND_SCALE, _COLOUR_AND_LIFETIME = 80, 24
_POINT, _POINT_COLOUR, _UV = 24, 16, 8


class Stamp(NamedTuple):
    """A `builtin_interfaces/Time`."""

    sec: int
    nanosec: int


class Header(NamedTuple):
    """A `std_msgs/Header`."""

    stamp: Stamp
    frame_id: str


class Position(NamedTuple):
    """A `geometry_msgs/Point` [m]."""

    x: float
    y: float
    z: float


class JointPose(NamedTuple):
    """The half of a `geometry_msgs/Pose` that a joint has."""

    position: Position


class Colour(NamedTuple):
    """A `std_msgs/ColorRGBA` without its last letter."""

    r: float
    g: float
    b: float


class Marker(NamedTuple):
    """What a tracker says in a `visualization_msgs/Marker`."""

    header: Header
    id: int
    action: int
    pose: JointPose
    color: Colour


class MarkerArray(NamedTuple):
    """The message, as `people_from_marker_array` reads it."""

    markers: list[Marker]


def marker_array_from_bytes(data: bytes) -> MarkerArray:
    """The markers in a serialised message.

    Raises:
        DataError: `wrong_layout` when it is none.
    """
    if data[:2] != _LITTLE_ENDIAN:
        raise DataError("wrong_layout", f"encapsulation {data[:2]!r} is not little-endian CDR")
    markers: list[Marker] = []
    names, header = b"", Header(Stamp(0, 0), "")
    try:
        (count,), place = _COUNT.unpack_from(data, _BASE), _BASE + 4
        for _ in range(count):
            place = _aligned(place, 4)
            if not names or not data.startswith(names, place):  # most trackers repeat stamp, frame and namespace
                header, behind = _header(data, place)
                names = data[place:behind]
            marker, place = _marker(data, _aligned(place + len(names), 4), header)
            markers.append(marker)
    except (struct.error, UnicodeDecodeError) as error:
        raise DataError("wrong_layout", f"no MarkerArray: {error}") from None
    if place > len(data):
        raise DataError("wrong_layout", f"no MarkerArray: ends {place - len(data)} bytes early")
    return MarkerArray(markers)


def _header(data: bytes, place: int) -> tuple[Header, int]:
    """The header, and the place behind it and the namespace."""
    stamp = Stamp(*_STAMP.unpack_from(data, place))
    end = _after_bytes(data, place + 8)
    return Header(stamp, data[place + 12 : end - 1].decode()), _after_bytes(data, end)


def _marker(data: bytes, place: int, header: Header) -> tuple[Marker, int]:
    """A marker from its id on, and the place behind it."""
    gap = (_BASE - place - 12) % 8
    form = _PLAIN_BY_GAP[gap]
    if place + form.size <= len(data):
        number, _, action, x, y, z, r, g, b, *lengths = form.unpack_from(data, place)
        if tuple(lengths) == _PLAIN_LENGTHS:
            return Marker(header, number, action, JointPose(Position(x, y, z)), Colour(r, g, b)), place + form.size
    number, _, action = _NUMBERS.unpack_from(data, place)
    place += 12 + gap
    position = Position(*_POSITION.unpack_from(data, place))
    place += _POSE_AND_SCALE
    colour = Colour(*_COLOUR.unpack_from(data, place))
    return Marker(header, number, action, JointPose(position), colour), _behind(data, place + _COLOUR_AND_LIFETIME)


def _behind(data: bytes, place: int) -> int:
    """The place behind a marker, given the one behind its lifetime."""
    place = _after_items(data, place + 1, _POINT, 8)  # frame_locked, points
    place = _after_items(data, place, _POINT_COLOUR, 4)  # colors
    place = _after_bytes(data, place)  # texture_resource
    place = _aligned(place, 4) + 8  # texture.header.stamp
    for _ in range(3):  # texture.header.frame_id, .format, .data
        place = _after_bytes(data, place)
    place = _after_items(data, place, _UV, 4)  # uv_coordinates
    for _ in range(4):  # text, mesh_resource, mesh_file.filename, .data
        place = _after_bytes(data, place)
    return place + 1


def _aligned(place: int, size: int) -> int:
    return place + (_BASE - place) % size


def _after_bytes(data: bytes, place: int) -> int:
    """Behind a string or a sequence of bytes."""
    place = _aligned(place, 4)
    return int(place + 4 + _COUNT.unpack_from(data, place)[0])


def _after_items(data: bytes, place: int, size: int, alignment: int) -> int:
    """Behind a sequence of items of a size; one without items ends with its length."""
    place = _aligned(place, 4)
    (count,) = _COUNT.unpack_from(data, place)
    return _aligned(place + 4, alignment) + count * size if count else place + 4

# SPDX-License-Identifier: Apache-2.0
"""Markers read from bytes are the markers that rclpy reads, and no bytes do harm."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray, MeshFile, UVCoordinate

from mild_core.errors import DataError
from mild_core.perception.skeletons import SOURCES
from mild_ros.bag.reader import open_bag
from mild_ros.messages.marker_array import people_from_marker_array
from mild_ros.messages.marker_array_bytes import marker_array_from_bytes

TEXT = st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=9)
NUMBER = st.floats(width=32, allow_nan=False)


@st.composite
def markers(draw: Any) -> Marker:
    """Any marker, with lengths that shift everything behind them; half of them plain spheres, as trackers send."""
    if draw(st.booleans()):
        position = Point(x=draw(st.floats()), y=draw(st.floats()), z=draw(st.floats()))
        colour = ColorRGBA(r=draw(NUMBER), g=draw(NUMBER), b=draw(NUMBER), a=1.0)
        header = Header(stamp=Time(sec=draw(st.integers(0, 1))), frame_id=draw(st.sampled_from(["camera", "depth"])))
        return Marker(header=header, id=draw(st.integers(0, 99)), pose=Pose(position=position), color=colour)
    return Marker(
        header=Header(stamp=Time(sec=draw(st.integers(-5, 2**31 - 1)), nanosec=123), frame_id=draw(TEXT)),
        ns=draw(TEXT),
        id=draw(st.integers(-(2**31), 2**31 - 1)),
        type=2,
        action=draw(st.integers(0, 3)),
        pose=Pose(
            position=Point(x=draw(st.floats()), y=draw(st.floats()), z=draw(st.floats())), orientation=Quaternion(w=1.0)
        ),
        scale=Vector3(x=1.0),
        color=ColorRGBA(r=draw(NUMBER), g=draw(NUMBER), b=draw(NUMBER), a=1.0),
        lifetime=Duration(sec=1, nanosec=2),
        frame_locked=draw(st.booleans()),
        points=[Point(x=1.0)] * draw(st.integers(0, 3)),
        colors=[ColorRGBA(r=0.5)] * draw(st.integers(0, 3)),
        texture_resource=draw(TEXT),
        texture=CompressedImage(
            header=Header(frame_id=draw(TEXT)), format=draw(TEXT), data=draw(st.binary(max_size=9))
        ),
        uv_coordinates=[UVCoordinate(u=0.5)] * draw(st.integers(0, 3)),
        text=draw(TEXT),
        mesh_resource=draw(TEXT),
        mesh_file=MeshFile(filename=draw(TEXT), data=draw(st.binary(max_size=9))),
        mesh_use_embedded_materials=draw(st.booleans()),
    )


def content(marker: Any) -> tuple[Any, ...]:
    """What a marker says, not-a-number comparable."""
    position, colour, stamp = marker.pose.position, marker.color, marker.header.stamp
    numbers = (position.x, position.y, position.z, colour.r, colour.g, colour.b)
    return (marker.id, marker.action, stamp.sec, stamp.nanosec, marker.header.frame_id, *map(repr, numbers))


@settings(deadline=None)
@given(st.lists(markers(), max_size=4))
def test_bytes_are_read_as_by_rclpy(made: list[Marker]) -> None:
    data = serialize_message(MarkerArray(markers=made))
    expected = deserialize_message(data, MarkerArray).markers
    assert [content(marker) for marker in marker_array_from_bytes(data).markers] == [
        content(marker) for marker in expected
    ]


@settings(deadline=None)
@given(st.lists(markers(), min_size=1, max_size=3), st.data())
def test_bytes_cut_short_are_bad_data(made: list[Marker], data: st.DataObject) -> None:
    whole = serialize_message(MarkerArray(markers=made))
    cut = whole[: data.draw(st.integers(0, len(whole) - 4))]
    with pytest.raises(DataError) as caught:
        marker_array_from_bytes(cut)
    assert caught.value.reason == "wrong_layout"


@settings(deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_markers_or_bad_data(data: bytes) -> None:
    for given_bytes in (data, b"\0\1\0\0" + data):
        with suppress(DataError):  # and nothing else is raised
            assert marker_array_from_bytes(given_bytes).markers is not None


def test_a_real_trackers_messages_read_the_same(shared_bags: Path) -> None:
    source, read = SOURCES["azure_kinect"], 0
    with open_bag(shared_bags / "azure_kinect_body_tracking") as bag:
        for raw in bag.messages():
            if raw.type_name != "visualization_msgs/msg/MarkerArray":
                continue
            expected = people_from_marker_array(bag.decode(raw), source, raw.time_ns)
            people = people_from_marker_array(marker_array_from_bytes(raw.data), source, raw.time_ns)
            assert [(a.stamp_ns, a.frame_id, a.person_id, a.joint_names) for a in people] == [
                (b.stamp_ns, b.frame_id, b.person_id, b.joint_names) for b in expected
            ]
            assert [a.positions_m.tobytes() for a in people] == [b.positions_m.tobytes() for b in expected]
            assert [a.confidence.tobytes() for a in people] == [b.confidence.tobytes() for b in expected]
            read += 1
    assert read == 933

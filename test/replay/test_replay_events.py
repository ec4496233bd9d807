# SPDX-License-Identifier: Apache-2.0
"""Ticks of the control clock between the messages of a bag, and stamps that are moved with them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from mild_ros.bags import jazzy_types
from mild_ros.encoding import encode, restamped
from mild_ros.replay_events import SKELETON, TICK, Event, with_ticks

MS = 1_000_000


def happened(*times_ms: float) -> list[tuple[str, float]]:
    """What happens when messages come at these times, with ticks every 10 ms."""
    messages: Iterator[Event] = (Event(round(time_ms * MS), SKELETON) for time_ms in times_ms)
    return [("tick" if event.input == TICK else "message", event.time_ns / MS) for event in with_ticks(messages)]


def test_ticks_lie_on_one_grid_from_the_first_message_on_and_come_before_a_message_of_their_time() -> None:
    assert happened(7, 16, 17, 38) == [
        *(("tick", 7), ("message", 7), ("message", 16)),
        *(("tick", 17), ("message", 17), ("tick", 27), ("tick", 37), ("message", 38)),
    ]


def test_a_grid_does_not_drift_at_a_rate_whose_period_is_no_round_number() -> None:
    events = list(with_ticks((Event(time_ns, SKELETON) for time_ns in (1, 1_000_000_001)), 30.0))
    ticks = [event.time_ns for event in events if event.input == TICK]
    assert len(ticks) == 31
    assert ticks[-1] == pytest.approx(1_000_000_001, abs=30)


def test_where_time_begins_anew_so_does_the_grid() -> None:
    assert happened(100, 104, 3, 14) == [
        *(("tick", 100), ("message", 100), ("message", 104)),
        *(("tick", 3), ("message", 3), ("tick", 13), ("message", 14)),
    ]


def test_every_marker_of_an_array_gets_the_new_stamp() -> None:
    stamped = [Marker(header=Header(frame_id="camera"), id=number) for number in range(5)]
    for marker in stamped:
        marker.header.stamp.sec, marker.header.stamp.nanosec = 1_700_000_000, 123_456_789
    message = MarkerArray(markers=stamped)

    def decode() -> None:
        raise AssertionError("equal stamps are found in the bytes")

    moved = restamped(encode(message), "visualization_msgs/msg/MarkerArray", decode, 2_000_000_001, jazzy_types())
    for marker in deserialize_message(moved, MarkerArray).markers:
        assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == (1_700_000_002, 123_456_790)

# SPDX-License-Identifier: Apache-2.0
"""Ticks of the control clock between the messages of a bag, and stamps that are moved with them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from mild_ros.bag.encoding import encode, restamped
from mild_ros.bag.reader import RawMessage, jazzy_types
from mild_ros.messages.handled import Handled
from mild_ros.replay.events import SKELETON, TICK, Event, with_ticks
from mild_ros.replay.sending import LockStep

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


def test_where_time_restarts_so_does_the_grid() -> None:
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


def in_lock_step(*events: Event, recorders: int) -> tuple[LockStep, list[int]]:
    """A sender of these events, and the times of those that it has sent."""
    ticks: list[int] = []
    return LockStep(iter(events), lambda name, data: None, ticks.append, 1.0, 1, recorders), ticks


def test_a_lock_step_waits_until_a_recorder_has_written_everything_down() -> None:
    step, ticks = in_lock_step(Event(1, TICK), Event(2, TICK), recorders=1)
    first, second = (Handled("pipeline", 0, "tick", stamp_ns) for stamp_ns in (1, 2))
    assert step.advance()
    assert not step.is_done_after(first), "it is handled, and not yet written down"
    assert not step.is_done_once_recorded(second)
    assert step.is_done_once_recorded(first)
    assert step.advance()
    assert not step.is_done_once_recorded(second), "the recorder may hear of it first"
    assert step.is_done_after(second)
    assert not step.advance()
    assert ticks == [1, 2]


def test_every_stage_s_report_has_to_be_written_down() -> None:
    message = RawMessage("/skeleton", "visualization_msgs/msg/MarkerArray", 5, b"")
    step, _ = in_lock_step(Event(5, SKELETON, message), recorders=2)
    perceived, inferred = Handled("perception", 1, "accepted", 5), Handled("inference", 0, "accepted", 5)
    step.advance()
    assert not any(step.is_done_after(handled) for handled in (perceived, inferred))
    acknowledged = [step.is_done_once_recorded(handled) for handled in (perceived, inferred, perceived, inferred)]
    assert acknowledged == [False, False, False, True]


def test_without_a_recorder_there_is_no_wait_for_one() -> None:
    step, _ = in_lock_step(Event(1, TICK), recorders=0)
    step.advance()
    assert step.is_done_after(Handled("pipeline", 0, "tick", 1))

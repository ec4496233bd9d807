# SPDX-License-Identifier: Apache-2.0
"""What a node says of itself: times, losses, pairs, ticks."""

from __future__ import annotations

import pytest
from std_msgs.msg import Header

from mild_ros.messages.stamps import time_to_msg
from mild_ros.node_kit.clock import ControlGrid
from mild_ros.node_kit.diagnostics import Spread, Stream
from mild_ros.replay.pairing import StampPairs

MS = 1_000_000


class Stamped:
    def __init__(self, stamp_ns: int, text: str = "") -> None:
        self.header = Header(stamp=time_to_msg(stamp_ns))
        self.text = text


def test_spread_reports_each_time_once():
    spread = Spread()
    assert spread.take_ms() is None
    for value in range(1, 101):
        spread.add(value * MS)
    assert spread.take_ms() == pytest.approx((50.5, 99.01, 100.0))
    assert spread.take_ms() is None


def test_rate_is_of_the_time_since_the_last_report():
    stream = Stream()
    for _ in range(20):
        stream.add(0.0)
    assert stream.take_rate_hz(2.0) == 10.0
    assert stream.take_rate_hz(2.0) == 0.0


def test_grid_is_due_once_at_each_point_and_not_between():
    grid = ControlGrid(10 * MS)
    times = [7, 7, 12, 17, 17, 19, 26, 27, 48, 49]
    assert [grid.due(time * MS) for time in times] == [True, False, False, True, False, False, False, True, True, False]


def test_grid_restarts_when_time_goes_back():
    grid = ControlGrid(10 * MS)
    assert [grid.due(time * MS) for time in (100, 110, 3, 12, 13)] == [True, True, True, False, True]


def test_pairs_meet_in_any_order():
    pairs, singles = [], []
    both = StampPairs(lambda left, right: pairs.append((left.text, right.text)), singles.append)
    for stamp in (1, 2, 3):
        both.left(Stamped(stamp, f"left {stamp}"))
    for stamp in (3, 1, 2):
        both.right(Stamped(stamp, f"right {stamp}"))
    both.right(Stamped(4, "right 4"))
    both.left(Stamped(4, "left 4"))
    assert pairs == [(f"left {stamp}", f"right {stamp}") for stamp in (3, 1, 2, 4)]
    assert singles == []


def test_halves_without_a_partner_are_given_up_and_reported():
    pairs, singles = [], []
    both = StampPairs(lambda left, right: pairs.append(left), singles.append, depth=3)
    for stamp in range(5):
        both.left(Stamped(stamp))
    assert singles == [0, 1]
    both.left(Stamped(4))
    assert singles == [0, 1, 4]
    both.right(Stamped(0))
    assert pairs == []

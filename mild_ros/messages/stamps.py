# SPDX-License-Identifier: Apache-2.0
"""Nanoseconds as one integer on our side, seconds and nanoseconds in a message."""

from __future__ import annotations

from typing import Any

from mild_ros.messages.standard import Duration, Time

NANOSECONDS_PER_SECOND = 1_000_000_000


def time_to_msg(stamp_ns: int) -> Time:
    """A `builtin_interfaces/Time` of a stamp [ns]."""
    sec, nanosec = divmod(stamp_ns, NANOSECONDS_PER_SECOND)
    return Time(sec=sec, nanosec=nanosec)


def duration_to_msg(duration_ns: int) -> Duration:
    """A `builtin_interfaces/Duration` of a span [ns], which may be negative."""
    sec, nanosec = divmod(duration_ns, NANOSECONDS_PER_SECOND)
    return Duration(sec=sec, nanosec=nanosec)


def ns_from_msg(message: Any) -> int:
    """Nanoseconds of a Time or a Duration."""
    return int(message.sec) * NANOSECONDS_PER_SECOND + int(message.nanosec)

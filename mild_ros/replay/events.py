# SPDX-License-Identifier: Apache-2.0
"""What happens during a replay, one thing after the other: messages, and ticks of the control clock."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from mild_ros.bag.reader import RawMessage

SKELETON, JOINT_STATES, TRUE_MOTION, TICK = "skeleton", "joint_states", "true_motion", ""

TAKEN = (SKELETON, JOINT_STATES, TICK)
"""Inputs that the pipeline takes; any other is only passed on."""


@dataclass(frozen=True)
class Event:
    """Something that happens during a replay.

    Attributes:
        time_ns: When.
        input: `SKELETON` or `JOINT_STATES`: the topic our nodes take it on; `TICK` for a tick of the clock; another is
            a topic that is only passed on: `TRUE_MOTION`, what the recorded robot did, or one under its own name.
        message: What arrives; None for a tick.
        topic: What it is sent on where that is not the name of the input; trackers may have several topics.
    """

    time_ns: int
    input: str
    message: RawMessage | None = None
    topic: str = ""

    @property
    def name(self) -> str:
        """What it is sent on."""
        return self.topic or self.input


def with_ticks(messages: Iterator[Event], rate_hz: float = 100.0) -> Iterator[Event]:
    """The messages and, between them, ticks on a grid that begins at the first of them, or where time starts again."""
    period_ns = round(1e9 / rate_hz)
    tick_ns = newest_ns = 0
    for event in messages:
        if not newest_ns or event.time_ns < newest_ns:
            tick_ns = event.time_ns
        newest_ns = event.time_ns
        while tick_ns <= event.time_ns:
            yield Event(tick_ns, TICK)
            tick_ns += period_ns
        yield event

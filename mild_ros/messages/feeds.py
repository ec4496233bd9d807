# SPDX-License-Identifier: Apache-2.0
"""A topic of a tracker and how its messages are read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mild_ros.messages.joint_by_joint import People

SKELETON_TOPIC = "skeleton"


@dataclass(frozen=True)
class Feed:
    """One of the topics that a tracker speaks on.

    Attributes:
        topic: Its name.
        type_name: Type of its messages, as bags and `ros2 topic` spell it.
        read: (message, now_ns) to everyone in it; None when more messages are needed to see a person. Only takes
            attributes, so messages of rosbags do as well.
        latched: Whether its last message waits for who comes late.
        lacks: Says what is missing to see a person, "" for nothing; None when that shows in each message.
    """

    topic: str
    type_name: str
    read: Callable[[Any, int], People | None]
    latched: bool = False
    lacks: Callable[[], str] | None = None

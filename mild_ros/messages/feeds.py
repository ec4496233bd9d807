# SPDX-License-Identifier: Apache-2.0
"""A topic of a tracker and how its messages are read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from mild_core.errors import SetupError
from mild_ros.messages.joint_by_joint import People

SKELETON_TOPIC = "skeleton"

PACKAGED = {"tf2_msgs", "hri_msgs", "zed_msgs"}
"""Packages of messages that apt has but not every ROS installation; `yolo_msgs` has to be built."""


@dataclass(frozen=True)
class Feed:
    """One of the topics that a tracker speaks on.

    Attributes:
        topic: Its name.
        type_name: Type of its messages, as bags and `ros2 topic` spell it.
        read: (message, now_ns) to everyone in it; None when more messages are needed to see anybody. Only takes
            attributes, so messages of rosbags do as well.
        latched: Whether its last message waits for who comes late.
        lacks: Says what is missing to see anybody, "" for nothing; None when that shows in each message.
    """

    topic: str
    type_name: str
    read: Callable[[Any, int], People | None]
    latched: bool = False
    lacks: Callable[[], str] | None = None


def message_class(type_name: str) -> type[Any]:
    """The class of a message type, e.g. of `geometry_msgs/msg/PoseArray`.

    Raises:
        SetupError: Its package is not installed.
    """
    package, _, name = type_name.split("/")
    try:
        found = getattr(import_module(f"{package}.msg"), name)
    except ImportError:
        remedy = f"apt install ros-jazzy-{package.replace('_', '-')}"
        if package not in PACKAGED:
            remedy = f"build {package} in your workspace and source it"
        raise SetupError(type_name, f"the package {package} is not installed", remedy) from None
    assert isinstance(found, type)
    return found

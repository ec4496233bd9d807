# SPDX-License-Identifier: Apache-2.0
"""The tracker that a node listens to."""

from __future__ import annotations

from typing import Any

from mild_core.errors import SetupError
from mild_core.perception.skeletons import SOURCES, SkeletonSource
from mild_core.signals import SkeletonFrame
from mild_ros.messages.skeletons import ADAPTERS
from mild_ros.settings import PerceptionParameters


def skeleton_source(parameters: PerceptionParameters) -> SkeletonSource:
    """The tracker convention that parameters name.

    Raises:
        SetupError: Joint names are missing, or given for a source that numbers its joints.
    """
    source = SOURCES[parameters.source]
    if not source.joint_ids:
        return source.with_joints(parameters.joint_names, parameters.source_axes)  # type: ignore[arg-type]
    if parameters.joint_names:
        problem = f"{parameters.source} numbers its joints, so their order cannot be given"
        raise SetupError("parameter joint_names", problem, "leave it out or set source to pose_array")
    return source


class Tracker:
    """Reads the messages of one kind of tracker.

    Args:
        parameters: Which one.

    Attributes:
        message_type: The class to subscribe with.

    Raises:
        SetupError: As `skeleton_source`.
    """

    def __init__(self, parameters: PerceptionParameters) -> None:
        self._source = skeleton_source(parameters)
        self._adapter = ADAPTERS[self._source.message]
        self.message_type = self._adapter.message_type

    def people(self, message: Any, now_ns: int) -> tuple[tuple[SkeletonFrame, ...], int | None]:
        """Everyone in a message that came at `now_ns`, and the newest stamp [ns]; None when there is nobody."""
        people = self._adapter.people(message, self._source, now_ns)
        return people, max((person.stamp_ns for person in people), default=None)

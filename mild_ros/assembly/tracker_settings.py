# SPDX-License-Identifier: Apache-2.0
"""What may be set of every node that deals with a tracker's own messages."""

from __future__ import annotations

from dataclasses import dataclass

from mild_core.errors import SetupError
from mild_core.parameters import parameter
from mild_core.perception.skeletons import SOURCES, SkeletonSource
from mild_core.perception.skeletons.source import Axes

_NAMELESS = tuple(name for name, source in SOURCES.items() if not source.joint_ids)
"""Sources whose joints have to be named by parameter."""


@dataclass(frozen=True)
class TrackerParameters:
    """Whose messages these are, and what in them is which joint."""

    source: str = parameter(
        "azure_kinect", "Tracker convention of the messages on `skeleton`, or in the bag.", choices=tuple(SOURCES)
    )
    joint_names: tuple[str, ...] = parameter(
        (), "For a source without joint numbers: the joint at each place of its message; an empty name skips a place."
    )
    joint_places: tuple[str, ...] = parameter(
        (),
        "For a source with a topic or tf frame per joint: their names, in the order of `joint_names`; empty if equal.",
    )

    def named_source(self, axes: Axes = "unknown") -> SkeletonSource:
        """The source with its joints, named where it needs names.

        Args:
            axes: Of its positions, where it does not say by itself.

        Raises:
            SetupError: Names are given for a source that numbers its joints, or are missing or wrong.
        """
        source = SOURCES[self.source]
        if not source.joint_ids:
            return source.with_joints(self.joint_names, axes, self.joint_places)
        for name in ("joint_names", "joint_places"):
            if getattr(self, name):
                problem = f"{self.source} names its joints, so this cannot be given"
                raise SetupError(
                    f"parameter {name}", problem, f"leave it out or set source to {' or '.join(_NAMELESS)}"
                )
        return source

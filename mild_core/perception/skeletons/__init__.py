# SPDX-License-Identifier: Apache-2.0
"""One file per tracker convention; the joints that all of them are translated to, and the table of sources."""

from mild_core.errors import SetupError, unknown_name
from mild_core.perception.skeletons.azure_kinect import AZURE_KINECT
from mild_core.perception.skeletons.pose_array import POSE_ARRAY
from mild_core.perception.skeletons.source import AXES, JOINTS, Axes, SkeletonSource

SOURCES: dict[str, SkeletonSource] = {source.name: source for source in (AZURE_KINECT, POSE_ARRAY)}

__all__ = ["AXES", "JOINTS", "SOURCES", "Axes", "SkeletonSource", "source_named"]


def source_named(name: str, joint_names: tuple[str, ...] = (), axes: str = "") -> SkeletonSource:
    """The source of that name, completed by what only a user can know.

    Args:
        name: A key of `SOURCES`.
        joint_names: The joint at each place of a message, "" for a place to pass over; none for sources that number
            their joints.
        axes: One of `AXES`; "" for the source's own.

    Raises:
        SetupError: A name is unknown, or the order of the joints is missing.
    """
    if name not in SOURCES:
        raise unknown_name("source", name, SOURCES)
    source = SOURCES[name]
    if axes and axes not in AXES:
        raise unknown_name("axes", axes, AXES)
    if joint_names:
        source = source.with_joints(joint_names)
    if not source.joint_ids:
        raise SetupError("joint_names", f"source '{name}' does not name its joints", "give their order")
    return source.with_axes(axes) if axes else source

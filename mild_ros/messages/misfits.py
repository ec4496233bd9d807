# SPDX-License-Identifier: Apache-2.0
"""Whether messages are those of the source that was set, and which source would fit: one line for an operator.

It only looks at what a message is made of: numbers of joints and ids. Where joints are is judged by perception.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mild_core.perception.skeletons import SOURCES, SkeletonSource
from mild_ros.messages.skeletons import ADAPTERS

_ADD = 0


def fitting_sources(type_name: str) -> list[str]:
    """Sources that read messages of a type."""
    return [name for name, source in SOURCES.items() if ADAPTERS[source.message].type_name == type_name]


def misfit(message: Any, source: SkeletonSource) -> str:
    """What is wrong with a message for a source, and what would be right; "" when it may be one of its.

    Args:
        message: Of the type that the source reads, of rclpy, of rosbags or read from bytes.
        source: With its joints.
    """
    find = _FINDERS.get(source.message)
    return find(message, source) if find is not None else ""


def _marker_misfit(message: Any, source: SkeletonSource) -> str:
    shown = [marker for marker in message.markers if marker.action == _ADD]
    ids = {int(marker.id) for marker in shown}
    if not ids:
        return ""
    others = [
        other.name
        for other in SOURCES.values()
        if other.message == source.message and other.name != source.name and _is_all_of(ids, other)
    ]
    if _is_of(ids, source) and (not others or _is_all_of(ids, source)):
        return ""
    remedy = f"set source to {' or '.join(others)}" if others else "no source here numbers markers so"
    people = f" + {source.ids_per_person} per person" if source.ids_per_person else ""
    known = f"{_ranges([*source.joint_ids, *source.other_ids])}{people}"
    return f"markers {_ranges(ids)} in frame '{shown[0].header.frame_id}', but {source.name} has {known}: {remedy}"


def _is_of(ids: set[int], source: SkeletonSource) -> bool:
    """Whether a source may give these numbers."""
    return {_joint(number, source) for number in ids} <= source.joint_ids.keys() | source.other_ids


def _is_all_of(ids: set[int], source: SkeletonSource) -> bool:
    """Whether these are the numbers of a source, and whole people."""
    return _is_of(ids, source) and {_joint(number, source) for number in ids} >= source.joint_ids.keys()


def _joint(number: int, source: SkeletonSource) -> int:
    return number % source.ids_per_person if source.ids_per_person and number >= 0 else number


def _pose_misfit(message: Any, source: SkeletonSource) -> str:
    return _places_misfit(len(message.poses), "poses", message, source)


def _cloud_misfit(message: Any, source: SkeletonSource) -> str:
    return _places_misfit(int(message.width), "points in a row", message, source)


def _places_misfit(count: int, what: str, message: Any, source: SkeletonSource) -> str:
    named = max(source.joint_ids) + 1
    if not count or count == named:
        return ""
    remedy = "name the joint at each place, empty to pass over one"
    return f"{count} {what} in frame '{message.header.frame_id}', but joint_names has {named}: {remedy}"


def _zed_misfit(message: Any, source: SkeletonSource) -> str:
    if not message.objects or any(found.skeleton_available for found in message.objects):
        return ""
    labels = ", ".join(sorted({str(found.label) for found in message.objects}))
    return f"objects without a skeleton ({labels}): remap skeleton to body_trk/skeletons, not to obj_det/objects"


def _yolo_misfit(message: Any, source: SkeletonSource) -> str:
    if not message.detections or any(found.keypoints3d.data for found in message.detections):
        return ""
    flat = any(found.keypoints.data for found in message.detections)
    remedy = "remap skeleton to detections_3d and set use_3d" if flat else "start yolo with a -pose model"
    return f"detections without keypoints in space: {remedy}"


def _ranges(numbers: Iterable[int]) -> str:
    """Whole numbers as people write them: "0 to 13, 20"."""
    parts: list[list[int]] = []
    for number in sorted(numbers):
        if parts and number == parts[-1][-1] + 1:
            parts[-1][1:] = [number]
        else:
            parts.append([number])
    return ", ".join(" to ".join(map(str, part)) for part in parts)


_FINDERS = {
    "marker_array": _marker_misfit,
    "pose_array": _pose_misfit,
    "point_cloud": _cloud_misfit,
    "zed_objects": _zed_misfit,
    "yolo_detections": _yolo_misfit,
}

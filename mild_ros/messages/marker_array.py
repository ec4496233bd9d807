# SPDX-License-Identifier: Apache-2.0
"""People as `visualization_msgs/MarkerArray`: one marker per joint, numbered person by person."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mild_core.perception.skeletons import SkeletonSource
from mild_core.signals import SkeletonFrame
from mild_ros.messages.stamps import ns_from_msg, time_to_msg
from mild_ros.messages.standard import ColorRGBA, Duration, Header, Marker, MarkerArray, Point, Pose, Vector3

_ADD = 0
_DIAMETER_M = 0.05
_LIFETIME = Duration(nanosec=250_000_000)
_PALETTE = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (0, 0, 0), (1, 1, 1))


def people_from_marker_array(message: Any, source: SkeletonSource, now_ns: int) -> tuple[SkeletonFrame, ...]:
    """Everyone in a message, in its order; none when it is empty.

    Markers that delete, and numbers that the source does not know (lines, labels), are no joints and are passed over.

    Args:
        message: A MarkerArray of rclpy or of rosbags.
        source: How it numbers joints and people.
        now_ns: Stamp [ns] for markers without one.
    """
    bodies: dict[int, list[tuple[str, Any]]] = {}
    joint_ids, ids_per_person = source.joint_ids, source.ids_per_person
    for marker in message.markers:
        if marker.action != _ADD:
            continue
        person, joint = divmod(int(marker.id), ids_per_person) if ids_per_person else (0, int(marker.id))
        name = joint_ids.get(joint)
        if name is not None:
            bodies.setdefault(person, []).append((name, marker))
    return tuple(_person(person, joints, source, now_ns) for person, joints in bodies.items())


def people_to_marker_array(people: Sequence[SkeletonFrame], source: SkeletonSource) -> MarkerArray:
    """The message a tracker would publish of these people: a sphere per joint, each person in a colour.

    Source: `getBodyMarker` of Azure_Kinect_ROS_Driver (size, lifetime, palette, numbers).
    """
    number = {name: joint for joint, name in source.joint_ids.items()}
    return MarkerArray(
        markers=[
            _marker(person, source.ids_per_person * person.person_id + number[name], position)
            for person in people
            for name, position in zip(person.joint_names, person.positions_m.tolist(), strict=True)
        ]
    )


def _person(person_id: int, joints: list[tuple[str, Any]], source: SkeletonSource, now_ns: int) -> SkeletonFrame:
    header = joints[0][1].header
    stamp_ns = ns_from_msg(header.stamp)
    positions = []
    for _, marker in joints:
        position = marker.pose.position
        positions.append((position.x, position.y, position.z))
    return SkeletonFrame(
        stamp_ns=stamp_ns if stamp_ns else now_ns,
        frame_id=str(header.frame_id),
        person_id=person_id,
        joint_names=tuple(name for name, _ in joints),
        positions_m=np.array(positions, dtype=np.float64),
        confidence=_confidence(joints, source),
    )


def _confidence(joints: list[tuple[str, Any]], source: SkeletonSource) -> np.ndarray[Any, np.dtype[np.float64]]:
    if not source.confidence_of_colour:
        return np.ones(len(joints))
    colours = [(marker.color.r, marker.color.g, marker.color.b) for _, marker in joints]
    if len(set(colours)) < 2:
        return np.ones(len(joints))
    known = dict(source.confidence_of_colour)
    return np.array([known.get(colour, 1.0) for colour in colours])


def _marker(person: SkeletonFrame, marker_id: int, position: list[float]) -> Marker:
    x, y, z = position
    red, green, blue = _PALETTE[person.person_id % len(_PALETTE)]
    return Marker(
        header=Header(stamp=time_to_msg(person.stamp_ns), frame_id=person.frame_id),
        id=marker_id,
        type=Marker.SPHERE,
        action=Marker.ADD,
        pose=Pose(position=Point(x=x, y=y, z=z)),
        scale=Vector3(x=_DIAMETER_M, y=_DIAMETER_M, z=_DIAMETER_M),
        color=ColorRGBA(r=float(red), g=float(green), b=float(blue), a=1.0),
        lifetime=_LIFETIME,
    )

# SPDX-License-Identifier: Apache-2.0
"""People as `sensor_msgs/PointCloud2`: a row per person, a point per joint, in an order that the source gives."""

from __future__ import annotations

from typing import Any

import numpy as np

from mild_core.errors import DataError
from mild_core.perception.skeletons import SkeletonSource
from mild_core.signals import SkeletonFrame
from mild_ros.messages.stamps import ns_from_msg

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Source: `sensor_msgs/PointField`."""

MOST_PEOPLE = 200
"""No tracker sees more."""

CONFIDENCE_FIELDS = ("confidence", "score", "visibility")


def people_from_skeleton_cloud(message: Any, source: SkeletonSource, now_ns: int) -> tuple[SkeletonFrame, ...]:
    """Everyone in a message; rows are people, joints that a row lacks are missing.

    Args:
        message: A PointCloud2 of rclpy or of rosbags.
        source: Which joint each point of a row is.
        now_ns: Stamp [ns] for a message without one.

    Raises:
        DataError: `wrong_layout` when it has no x, y, z or fewer bytes than it says.
    """
    points = _points(message)
    places = [place for place in source.joint_ids if place < points.shape[1]]
    if not places:
        return ()
    names, fields = tuple(source.joint_ids[place] for place in places), points.dtype.names or ()
    confident = next((field for field in CONFIDENCE_FIELDS if field in fields), None)
    stamp_ns = ns_from_msg(message.header.stamp) or now_ns
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        return tuple(
            SkeletonFrame(
                stamp_ns=stamp_ns,
                frame_id=str(message.header.frame_id),
                person_id=number,
                joint_names=names,
                positions_m=np.stack([row[axis] for axis in "xyz"], axis=-1).astype(np.float64),
                confidence=row[confident].astype(np.float64) if confident else np.ones(len(names)),
            )
            for number, row in enumerate(points[:, places])
        )


def _points(message: Any) -> np.ndarray[Any, Any]:
    """(people, joints) of the cloud's own fields."""
    height, width, step = int(message.height), int(message.width), int(message.point_step)
    if height > MOST_PEOPLE:
        raise DataError("wrong_layout", f"{height} rows, one for each person; at most {MOST_PEOPLE} are read")
    order = ">" if message.is_bigendian else "<"
    fields = {
        field.name: (np.dtype(order + _TYPES[field.datatype]), int(field.offset))
        for field in message.fields
        if field.name in ("x", "y", "z", *CONFIDENCE_FIELDS) and field.datatype in _TYPES
    }
    data = np.frombuffer(bytes(message.data), dtype=np.uint8)
    row_step = int(message.row_step) or step * width
    # All of it checked here: numpy itself reads beyond the data where an offset is too large for 32 bits.
    inside = all(offset + kind.itemsize <= step for kind, offset in fields.values())
    whole = row_step * height <= data.size and step * width <= row_step
    if not ({"x", "y", "z"} <= fields.keys() and inside and whole and (step <= data.size or not height * width)):
        raise DataError("wrong_layout", f"{height} x {width} points of {', '.join(fields)} in {data.size} bytes")
    if not height * width:
        return np.empty((height, 0), [(name, kind) for name, (kind, _) in fields.items()])
    kind = np.dtype(
        {
            "names": list(fields),
            "formats": [kind for kind, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": step,
        }
    )
    rows = data[: row_step * height].reshape(height, row_step)[:, : step * width]
    return np.ascontiguousarray(rows).view(kind).reshape(height, width)

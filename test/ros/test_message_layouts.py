# SPDX-License-Identifier: Apache-2.0
"""Messages whose layout is not what it seems: fields that overlap, rows with padding, velocities that are none."""

from __future__ import annotations

import array

import numpy as np
import pytest
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import Header

from mild_core.errors import DataError
from mild_core.perception.skeletons import SOURCES
from mild_ros.messages.joint_state import joint_command_from_msg
from mild_ros.messages.point_cloud import array_from_msg, array_to_msg
from mild_ros.messages.skeleton_cloud import people_from_skeleton_cloud

VALUES = np.arange(24.0).reshape(2, 4, 3)


def changed_field(place: int, **changes: int) -> PointCloud2:
    message = array_to_msg(VALUES, ("x", "y", "z"), Header())
    fields = [PointField(name=f.name, offset=f.offset, datatype=f.datatype, count=f.count) for f in message.fields]
    for name, value in changes.items():
        setattr(fields[place], name, value)
    message.fields = fields
    return message


@pytest.mark.parametrize(
    "changes", [{"offset": 0}, {"offset": 8}, {"offset": 24}, {"datatype": PointField.FLOAT32}, {"count": 2}]
)
def test_a_cloud_whose_fields_are_not_packed_is_refused(changes: dict[str, int]) -> None:
    np.testing.assert_array_equal(array_from_msg(changed_field(2))[0], VALUES)
    with pytest.raises(DataError, match="wrong_layout"):
        array_from_msg(changed_field(2, **changes))


@pytest.mark.parametrize("velocities", [[0.0, np.nan], [np.inf, 0.0], [0.0], [0.0, 0.0, 0.0]])
def test_a_command_whose_velocities_are_none_is_refused(velocities: list[float]) -> None:
    message = JointState(name=["a", "b"], position=[1.0, 2.0], velocity=velocities)
    with pytest.raises(DataError):
        joint_command_from_msg(message)


@pytest.mark.parametrize("padding", [0, 8, 20])
def test_rows_of_people_may_be_padded(padding: int) -> None:
    source = SOURCES["point_cloud"]
    places = sorted(source.joint_ids) or list(range(4))
    width = max(places) + 1
    points = np.random.default_rng(0).normal(size=(3, width, 3)).astype("<f4")
    rows = [row.tobytes() + b"\xff" * padding for row in points]
    message = PointCloud2(
        header=Header(frame_id="camera"),
        height=3,
        width=width,
        point_step=12,
        row_step=12 * width + padding,
        fields=[PointField(name=n, offset=4 * i, datatype=PointField.FLOAT32, count=1) for i, n in enumerate("xyz")],
        data=array.array("B", b"".join(rows)),
    )
    joint_names = {place: f"joint_{place}" for place in places}
    people = people_from_skeleton_cloud(message, _with_joints(source, joint_names), 7)
    assert [one.person_id for one in people] == [0, 1, 2]
    for one, row in zip(people, points, strict=True):
        np.testing.assert_array_equal(one.positions_m, row[places].astype(float))


def _with_joints(source, joint_names):
    from dataclasses import replace

    return source if source.joint_ids else replace(source, joint_ids=joint_names)

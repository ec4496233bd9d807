# SPDX-License-Identifier: Apache-2.0
"""The tables of trackers: every name is known, every joint comes once, and what a user must say is asked for."""

from __future__ import annotations

import pytest

from mild_core.errors import SetupError
from mild_core.perception.skeletons import AXES, JOINTS, SOURCES, SkeletonSource, source_named


@pytest.mark.parametrize("source", SOURCES.values(), ids=SOURCES)
def test_every_joint_of_a_source_is_a_known_joint_and_comes_once(source: SkeletonSource) -> None:
    names = list(source.joint_ids.values())
    assert set(names) <= set(JOINTS)
    assert len(set(names)) == len(names)
    assert source.axes in AXES
    assert not source.ids_per_person or max(source.joint_ids) < source.ids_per_person


def test_the_azure_kinect_numbers_its_joints_as_its_sdk_does() -> None:
    joint_ids = SOURCES["azure_kinect"].joint_ids
    assert len(joint_ids) == 32
    expected = {0: "pelvis", 3: "neck", 5: "left_shoulder", 8: "left_hand", 12: "right_shoulder", 13: "right_elbow"}
    expected |= {14: "right_wrist", 15: "right_hand", 18: "left_hip", 25: "right_foot", 26: "head", 31: "right_ear"}
    assert {number: joint_ids[number] for number in expected} == expected


def test_an_order_of_joints_makes_a_source_of_unnumbered_poses() -> None:
    source = source_named("pose_array", ("right_hand", "", "right_elbow"), "rep103")
    assert source.joint_ids == {0: "right_hand", 2: "right_elbow"}
    assert source.axes == "rep103"
    assert source_named("azure_kinect") is SOURCES["azure_kinect"]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("azure_kinetc",), "source: 'azure_kinetc' is unknown; did you mean 'azure_kinect'?"),
        (("pose_array",), "joint_names: source 'pose_array' does not name its joints"),
        (("pose_array", ("right_hnad",)), "joint_names: 'right_hnad' is unknown; did you mean 'right_hand'?"),
        (("pose_array", ("right_hand", "right_hand")), "joint_names: "),
        (("pose_array", ("",)), "joint_names: "),
        (("azure_kinect", (), "upwards"), "axes: 'upwards' is unknown"),
    ],
)
def test_what_cannot_be_a_source_is_one_clear_line(arguments: tuple[str, ...], line: str) -> None:
    with pytest.raises(SetupError) as caught:
        source_named(*arguments)
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)

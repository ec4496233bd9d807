# SPDX-License-Identifier: Apache-2.0
"""The tables of trackers: every name is known, every joint comes once, and what a user must say is asked for."""

from __future__ import annotations

import pytest

from mild_core.errors import SetupError
from mild_core.perception.skeletons import AXES, JOINTS, SOURCES, SkeletonSource


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
    source = SOURCES["pose_array"].with_joints(("right_hand", "", "right_elbow"), "rep103")
    assert source.joint_ids == {0: "right_hand", 2: "right_elbow"}
    assert source.axes == "rep103"
    assert not SOURCES["pose_array"].joint_ids


@pytest.mark.parametrize(
    ("joint_names", "line"),
    [
        (("right_hnad",), "joint_names: 'right_hnad' is unknown; did you mean 'right_hand'?"),
        (("right_hand", "right_hand"), "joint_names: ['right_hand', 'right_hand'] has no joints or one twice"),
        (("",), "joint_names: [''] has no joints"),
        ((), "joint_names: [] has no joints"),
    ],
)
def test_an_order_that_cannot_be_is_one_clear_line(joint_names: tuple[str, ...], line: str) -> None:
    with pytest.raises(SetupError) as caught:
        SOURCES["pose_array"].with_joints(joint_names)
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)

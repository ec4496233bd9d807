# SPDX-License-Identifier: Apache-2.0
"""Where perception says that the person's hand, head and trunk are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mild_core.perception.stage import Perception
from mild_core.signals import ARM_FRAME, ROBOT_FRAME, SkeletonFrame
from mild_ros.simulation.person import BODY_JOINTS, Camera, bodies
from test.core.perception.scene import SETTINGS, at_rate, changed, seen, swing

EXACT_M = 1e-9
"""Rounding of a few rotations of metres."""

STAMPS_S = at_rate(30.0, 2.0)
TRUE = bodies(swing(STAMPS_S - 1.0))
"""(T, 32, 3) in the arm frame: the person stands upright, so calibration finds this frame again."""


def true_place(joint: str, frame: int = -1) -> np.ndarray:
    return TRUE[frame, BODY_JOINTS.index(joint)]


def last_pose(settings=SETTINGS, people=None):
    perception = Perception(settings)
    state = perception.init()
    for message in seen(STAMPS_S) if people is None else people:
        state, _ = perception.step(state, message, message[0].stamp_ns)
    return state.person


def without(frame: SkeletonFrame, *joints: str) -> SkeletonFrame:
    kept = [place for place, name in enumerate(frame.joint_names) if name not in joints]
    names = tuple(frame.joint_names[place] for place in kept)
    return replace(frame, joint_names=names, positions_m=frame.positions_m[kept], confidence=frame.confidence[kept])


def test_hand_head_and_trunk_are_where_they_are_in_the_arm_frame() -> None:
    pose = last_pose()
    assert pose.frame_id == ARM_FRAME
    assert pose.stamp_ns == round(STAMPS_S[-1] * 1e9)
    np.testing.assert_allclose(pose.hand_m, true_place("right_hand"), atol=EXACT_M)
    np.testing.assert_allclose(pose.head_m, true_place("head"), atol=EXACT_M)
    shoulders = (true_place("left_shoulder") + true_place("right_shoulder")) / 2
    np.testing.assert_allclose(pose.trunk_m, [shoulders, true_place("pelvis")], atol=EXACT_M)


def test_a_calibrated_camera_puts_the_person_into_the_frame_of_the_robot() -> None:
    robot_from_arm = np.array([[-1.0, 0, 0, 0.9], [0, -1, 0, 0.1], [0, 0, 1, 0.7], [0, 0, 0, 1]])
    pose = last_pose(replace(SETTINGS, robot_from_source=robot_from_arm @ Camera().arm_from_camera))
    assert pose.frame_id == ROBOT_FRAME
    np.testing.assert_allclose(
        pose.hand_m, np.array([0.9, 0.1, 0.7]) + true_place("right_hand") * [-1, -1, 1], atol=1e-9
    )


def test_where_only_the_wrist_is_tracked_the_hand_lies_eight_centimetres_beyond_it() -> None:
    people = [tuple(without(person, "right_hand") for person in message) for message in seen(STAMPS_S)]
    wrist, elbow = true_place("right_wrist"), true_place("right_elbow")
    expected = wrist + 0.08 * (wrist - elbow) / np.linalg.norm(wrist - elbow)
    np.testing.assert_allclose(last_pose(people=people).hand_m, expected, atol=EXACT_M)


def test_a_left_hand_is_where_it_is_and_not_where_its_mirror_image_would_be() -> None:
    pose = last_pose(replace(SETTINGS, side="left"))
    np.testing.assert_allclose(pose.hand_m, true_place("left_hand") - true_place("left_shoulder", 0), atol=EXACT_M)


def test_an_arm_that_is_not_believed_has_no_hand_but_a_head_and_a_trunk() -> None:
    people = seen(STAMPS_S)
    people[-1] = (changed(people[-1][0], "right_elbow", confidence=0.1),)
    pose = last_pose(people=people)
    assert np.isnan(pose.hand_m).all()
    np.testing.assert_allclose(pose.head_m, true_place("head"), atol=EXACT_M)


def test_without_a_calibrated_person_there_is_no_place() -> None:
    assert last_pose(people=seen(at_rate(30.0, 0.9))) is None
    assert last_pose(people=[*seen(STAMPS_S), *seen([1.5])]) is None, "a late frame says nothing of now"

# SPDX-License-Identifier: Apache-2.0
"""Joints that come one at a time: one that is late, now and then or always, is not lost."""

from __future__ import annotations

from mild_core.signals import SkeletonFrame
from mild_ros.messages.joint_by_joint import JointByJoint, Sample

PERIOD_NS = 33_000_000
JOINTS = ("shoulder", "hand", "pelvis")


def frames(late: dict[int, int], count: int = 12) -> list[SkeletonFrame]:
    """Frames of a person whose pelvis comes so many frames late (by frame); x of a joint is when it was seen."""
    joints, found = JointByJoint(JOINTS), []
    for number in range(1, count + 1):
        due = [(name, number) for name in JOINTS[:2]]
        due += [("pelvis", seen) for seen in range(1, number + 1) if seen + late.get(seen, 0) == number]
        for name, seen in due:
            done = joints.add("0", name, Sample(seen * PERIOD_NS, "mocap", (float(seen), 0.0, 0.0)))
            found += done or ()
    return found


def test_a_joint_that_is_always_a_frame_late_stands_in_every_frame() -> None:
    found = frames(dict.fromkeys(range(1, 13), 1))
    assert len(found) >= 9
    for frame in found[2:]:
        assert frame.joint_names == JOINTS
        hand, pelvis = frame.positions_m[1:, 0]
        assert hand * PERIOD_NS == frame.stamp_ns
        assert pelvis == hand - 1.0


def test_a_joint_that_was_late_once_is_in_time_again() -> None:
    found = frames({5: 1})
    assert [frame.stamp_ns // PERIOD_NS for frame in found] == list(range(1, 13))
    for frame in found[6:]:
        assert frame.joint_names == JOINTS
        assert (frame.positions_m[:, 0] * PERIOD_NS == frame.stamp_ns).all()


def test_a_joint_that_is_far_too_late_is_left_out() -> None:
    found = frames(dict.fromkeys(range(1, 13), 3))
    assert len(found) >= 8
    assert all(frame.joint_names == JOINTS[:2] for frame in found[2:])

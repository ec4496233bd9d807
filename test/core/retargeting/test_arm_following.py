# SPDX-License-Identifier: Apache-2.0
"""A partner's arm becomes commands of a robot: in its directions, inside every limit, refused by who has no arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.arm_following import LinkFollower
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robots.pepper import PEPPER
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Retargeting
from mild_core.shapes import FloatArray
from mild_core.signals import ARM_JOINTS, JointCommand, JointMeasurement, MotionWindow
from test.core.retargeting.limits import check_limits
from test.core.retargeting.perfect import START_NS, TICK_NS, window

assert PEPPER.arm is not None
HANGING = np.array(PEPPER.arm.directions((1.59, -0.16), (1.34, 0.24)))
AHEAD = np.array([[1, -0.4, -0.6], [1, -0.2, 0.6]])
"""Directions of upper arm and forearm that Pepper can take."""

NO_ARM = replace(YUMI, arm_links=None)
"""A robot that says nothing of its arm."""


def arm(bones: FloatArray, lengths_m: tuple[float, float] = (0.31, 0.25)) -> FloatArray:
    """(..., 3, 3) shoulder, elbow, hand of a person with bones (..., 2, 3) in these directions."""
    scaled = np.array(lengths_m)[:, None] * bones / np.linalg.norm(bones, axis=-1, keepdims=True)
    return np.concatenate([np.zeros((*bones.shape[:-2], 1, 3)), np.cumsum(scaled, axis=-2)], axis=-2)


def arm_window(arm_m: FloatArray, stamp_ns: int) -> MotionWindow:
    return window(np.asarray(arm_m, dtype=np.float64), stamp_ns, joint_names=ARM_JOINTS)


def followed(robot: RobotModel, windows: list[FloatArray]) -> tuple[str, list[JointCommand]]:
    """The last outcome, and the commands while these windows come at the model's rate."""
    retargeting = Retargeting(robot)
    home = JointMeasurement(START_NS, robot.joint_names, robot.home_rad)
    state, _ = retargeting.step(retargeting.init(), home, START_NS)
    outcome, commands, now_ns = "", [], START_NS
    for rows in windows:
        now_ns += TICK_NS
        state, new = retargeting.step(state, arm_window(rows, now_ns), now_ns)
        outcome, commands = state.outcome, [*commands, *new]
        for _ in range(2):
            now_ns += TICK_NS
            state, new = retargeting.step(state, None, now_ns)
            commands += new
    return outcome, commands


def test_pepper_does_what_the_partner_does() -> None:
    share = np.clip(np.linspace(-0.2, 2.0, 80), 0.0, 1.0)[:, None, None]
    rows = arm((1 - share) * HANGING + share * AHEAD)
    outcome, commands = followed(PEPPER, [np.stack([row] * 5) for row in rows])
    assert outcome == "accepted"
    check_limits(PEPPER, commands)
    pitch, roll, yaw, augment = commands[-1].positions_rad.tolist()
    for got, wanted in zip(PEPPER.arm.directions((pitch, roll), (yaw, augment)), AHEAD, strict=True):
        # It has arrived: what is left is the elbow's slack, far below a degree.
        assert np.dot(got, wanted) / np.linalg.norm(wanted) > np.cos(np.radians(0.5))


def test_only_directions_count_whatever_the_lengths_of_the_persons_bones() -> None:
    follower, home = LinkFollower(YUMI), tuple(YUMI.home_rad.tolist())
    found = [follower.joints(arm(AHEAD, lengths_m), home) for lengths_m in ((0.31, 0.25), (0.25, 0.31), (0.2, 0.2))]
    np.testing.assert_allclose(found[1:], [found[0]] * 2, atol=1e-9)


def test_a_robot_without_a_closed_form_points_where_it_can() -> None:
    _, commands = followed(YUMI, [np.stack([arm(AHEAD)] * 5)] * 100)
    check_limits(YUMI, commands)
    follower = LinkFollower(YUMI)
    here = tuple(commands[-1].positions_rad.tolist())
    # Nothing is left to do: the solver stays where the commands have come to.
    np.testing.assert_allclose(follower.joints(arm(AHEAD), here), here, atol=0.02)


def test_a_robot_that_says_nothing_of_its_arm_takes_no_partner() -> None:
    outcome, commands = followed(NO_ARM, [np.stack([arm(AHEAD)] * 5)])
    assert outcome == "wrong_joints"
    assert all(command.mode == "idle" for command in commands)
    with pytest.raises(SetupError, match="which links are shoulder and elbow"):
        LinkFollower(NO_ARM)


def test_a_shoulder_that_moves_is_refused_and_the_link_that_the_remedy_names_is_none_such() -> None:
    with pytest.raises(SetupError, match="moves with the arm; name a link about whose origin the arm turns: ") as error:
        LinkFollower(replace(YUMI, arm_links=("yumi_link_4_r", "yumi_link_6_r")))
    named = str(error.value).rpartition(": ")[2].strip("'")
    assert named == "yumi_link_1_r"
    LinkFollower(replace(YUMI, arm_links=(named, "yumi_link_6_r")))


def test_a_left_arm_does_as_a_right_one_mirrored() -> None:
    left = replace(
        YUMI,
        joint_names=tuple(name.replace("_r", "_l") for name in YUMI.joint_names),
        tool_link="tool_l",
        arm_links=("yumi_link_1_l", "yumi_link_4_l"),
        home_rad=YUMI.home_rad * np.array([-1, 1, -1, 1, -1, 1, -1]),
        rest=tuple((name.replace("_l", "_r"), position) for name, position in YUMI.rest if "joint_" in name),
    )
    mirror = np.array([1.0, -1.0, 1.0])
    hands = []
    for robot in (YUMI, left):
        joints, follower = tuple(robot.home_rad.tolist()), LinkFollower(robot)
        for _ in range(30):
            joints = follower.joints(arm(AHEAD), joints)
        chain = chain_of(robot)
        hands.append(chain.tool(np.array(joints)) - chain.offsets[0][:3, 3])
    np.testing.assert_allclose(hands[1], hands[0] * mirror, atol=0.02)


@pytest.mark.parametrize("follower", [PEPPER.arm, LinkFollower(YUMI)], ids=["closed form", "links"])
@pytest.mark.parametrize("elbow", [0.0, 50.0], ids=["collapsed", "far away"])
def test_a_lost_arm_moves_nothing(follower: LinkFollower, elbow: float) -> None:
    lost = arm(AHEAD)
    lost[1] = elbow
    assert follower.joints(lost, (0.1, 0.2, 0.3, 0.4)) == (0.1, 0.2, 0.3, 0.4)


SEEDS = st.lists(st.tuples(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.01, 0.3, 3.0])), min_size=3, max_size=15)


@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(SEEDS)
def test_any_arms_give_commands_inside_every_limit(seeds: list[tuple[int, float]]) -> None:
    windows = [np.random.default_rng(seed).normal(0.0, size, (5, 3, 3)) for seed, size in seeds]
    outcome, commands = followed(PEPPER, windows)
    assert outcome == "accepted"
    check_limits(PEPPER, commands)

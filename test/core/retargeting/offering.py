# SPDX-License-Identifier: Apache-2.0
"""A person who offers a hand to any arm, and a model of two people that knows what a partner's arm would do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from mild_core.retargeting.human_track import AssumedPlacement
from mild_core.retargeting.robot_model.arm_following import arm_follower
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.stage import Retargeting, RetargetingInput, RetargetingSettings
from mild_core.shapes import FloatArray
from mild_core.signals import ARM_JOINTS, JointCommand, JointMeasurement, MotionWindow
from test.core.retargeting.people import RADII_M, pose
from test.core.retargeting.perfect import MODEL_PERIOD_NS, START_NS, TICK_NS

Arms = tuple[FloatArray, FloatArray]

LOW: Arms = (
    np.array([[0.0, 0.0, 0.0], [0.0, -0.02, -0.29], [0.05, 0.0, -0.6]]),
    np.array([[0.0, 0.0, 0.0], [0.2, -0.12, -0.17], [0.52, -0.12, -0.05]]),
)
"""Shoulder, elbow and hand of the partner's arm at rest and where hands meet: the arm hangs and comes up."""

HIGH: Arms = (
    np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.3], [0.25, 0.0, 0.1]]),
    np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.27], [0.43, 0.0, 0.1]]),
)
"""The same of a person who rests the elbow on high: for arms that stand on a table and cannot hang."""

STANDING = AssumedPlacement((1.1, 0.0, 0.2), np.pi, {"handshake": (1.1, 0.0, 0.2)})
AWAY_RAD = 0.3
"""How far a robot that was learned joint by joint moves each."""

RAISING_S = 0.9
HEAD_AND_TRUNK_M = np.array([[0.75, 0.2, 0.5], [0.75, 0.2, 0.3], [0.75, 0.2, -0.3]])
"""Seen from the hand that is held out."""


@dataclass(frozen=True, eq=False)
class Offer:
    """A hand that is raised, held out and taken back; every time of these is in seconds from the start.

    Attributes:
        robot: To whom.
        hand_m: (3,) where it is held out, in the robot's base frame.
        arms: The partner's, at rest and where hands meet.
        held_s: For so long.
        parts: Of the person that are published; without any, nothing is kept away from.
    """

    robot: RobotModel
    hand_m: FloatArray
    arms: Arms = LOW
    held_s: float = 1.2
    parts: tuple[str, ...] = tuple(RADII_M)

    @property
    def duration_s(self) -> float:
        """Until the robot should be at home again."""
        return 0.6 + 2 * RAISING_S + self.held_s + 3.0

    def raised(self, time_s: float) -> float:
        """From 0 at rest to 1 held out, along minimum jerk."""
        share = np.clip(min(time_s - 0.6, 0.6 + 2 * RAISING_S + self.held_s - time_s) / RAISING_S, 0.0, 1.0)
        return float(share**3 * (10.0 - 15.0 * share + 6.0 * share**2))

    def hand_at(self, time_s: float) -> FloatArray:
        """(3,) the person's hand then."""
        rest = np.array([self.hand_m[0] + 0.3, self.hand_m[1] + 0.1, self.hand_m[2] - 0.45])
        hand: FloatArray = rest + self.raised(time_s) * (self.hand_m - rest)
        return hand

    def inputs(self) -> Iterator[tuple[int, RetargetingInput]]:
        """Inputs of retargeting: where the robot is, the person at 30 Hz, motions at 40 Hz, ticks at 100 Hz."""
        yield START_NS, JointMeasurement(START_NS, self.robot.joint_names, self.robot.home_rad)
        next_pose_ns = next_motion_ns = START_NS
        for now_ns in range(START_NS, START_NS + round(self.duration_s * 1e9), TICK_NS):
            time_s = (now_ns - START_NS) * 1e-9
            if now_ns >= next_pose_ns:
                head, *trunk = self.hand_m + HEAD_AND_TRUNK_M
                yield now_ns, pose(now_ns, self.hand_at(time_s), head, np.array(trunk), parts=self.parts)
                next_pose_ns += 1_000_000_000 // 30
            if now_ns >= next_motion_ns:
                yield now_ns, self._motion(now_ns, time_s)
                next_motion_ns += MODEL_PERIOD_NS
            yield now_ns, None

    def _motion(self, now_ns: int, time_s: float) -> MotionWindow:
        shares = np.array([self.raised(time_s + 0.025 * row) for row in range(40)])
        rest, offered = (
            self.arms if does_as_partners(self.robot) else (self.robot.home_rad, self.robot.home_rad + AWAY_RAD)
        )
        rows = rest + shares.reshape(-1, *np.ones(rest.ndim, dtype=int)) * (offered - rest)
        names = ARM_JOINTS if does_as_partners(self.robot) else self.robot.joint_names
        known = {"probability": 1.0, "belief": np.ones(1), "phase": 0.5, "out_of_distribution": 0.1}
        spread = 1e-3 * np.eye(rest.size)
        return MotionWindow(now_ns, 0, MODEL_PERIOD_NS, names, rows, spread, "handshake", **known)  # type: ignore[arg-type]


def does_as_partners(robot: RobotModel) -> bool:
    """Whether the models that move it here are of two people; those of YuMi learned its own joints."""
    return robot.follows_arms and robot.name != "yumi"


def learned_hand(robot: RobotModel, arms: Arms = LOW) -> FloatArray:
    """(3,) where the robot's hand is when its arm does as the partner's that is held out."""
    if not does_as_partners(robot):
        return chain_of(robot).tool(robot.home_rad + AWAY_RAD)
    joints = tuple(robot.home_rad.tolist())
    for _ in range(20):  # inverse kinematics goes a few steps each time
        joints = arm_follower(robot).joints(arms[1], joints)
    return chain_of(robot).tool(np.array(joints))


def answered(offer: Offer, ik: str = "blend") -> tuple[list[JointCommand], Mapping[str, int]]:
    """The commands for one offer, and what was counted."""
    stage = Retargeting(offer.robot, RetargetingSettings(ik=ik), STANDING)  # type: ignore[arg-type]
    state, commands = stage.init(), []
    for now_ns, given in offer.inputs():
        state, new = stage.step(state, given, now_ns)
        commands += new
    return commands, state.counts

# SPDX-License-Identifier: Apache-2.0
"""How the learned motion gives way to inverse kinematics, so that the hands meet, and takes over again afterwards.

The person's hand is where it is seen; the learned hand is where the model says, with a covariance. While either the
learned hand or the robot's own, which may have to catch up, is far from the person's, the robot moves as it has
learned. As they come near, the target of the robot's hand moves from the learned one to their precision-weighted mean,
which is almost the person's hand where the model is unsure. What the hand leaves free of the joints stays as learned.

The gate is the distance and not the phase: the phase of an interaction that begins and ends at rest does not rise
from 0 to 1, while hands that are meant to touch are near each other exactly then. Strangers hold their hands out where
none of the model's people did, and the learned hand may not come near: one that waits within reach, where the
camera's place is measured, is met wherever that is.

Source: V. Prasad et al., "Learning Multimodal Latent Dynamics for Human-Robot Interaction", 2023, section III-D, where
a segment of the hidden semi-Markov model switches the inverse kinematics on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mild_core.retargeting.limiter import Joints
from mild_core.retargeting.robot_model.chain import Chain, chain_of
from mild_core.retargeting.robot_model.inverse_kinematics import InverseKinematics, Reach
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.settings import Mix
from mild_core.shapes import FloatArray

FAR_M, NEAR_M = 0.30, 0.20
"""Learned and seen hand: further apart each goes its way, nearer they meet. Recorded hands that touch are less than
0.15 m apart in the model's frame in nine trials of ten, those of a wave 0.6 m."""

OVER_S = 0.35
"""The share of the person's hand goes from 0 to 1 in no less than this."""

PARTED = 0.9
"""A hand that is taken back while the learned one would come so much less near than fully is let go."""

MET = 0.9
"""From this share on hands have met."""

SEEN_TO_M, STANDING_TO_M = 0.01, 0.05
"""Standard deviations: of a tracked hand, and of where a learned hand is in truth when the model is sure of its joints,
as it has never seen how long this person's arm is nor how far away they stand."""

IN_HAND_M, ARRIVING_M = 0.03, 0.10
"""Nearer than the first the hands touch; further than the second they do not."""

RELENT = 1.0
"""Where the hand stays 10 cm away, a radian from the learned posture costs as much as another 10 cm: an arm that
contorts itself for the last of them is late when the person comes nearer."""

TRIED_POSES, SEED = 1000, 7
"""Random poses from which the reach is estimated, and their seed. Targets beyond it are pulled in: a fully extended
arm oscillates."""

SOFT = 0.3
"""Stiffness of the arm while hands touch, of 1 while it reaches."""


@dataclass(frozen=True)
class ContactState:
    """How far the hands have been brought together.

    Attributes:
        share: 0 for the learned motion, 1 for the person's hand.
        joints_rad: J positions that the solver found last.
        gap_m: From the learned hand to where the person's would draw it.
        apart_m: Between the person's hand and the robot's.
        withdrawn: Whether the person has taken the hand back: it is followed no more, and the gap of before fades.
    """

    share: float
    joints_rad: Joints
    gap_m: Joints
    apart_m: float
    withdrawn: bool = False


@dataclass(frozen=True, eq=False)
class Contact:
    """Brings the hand of one robot to the person's.

    Attributes:
        robot: Whose hand.
        mix: `blend` or `only`: see `RetargetingSettings.ik`.
        margin_rad: Distance kept from the position limits.
    """

    robot: RobotModel
    mix: Mix
    margin_rad: float
    _chain: Chain = field(init=False, repr=False)
    _solver: InverseKinematics = field(init=False, repr=False)
    _reach_m: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_chain", chain_of(self.robot))
        object.__setattr__(
            self, "_solver", InverseKinematics(self.robot, (self.robot.tool_link,), self.margin_rad, RELENT)
        )
        object.__setattr__(self, "_reach_m", shoulder_and_reach_m(self.robot)[1])

    def aim(
        self,
        learned_rad: FloatArray,
        covariance: FloatArray,
        hand_m: FloatArray | None,
        offered: bool,
        before: ContactState | None,
        here_rad: FloatArray,
        elapsed_s: float,
        *,
        waits: bool = False,
        relaxed: float = 0.0,
    ) -> tuple[FloatArray, ContactState | None]:
        """Where the joints shall be.

        Args:
            learned_rad: (J,) by the model.
            covariance: (J, J) of that [rad^2], or (9, 9) of a partner's shoulder, elbow and hand [m^2].
            hand_m: (3,) the person's hand, if it is known and the interaction is one in which hands touch.
            offered: Whether the person holds it out: then hands that have met stay together, wherever the model goes.
            before: Of the command before.
            here_rad: (J,) where the robot is by that command.
            elapsed_s: Since then.
            waits: Whether an offered hand has waited, and it is measured where the person stands, not assumed.
            relaxed: From 0 to 1 how much of the learned posture is given up for that of home, where the learned one
                would bring another part of the arm too near to a person.

        Returns:
            (J,) positions [rad], and how far the hands are brought together; None when they are not.
        """
        posture = self.robot.home_rad if self.mix == "only" else learned_rad
        tool, here = self._chain.tool(posture), self._chain.tool(here_rad)
        apart = math.inf if hand_m is None else math.dist(here, hand_m)
        wanted = 0.0 if hand_m is None else self._nearness(tool, hand_m)
        share = 0.0 if before is None else before.share
        withdrawn = before is not None and before.withdrawn and not offered
        if hand_m is not None and before is not None and share >= MET:
            withdrawn = not offered and wanted < PARTED
            if offered:
                wanted = max(wanted, self._nearness(self._chain.tool(np.array(before.joints_rad)), hand_m))
        elif hand_m is not None:
            wanted = min(wanted, self._nearness(here, hand_m))
        if hand_m is not None and offered and waits:
            wanted = max(wanted, smooth(1.0 - self._beyond_m(hand_m) / (FAR_M - NEAR_M)))
        wanted = 0.0 if withdrawn else wanted
        most = elapsed_s / OVER_S
        share += min(max(wanted - share, -most), most)
        if share <= 0.0:
            return posture, None
        if withdrawn and before is not None:
            gap = np.array(before.gap_m)
        elif hand_m is not None:
            gap = self._trust(posture, covariance) * (hand_m - tool)
        else:  # a hand that was lost a moment ago draws on, and ever less
            gap = np.zeros(3) if before is None else np.array(before.gap_m)
        start = posture if before is None else np.array(before.joints_rad)
        held = posture + smooth(relaxed) * (self.robot.home_rad - posture) if relaxed else posture
        joints = self._solver.step(start, [Reach(self.robot.tool_link, self._within(tool + share * gap))], held)
        return joints, ContactState(share, tuple(joints.tolist()), tuple(gap.tolist()), apart, withdrawn)

    def is_beyond(self, hand_m: FloatArray, touch: ContactState | None) -> bool:
        """Whether the arm does not come to a hand: by its reach or, brought together with it, by the solver."""
        if touch is None or touch.share < MET:
            return self._beyond_m(hand_m) > 0.0
        return math.dist(self._chain.tool(np.array(touch.joints_rad)), hand_m) > IN_HAND_M

    def tool_m(self, joints_rad: Joints) -> FloatArray:
        """(3,) the robot's hand at J positions."""
        return self._chain.tool(np.array(joints_rad))

    def _nearness(self, tool_m: FloatArray, hand_m: FloatArray) -> float:
        """The share that the distance allows, from 0 to 1; without learned motion, the one that reach allows."""
        if self.mix == "only":
            return smooth(1.0 - self._beyond_m(hand_m) / (FAR_M - NEAR_M))
        return smooth((FAR_M - math.dist(tool_m, hand_m)) / (FAR_M - NEAR_M))

    def _beyond_m(self, point_m: FloatArray) -> float:
        """How far a point is beyond the arm's reach; negative inside it."""
        return math.dist(self._chain.offsets[0][:3, 3], point_m) - self._reach_m

    def _within(self, point_m: FloatArray) -> FloatArray:
        """(3,) the point, or the nearest one that the arm reaches without being straight."""
        shoulder_m = self._chain.offsets[0][:3, 3]
        share = self._reach_m / max(math.dist(shoulder_m, point_m), 1e-9)
        return point_m if share >= 1.0 else shoulder_m + share * (point_m - shoulder_m)

    def _trust(self, learned_rad: FloatArray, covariance: FloatArray) -> float:
        """How much more the seen hand is to be trusted than the learned one, from 0 to 1.

        Source: the mean of two measurements, each weighted by its inverse variance.
        """
        if self.mix == "only":
            return 1.0
        if len(covariance) == len(learned_rad):
            jacobian = self._chain.jacobian(learned_rad)
            covariance = jacobian @ covariance @ jacobian.T
        hand = covariance[-3:, -3:].ravel()
        spread = float(hand[0] + hand[4] + hand[8]) / 3.0
        learned = STANDING_TO_M**2 + (min(spread, 1.0) if spread > 0.0 else 0.0)  # NaN is not above 0 either
        return learned / (learned + SEEN_TO_M**2)


def shoulder_and_reach_m(robot: RobotModel) -> tuple[FloatArray, float]:
    """(3,) where the arm's first joint is in the robot's base frame, and how far from there its tool comes [m]."""
    chain, shape = chain_of(robot), (TRIED_POSES, len(robot.joint_names))
    tried = np.random.default_rng(SEED).uniform(robot.lower_rad, robot.upper_rad, shape)
    shoulder_m: FloatArray = chain.offsets[0][:3, 3]
    return shoulder_m, max(math.dist(shoulder_m, chain.tool(pose)) for pose in tried)


def stiffness(touch: ContactState | None) -> float:
    """How hard the arm shall hold its position: 1 while it moves by itself, `SOFT` while hands touch."""
    if touch is None:
        return 1.0
    closed = smooth((ARRIVING_M - touch.apart_m) / (ARRIVING_M - IN_HAND_M))
    return 1.0 - (1.0 - SOFT) * closed * touch.share


def smooth(share: float) -> float:
    """From 0 to 1 without a corner, for a share from 0 to 1. Source: the Hermite polynomial 3 x^2 - 2 x^3."""
    inside = min(max(share, 0.0), 1.0)
    return inside * inside * (3.0 - 2.0 * inside)

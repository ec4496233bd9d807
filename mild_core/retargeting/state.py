# SPDX-License-Identifier: Apache-2.0
"""All that changes while retargeting runs, as a value, and what an operator may ask of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from mild_core.joint_measurements import JointTracks
from mild_core.retargeting.contact import Touch
from mild_core.retargeting.limiter import JointMotion, Joints
from mild_core.retargeting.modes import Mode
from mild_core.retargeting.person import Point, Sight, seen_again
from mild_core.retargeting.target import Plan, Pursuit
from mild_core.signals import PersonPose


@dataclass(frozen=True)
class Request:
    """What an operator asks for.

    Attributes:
        kind: `enable` follows motions; `disable` stops smoothly, then sends nothing; `reset` forgets the motion,
            stops smoothly and goes home; `hold` stops smoothly at once and stays until `release`.
    """

    kind: Literal["enable", "disable", "reset", "hold", "release"]


@dataclass(frozen=True, eq=False)
class RetargetingState:
    """Where the robot is told to be, why, and what has happened so far.

    Attributes:
        mode: What it is doing ...
        since_ns: ... and since when.
        held: Whether the operator holds the robot.
        motion: The newest command with its acceleration; None before the first measurement.
        commanded_ns: When that command was sent; None before the first.
        plan: The newest usable motion; None when there is nothing to follow.
        had_plan: Whether there was one at the command before.
        pursuit: The way onto the plan; None unless following, and where it starts anew.
        unknown_since_ns: When the model ceased to know what the person does; None while it knows.
        holding_since_ns: When holding began.
        joints: The robot's own word on where it is, joint by joint.
        measured_rad: The merged pose of all joints that is believed: J positions ...
        measured_ns: ... and when the oldest of them came; None before the first.
        reports: Whether it says so again and again; a bag may hold a single word.
        silent: Whether it has ceased to.
        displaced_since_ns: When the robot was first seen far from its command; None while it is near.
        displaced: It has been far for too long.
        person: The newest pose of the person ...
        person_ns: ... and when it came.
        sight: What is known of the person from all poses before that one.
        touch: How far the hands have been brought together; None when they are not.
        place_m: Where the person is taken to stand, if the camera does not tell.
        near_m: How near the robot's hand was to the person at the newest command that moves.
        counts: Events by reason since the start.
        outcome: What became of the newest input: a key of `counts`.
        detail: Why that input was not used, for people; "" when it was.
    """

    mode: Mode = Mode.WAITING
    since_ns: int = 0
    held: bool = False
    motion: JointMotion | None = None
    commanded_ns: int | None = None
    plan: Plan | None = None
    had_plan: bool = False
    pursuit: Pursuit | None = None
    unknown_since_ns: int | None = None
    holding_since_ns: int = 0
    joints: JointTracks = field(default_factory=JointTracks)
    measured_rad: Joints = ()
    measured_ns: int | None = None
    reports: bool = False
    silent: bool = False
    displaced_since_ns: int | None = None
    displaced: bool = False
    person: PersonPose | None = None
    person_ns: int = 0
    sight: Sight | None = None
    touch: Touch | None = None
    place_m: Point | None = None
    near_m: float = math.inf
    counts: Mapping[str, int] = field(default_factory=dict)
    outcome: str = ""
    detail: str = ""

    def with_sight(self, now_ns: int) -> RetargetingState:
        """The newest pose taken into account, if it came before now.

        A pose that came at this very time has to wait for the next command: over DDS it may come before or after the
        motion of the same skeleton, and both orders shall lead to the same commands.
        """
        if self.person is None or self.person_ns == now_ns:
            return self
        return replace(self, person=None, sight=seen_again(self.sight, self.person, self.person_ns))

    def counted(self, reason: str) -> RetargetingState:
        """One more event of `reason`."""
        return replace(self, counts=self._one_more(reason))

    def ended(self, outcome: str, detail: str = "") -> RetargetingState:
        """One more input that ended in `outcome`."""
        return replace(self, counts=self._one_more(outcome), outcome=outcome, detail=detail)

    def _one_more(self, reason: str) -> dict[str, int]:
        return {**self.counts, reason: self.counts.get(reason, 0) + 1}

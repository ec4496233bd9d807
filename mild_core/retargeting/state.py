# SPDX-License-Identifier: Apache-2.0
"""All that changes while retargeting runs, as a value, and what an operator may ask of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from mild_core.joint_measurements import JointTracks
from mild_core.retargeting.contact import ContactState
from mild_core.retargeting.evasion import Refuge
from mild_core.retargeting.human_track import HumanTrack, Point, seen_again
from mild_core.retargeting.limiter import JointMotion, Joints
from mild_core.retargeting.modes import Mode
from mild_core.retargeting.obstacles import Crowd
from mild_core.retargeting.target import Plan, RampIn
from mild_core.retargeting.unmet import NO_TOUCH, TEXTS
from mild_core.signals import PersonPose

PAUSED_S = 1.0
"""For so long after it was held back by a bystander the arm is said to be paused: diagnostics come once a second."""


@dataclass(frozen=True)
class Request:
    """What an operator asks for.

    Attributes:
        kind: `enable` follows motions; `disable` stops smoothly, then sends nothing; `reset` forgets the motion,
            stops smoothly and goes home; `hold` stops smoothly at once and stays until `release`;
            `show` goes somewhere as slowly as home, and stays until `reset`.
        there_rad: J positions [rad] to `show`.
    """

    kind: Literal["enable", "disable", "reset", "hold", "release", "show"]
    there_rad: Joints = ()


@dataclass(frozen=True, eq=False)
class RetargetingState:
    """Where the robot is commanded to be, why, and what has happened so far.

    Attributes:
        mode: What it is doing ...
        since_ns: ... and since when.
        held: Whether the operator holds the robot.
        shown_rad: J positions to which the operator has sent it to show its hand; None for nowhere.
        motion: The newest command with its acceleration; None before the first measurement.
        commanded_ns: When that command was sent; None before the first.
        started_ns: When the first command was sent since the robot was last given free.
        pending: With `execution_delay_s`: times [ns] and positions of the commands that are not yet carried out, and of
            the one that was carried out last, oldest first.
        plan: The newest usable motion; None when there is nothing to follow.
        had_plan: Whether there was one at the command before.
        pursuit: The way onto the plan; None unless following, and where it ramps in again.
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
        sight: What is known of the person from all poses before that one ...
        crowd: ... and everyone's segments in the newest of those.
        evidence: For a recognised interaction lately, from 0 to 1 ...
        evidence_ns: ... by the motion that came then; None before the first.
        doubt: Where the hand that is raised has gone where no greeting goes; "" if it has not.
        start_refusal: Why the robot does not start for a hand that is raised; "" when it does.
        touch: How far the hands have been brought together; None when they are not.
        place_m: Where the person is taken to stand, if the camera's pose is unknown.
        near_m: Distance of the nearest person to the arm at the newest command [m].
        relaxed: From 0 to 1 how much of a learned partner's posture is given up, since it led too near to a person.
        no_contact: Why hands are not brought together; "" when they may be.
        met: Whether the hand that is held out has been met.
        unmet: Why a hand that is held out is not met, a key of `unmet.TEXTS`; "" when it is, or none is held out ...
        unmet_ns: ... and since when, or since when none has been said; 0 for a hand that need not be met.
        crowded: Whether a bystander is within the arm's reach, or near it.
        paused_ns: When a bystander last held the arm back; None if never.
        yielding: Whether the arm gives way to a person ...
        refuge: ... and where to, if one walks ...
        gave_way: ... or has done so and is not at home since.
        counts: Events by reason since the start.
        outcome: What became of the newest input: a key of `counts`.
        detail: Why that input was not used, for people; "" when it was.
    """

    mode: Mode = Mode.WAITING
    since_ns: int = 0
    held: bool = False
    shown_rad: Joints | None = None
    motion: JointMotion | None = None
    commanded_ns: int | None = None
    started_ns: int = 0
    pending: tuple[tuple[int, Joints], ...] = ()
    plan: Plan | None = None
    had_plan: bool = False
    pursuit: RampIn | None = None
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
    sight: HumanTrack | None = None
    crowd: Crowd | None = None
    evidence: float = 0.0
    evidence_ns: int | None = None
    doubt: str = ""
    start_refusal: str = ""
    touch: ContactState | None = None
    place_m: Point | None = None
    near_m: float = math.inf
    relaxed: float = 0.0
    no_contact: str = ""
    met: bool = False
    unmet: str = ""
    unmet_ns: int = 0
    crowded: bool = False
    paused_ns: int | None = None
    yielding: bool = False
    refuge: Refuge | None = None
    gave_way: bool = False
    counts: Mapping[str, int] = field(default_factory=dict)
    outcome: str = ""
    detail: str = ""

    @property
    def named(self) -> bool:
        """Whether it is known what the plan is about; else a hand is offered, not yet known for what."""
        return self.plan is None or bool(self.plan.interaction)

    def with_sight(self, now_ns: int) -> RetargetingState:
        """The newest pose taken into account, if it came before now.

        A pose that came at this very time has to wait for the next command: over DDS it may come before or after the
        motion of the same skeleton, and both orders shall lead to the same commands.
        """
        if self.person is None or self.person_ns == now_ns:
            return self
        sight = seen_again(self.sight, self.person, self.person_ns)
        return replace(self, person=None, sight=sight, crowd=Crowd.of(self.person))

    def notices(self, now_ns: int) -> tuple[str, ...]:
        """What an operator should know of people, each a sentence."""
        found = [self.no_contact] if self.no_contact else []
        if self.unmet and self.unmet != NO_TOUCH:
            found.append(f"hand not met: {TEXTS[self.unmet]}")
        if self.paused_ns is not None and (now_ns - self.paused_ns) * 1e-9 < PAUSED_S:
            found.append("paused: a bystander is within reach")
        elif self.crowded:
            found.append("slowed: a bystander is within reach")
        return tuple(found)

    def with_pending(self, position_rad: Joints, delay_s: float, now_ns: int) -> RetargetingState:
        """One more command that is carried out `delay_s` from now."""
        carried_out_ns = now_ns - round(delay_s * 1e9)
        earlier = [entry for entry in self.pending if entry[0] < now_ns]
        first = max((index for index, (at_ns, _) in enumerate(earlier) if at_ns <= carried_out_ns), default=0)
        return replace(self, pending=(*earlier[first:], (now_ns, position_rad)))

    def carried_out(self, motion: JointMotion, delay_s: float, now_ns: int) -> Joints:
        """Where the robot has been sent by now, of the newest command `motion`: J positions [rad]."""
        due = [position for at_ns, position in self.pending if at_ns <= now_ns - round(delay_s * 1e9)]
        if due:
            return due[-1]
        return self.pending[0][1] if self.pending else motion.position_rad

    def counted(self, reason: str) -> RetargetingState:
        """One more event of `reason`."""
        return replace(self, counts=self._one_more(reason))

    def ended(self, outcome: str, detail: str = "") -> RetargetingState:
        """One more input that ended in `outcome`."""
        return replace(self, counts=self._one_more(outcome), outcome=outcome, detail=detail)

    def _one_more(self, reason: str) -> dict[str, int]:
        return {**self.counts, reason: self.counts.get(reason, 0) + 1}

# SPDX-License-Identifier: Apache-2.0
"""Where the robot is, by messages that are doubted: merged by joint name, bounded by what a joint can do.

A driver may send arm and gripper, or each joint, in messages of their own. Joints that are not ours never count. Of
each message of which a joint of ours is used, the outcome is one of

    measured            every joint was heard lately: the pose is known
    joints_missing      one of them was not
    other_joints        the message names none of ours
    late_joints         its stamp is older than what is known
    outside_limits      a joint stands outside its limits
    not_finite          a joint's position is NaN or infinite
    doubted             a joint would have moved faster than it can

What is doubted is believed once it has been said consistently for `BELIEVE_AFTER_S` and nothing else was: the robot
really is elsewhere, after a restart of its driver for example. What is doubted again and again while the rest goes on
comes from two publishers that disagree.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mild_core.errors import DataError
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import JointMeasurement

HAND_FACTOR = 2.0
"""A person can move a compliant joint faster than its motor: recordings hold up to 1.8 times the motor's limit."""

SLACK_S = 0.04
"""Messages may come closer together than they were measured: late ones arrive in a batch."""

MARGIN_RAD = 0.05
"""Noise and backlash, whatever the time between two messages."""

LATE_S = 1.0
"""A stamp older than the newest by no more than this belongs to a late message; by more, to another clock."""

BELIEVE_AFTER_S = 0.5
BELIEVE_TIMES = 3
"""Messages that have to agree before an impossible step is believed, beside the time."""

DISAGREE_COUNT = 3
DISAGREE_WITHIN_S = 5.0
"""So many doubted messages within so long are no glitch. Source: `joint_state_publisher` sends at 10 Hz or less."""


OUTCOMES = ("measured", "joints_missing", "other_joints", "late_joints", "outside_limits", "doubted")
"""Of a message of joints only; `not_finite` may be of another message too."""


class Heard(NamedTuple):
    """One joint in one message: position [rad], the message's stamp and when it came [ns]."""

    position_rad: float
    stamp_ns: int
    received_ns: int


class UnconfirmedPosition(NamedTuple):
    """A position that is not believed yet: the newest, since when it has been said [ns], and how often."""

    heard: Heard
    since_ns: int
    times: int


@dataclass(frozen=True)
class JointTracks:
    """What is known of J joints.

    Attributes:
        believed: The newest believed position of each; None before the first. Empty before the first message.
        doubts: A newer position of each that is not believed; None where there is none.
        doubted_ns: When the newest `DISAGREE_COUNT` doubted messages came, oldest first.
        outcome: Of the newest message.
        detail: Why that message was not used, for people; "" when it was.
    """

    believed: tuple[Heard | None, ...] = ()
    doubts: tuple[UnconfirmedPosition | None, ...] = ()
    doubted_ns: tuple[int, ...] = ()
    outcome: str = ""
    detail: str = ""

    def disagree(self, now_ns: int) -> bool:
        """Whether messages contradict each other, so that the robot's position is unknown."""
        doubted = self.doubted_ns
        return len(doubted) == DISAGREE_COUNT and (now_ns - doubted[0]) * 1e-9 <= DISAGREE_WITHIN_S

    @property
    def newest_ns(self) -> int:
        """When the newest message came that was believed or doubted; 0 before the first."""
        return max([*self.doubted_ns, *(heard.received_ns for heard in self.believed if heard is not None)], default=0)

    @property
    def oldest_ns(self) -> int:
        """When the joint came of which nothing newer is known."""
        return min(heard.received_ns for heard in self.believed if heard is not None)

    @property
    def positions_rad(self) -> FloatArray:
        """(J,) the merged pose [rad]; means something after the outcome `measured`."""
        return read_only(np.array([np.nan if heard is None else heard.position_rad for heard in self.believed]))


@dataclass(frozen=True)
class JointMerger:
    """Merges messages into the pose of J joints.

    Attributes:
        joint_names: J names.
        velocity_rad_s: (J,) largest speeds of their motors.
        lower_rad: (J,) smallest positions to accept; empty for any.
        upper_rad: (J,) largest ones; empty for any.
        complete_within_s: The pose is known when every joint was heard within this time.
    """

    joint_names: tuple[str, ...]
    velocity_rad_s: tuple[float, ...]
    lower_rad: tuple[float, ...] = ()
    upper_rad: tuple[float, ...] = ()
    complete_within_s: float = 0.5
    _places: dict[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_places", {name: place for place, name in enumerate(self.joint_names)})

    def take(self, tracks: JointTracks, given: JointMeasurement, now_ns: int) -> JointTracks:
        """The tracks after a message that came at `now_ns`; its outcome is in them."""
        known = [heard.received_ns for heard in tracks.believed if heard is not None]
        if not known or now_ns < max(known):  # the first, or the clock went back: a bag that starts again
            tracks = JointTracks((None,) * len(self.joint_names), (None,) * len(self.joint_names))
        try:
            ours = self._selected(given, now_ns)
        except DataError as error:
            return replace(tracks, outcome=error.reason, detail=error.detail)
        before = [(heard, tracks.believed[place]) for place, heard in ours]
        far = [place for place, heard in ours if not self._can_be(place, tracks.believed[place], heard)]
        if far and not self._convinced(tracks, far, ours, now_ns):
            return self._doubted(tracks, ours, far[0])
        if not far and any(old is not None and 0 < old.stamp_ns - new.stamp_ns <= LATE_S * 1e9 for new, old in before):
            return replace(tracks, outcome="late_joints", detail="its stamp is older than the one before")
        # Meanwhile the joint may have had the time to get there: no contradiction is left.
        settled = bool(far) or any(self._agrees(tracks.doubts[place], place, heard) for place, heard in ours)
        believed, doubts = list(tracks.believed), list(tracks.doubts)
        for place, heard in ours:
            believed[place], doubts[place] = heard, None
        missing = self._missing(believed, now_ns)
        outcome = "joints_missing" if missing else "measured" if ours else "other_joints"
        detail = f"nothing lately of {', '.join(missing)}" if missing else ""
        return JointTracks(tuple(believed), tuple(doubts), () if settled else tracks.doubted_ns, outcome, detail)

    def _selected(self, given: JointMeasurement, now_ns: int) -> list[tuple[int, Heard]]:
        """Our joints of a message, by place.

        Raises:
            DataError: One of ours is not finite, outside its limits or there twice.
        """
        positions, found = given.positions_rad.tolist(), dict[int, Heard]()
        for name, position in zip(given.joint_names, positions, strict=True):
            place = self._places.get(name)
            if place is None:
                continue
            if place in found:
                raise DataError("wrong_layout", f"joint {name} is in it twice")
            if not abs(position) < np.inf:
                raise DataError("not_finite", f"the position of {name}")
            if self.lower_rad and not self.lower_rad[place] <= position <= self.upper_rad[place]:
                raise DataError("outside_limits", f"{name} at {position:.3f} rad")
            found[place] = Heard(position, given.stamp_ns, now_ns)
        return list(found.items())

    def _can_be(self, place: int, before: Heard | None, heard: Heard) -> bool:
        """Whether a joint can have come from where it was to where it is said to be."""
        if before is None:
            return True
        elapsed_s = max(heard.received_ns - before.received_ns, 0) * 1e-9
        reach = HAND_FACTOR * self.velocity_rad_s[place] * (elapsed_s + SLACK_S) + MARGIN_RAD
        return abs(heard.position_rad - before.position_rad) <= reach

    def _convinced(self, tracks: JointTracks, far: list[int], ours: list[tuple[int, Heard]], now_ns: int) -> bool:
        """Whether an impossible step has been confirmed for long enough by every message since."""
        newest = dict(ours)
        for place in far:
            doubt = tracks.doubts[place]
            if doubt is None or not self._agrees(doubt, place, newest[place]):
                return False
            if (now_ns - doubt.since_ns) * 1e-9 < BELIEVE_AFTER_S:
                return False
        return True

    def _agrees(self, doubt: UnconfirmedPosition | None, place: int, heard: Heard) -> bool:
        """Whether a position confirms one that was doubted, and every message since the first of those did."""
        return doubt is not None and doubt.times >= BELIEVE_TIMES and self._can_be(place, doubt.heard, heard)

    def _doubted(self, tracks: JointTracks, ours: list[tuple[int, Heard]], far: int) -> JointTracks:
        """The tracks after a message that is not believed: nothing of it is."""
        doubts, said = list(tracks.doubts), dict(ours)
        for place, heard in ours:
            doubt = doubts[place]
            if doubt is None or not self._can_be(place, doubt.heard, heard):
                doubts[place] = UnconfirmedPosition(heard, heard.received_ns, 1)
            else:
                doubts[place] = UnconfirmedPosition(heard, doubt.since_ns, doubt.times + 1)
        doubted_ns = (*tracks.doubted_ns, said[far].received_ns)[-DISAGREE_COUNT:]
        before = tracks.believed[far]
        step = 0.0 if before is None else said[far].position_rad - before.position_rad
        detail = f"{self.joint_names[far]} cannot have moved by {step:.3f} rad since the message before"
        return replace(tracks, doubts=tuple(doubts), doubted_ns=doubted_ns, outcome="doubted", detail=detail)

    def _missing(self, believed: list[Heard | None], now_ns: int) -> list[str]:
        longest_ns = self.complete_within_s * 1e9
        both = zip(self.joint_names, believed, strict=True)
        return [name for name, heard in both if heard is None or now_ns - heard.received_ns > longest_ns]

# SPDX-License-Identifier: Apache-2.0
"""The watched person as retargeting remembers them: where they stand, where the hand goes, whether it is raised."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mild_core.errors import DataError
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import ARM_FRAME, ROBOT_FRAME, UNKNOWN_DIRECTION, PersonPose

POSITION_GAIN = 0.75
VELOCITY_GAIN = POSITION_GAIN**2 / (2.0 - POSITION_GAIN)
"""Of the tracking filter: a hand that speeds up is followed within two frames, and of a tracker's jitter of 5 mm at
30 Hz 7 cm/s are left. Source: T. Benedict, G. Bordner, IRE Transactions on Automatic Control 1962."""

LOST_S, GONE_S = 0.3, 2.0
"""After a longer time without the hand its speed, or even whose it is and where it rests, is not known any more."""

NOISE_SHARE = 0.1
"""Share that is new at each message in the tracker's noise."""

MOVED_DEVIATIONS = 4.0
"""A hand seen so many standard deviations of that noise from its mean place has moved; one in a thousand has not."""

MEAN_S, SURE_MEANS = 0.4, 3
"""A hand that does not move is where it was on the mean of so long, if it was seen so often; else where it was last."""

LONGEST_GUESS_S = 0.15
"""A hand goes on at its speed for no longer than this: then it may have turned."""

WITHDRAWING_S = 0.15
"""Look-ahead for deciding whether the hand is being withdrawn [s]."""

OFFERED = 0.7
"""A hand is offered while it is at least this share of the way from its rest that it has come at most."""

SHIFT_M_S = 0.3
"""No faster is the person taken to move when another interaction is recognised while the robot is near them."""

RAISED_M, BACK_M, STILL_M = 0.08, 0.15, 0.05
"""The hand is raised this far from its rest, and back when this near to it; less than the last it has not moved."""

BACK_SHARE = 0.5
"""It is back only after this much of the way: a hand that is raised slowly has not come back."""

BACK_AFTER_S = 0.5
"""How long a hand has to stay near its rest to be back."""

Point = tuple[float, float, float]


@dataclass(frozen=True)
class AssumedPlacement:
    """Where a person's calibrated shoulder stands in the robot's base frame, if the camera's pose is unknown.

    Attributes:
        place_m: One place for all interactions.
        yaw_rad: Which way the person faces: the direction of their x axis.
        by_interaction: Own places of interactions.
        contact: Interactions in which hands touch; None for those that have places of their own.
    """

    place_m: Point
    yaw_rad: float
    by_interaction: Mapping[str, Point] = field(default_factory=dict)
    contact: tuple[str, ...] | None = None

    @property
    def touching(self) -> tuple[str, ...]:
        """Interactions in which hands touch."""
        return tuple(self.by_interaction) if self.contact is None else self.contact

    def place(self, interaction: str, before_m: Point | None, most_m: float) -> Point:
        """Where the person stands in an interaction, at most so far from where they stood before.

        Recognition may change its mind; people do not jump.
        """
        wanted = self.by_interaction.get(interaction, self.place_m)
        if before_m is None or (way_m := math.dist(wanted, before_m)) <= most_m:
            return wanted
        share = most_m / way_m
        x, y, z = (start + share * (end - start) for start, end in zip(before_m, wanted, strict=True))
        return x, y, z

    def others(self, place_m: Point) -> tuple[Point, ...]:
        """All other places where the model's people stand: an interaction may be recognised late, or be another."""
        return tuple(dict.fromkeys(each for each in self.by_interaction.values() if each != place_m))

    def placed(self, points_m: FloatArray, frame_id: str, place_m: Point) -> FloatArray:
        """(..., 3) points of `frame_id` in the robot's base frame, for a person who stands at `place_m`."""
        if frame_id == ROBOT_FRAME:
            return points_m
        x, y, z = place_m
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        placed: FloatArray = points_m @ turn + np.array([x, y, z])
        return placed


@dataclass(frozen=True, eq=False)
class HumanTrack:
    """What is known of the person, in the frame of the message.

    Attributes:
        frame_id: That frame.
        received_ns: When the newest pose came.
        hand_ns: Stamp of the newest pose with a hand.
        hand_m: (3,) the hand then.
        velocity_m_s: (3,) its velocity.
        rest_m: (3,) where the hand rests.
        raised: Whether it has left that place ...
        raised_ns: ... and since when.
        farthest_m: How far from there it has come since it was raised.
        still_m: (3,) where it last was still ...
        still_ns: ... and since when it has been near that place.
        seen_m: (2, 3) where the tracker put it in the newest two messages.
        noise_m: Standard deviation of each coordinate of what the tracker says, as seen while the hand rested.
        mean_m: (3,) mean of where it was seen since it has not moved, as far as the noise lets one know ...
        means: ... and of how many messages; 0 while it moves.
    """

    frame_id: str
    received_ns: int
    hand_ns: int
    hand_m: FloatArray
    velocity_m_s: FloatArray
    rest_m: FloatArray
    raised: bool
    raised_ns: int
    farthest_m: float
    still_m: FloatArray
    still_ns: int
    seen_m: FloatArray = field(default_factory=lambda: read_only(np.full((2, 3), np.nan)))
    noise_m: float = 0.0
    mean_m: FloatArray = field(default_factory=lambda: UNKNOWN_DIRECTION)
    means: int = 0

    def hand_at(self, time_ns: int) -> FloatArray:
        """(3,) the hand at a time that is not long after it was seen."""
        ahead_s = min(max((time_ns - self.hand_ns) * 1e-9, 0.0), LONGEST_GUESS_S)
        guessed: FloatArray = self.hand_m + ahead_s * self.velocity_m_s
        return guessed

    def still_s(self) -> float:
        """How long the hand has stayed where it is."""
        return (self.hand_ns - self.still_ns) * 1e-9

    def at_rest_here(self) -> HumanTrack:
        """The same person, who rests the hand where it is now."""
        return replace(self, rest_m=self.hand_m, raised=False, farthest_m=0.0)

    def offered(self) -> bool:
        """Whether the hand is held out, and not on its way back, where it would soon be held out no more."""
        soon_m = self.hand_m + WITHDRAWING_S * self.velocity_m_s
        return self.raised and math.dist(soon_m, self.rest_m) >= OFFERED * self.farthest_m

    def after(self, pose: PersonPose, received_ns: int) -> HumanTrack:
        """With one more pose of the same person; what it hides stays where it was."""
        if not np.isfinite(pose.hand_m).all():
            return replace(self, received_ns=received_ns)
        elapsed_s = (pose.stamp_ns - self.hand_ns) * 1e-9
        if elapsed_s > LOST_S:
            hand, velocity = pose.hand_m, np.zeros(3)
        else:
            guessed = self.hand_m + elapsed_s * self.velocity_m_s
            error = pose.hand_m - guessed
            hand = guessed + POSITION_GAIN * error
            velocity = self.velocity_m_s + VELOCITY_GAIN / elapsed_s * error
        mean, means = self._mean_with(pose.hand_m, elapsed_s)
        if means > 1:
            share = min(1.0, (means - 1) / SURE_MEANS)
            hand, velocity = hand + share * (mean - hand), (1.0 - share) * velocity
        moved = math.dist(hand, self.still_m) > STILL_M
        seen = replace(
            self,
            received_ns=received_ns,
            hand_ns=pose.stamp_ns,
            hand_m=hand,
            velocity_m_s=velocity,
            seen_m=np.stack([self.seen_m[1], pose.hand_m]),
            noise_m=self._noise_with(pose.hand_m),
            mean_m=mean,
            means=means,
            still_m=hand if moved else self.still_m,
            still_ns=pose.stamp_ns if moved else self.still_ns,
        )
        return seen._with_rest()

    def _noise_with(self, seen_m: FloatArray) -> float:
        """The tracker's noise after one more message: second differences of white noise have six times its variance."""
        jerked = seen_m - 2.0 * self.seen_m[1] + self.seen_m[0]
        if self.raised or not np.isfinite(jerked).all():
            return self.noise_m
        return math.sqrt(self.noise_m**2 + NOISE_SHARE * (float(jerked @ jerked) / 18.0 - self.noise_m**2))

    def _mean_with(self, seen_m: FloatArray, elapsed_s: float) -> tuple[FloatArray, int]:
        """Mean of where the hand is seen while it does not move, and of how many messages."""
        if not self.means or math.dist(seen_m, self.mean_m) > MOVED_DEVIATIONS * self.noise_m:
            return seen_m, 1
        means = min(self.means + 1, max(round(MEAN_S / max(elapsed_s, 1e-3)), 2))
        return self.mean_m + (seen_m - self.mean_m) / means, means

    def _with_rest(self) -> HumanTrack:
        """Whether the hand is raised now."""
        away_m = math.dist(self.hand_m, self.rest_m)
        if not self.raised:
            if away_m <= RAISED_M:
                return self
            return replace(self, raised=True, raised_ns=self.received_ns, farthest_m=away_m)
        if away_m < min(BACK_M, BACK_SHARE * self.farthest_m) and self.still_s() >= BACK_AFTER_S:
            return self.at_rest_here()
        return replace(self, farthest_m=away_m) if away_m > self.farthest_m else self


def first_sight(pose: PersonPose, received_ns: int) -> HumanTrack | None:
    """What is known after the first pose with a hand, which is taken to rest; None when it shows none."""
    if not np.isfinite(pose.hand_m).all():
        return None
    hand, still, stamp_ns = pose.hand_m, np.zeros(3), pose.stamp_ns
    return HumanTrack(pose.frame_id, received_ns, stamp_ns, hand, still, hand, False, 0, 0.0, hand, stamp_ns)


def seen_again(sight: HumanTrack | None, pose: PersonPose, received_ns: int) -> HumanTrack | None:
    """What is known after one more pose, of the same person or, in another frame or at another time, a new one.

    A pose without a tracked person says nothing of them: they may be back in the next.
    """
    if not pose.watched:
        return sight
    if sight is None or pose.frame_id != sight.frame_id or not 0 < pose.stamp_ns - sight.hand_ns < GONE_S * 1e9:
        return first_sight(pose, received_ns)
    return sight.after(pose, received_ns)


def check_pose(pose: PersonPose) -> None:
    """Raise DataError `unknown_frame` or `not_finite` unless a pose can be used; NaN stands for what was not seen.

    Args:
        pose: From perception or from another machine: nothing in it is trusted.
    """
    if pose.frame_id not in (ARM_FRAME, ROBOT_FRAME):
        raise DataError("unknown_frame", f"a person in '{pose.frame_id}'")
    if any(np.isinf(part).any() for part in (pose.hand_m, pose.head_m, pose.trunk_m, pose.facing)):
        raise DataError("not_finite", "a part of the person is infinitely far away")
    segments = pose.segments
    if not all(np.isfinite(each).all() for each in (segments.ends_m, segments.velocities_m_s, segments.radii_m)):
        raise DataError("not_finite", "a segment of a body is nowhere")
    if (segments.radii_m < 0.0).any():
        raise DataError("not_finite", "a segment of a body has a negative radius")

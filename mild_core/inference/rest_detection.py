# SPDX-License-Identifier: Apache-2.0
"""When the state is reset: people rest before and between interactions, for any time, and that is no step.

Recurrent state was trained on trials that start a few seconds before the motion; after a minute of rest it would be
far from every state in training. So while the arm rests where it was first seen, memory moves on for as long as
people rested in the recordings, and no longer; and when the arm has come back to rest, the state is reset.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mild_core.shapes import FloatArray

MOVED_M = 0.05
"""A motion starts when the hand is this far from where it rested [m]; measured on the recordings."""

STILL_M = 0.03
"""A hand that stays within so much of a place is still."""

BACK_M = 0.2
"""A still hand this near to where it rested before is back at rest, and touches no one."""

STILL_S = 5.0
"""How long it has to be still. In recordings the robot takes up to four seconds more to come back, or stays away."""


@dataclass(frozen=True, eq=False)
class Rest:
    """Where the hand rested and what it has done since.

    Attributes:
        place_m: (3,) where it was first seen.
        frames: Frames since then.
        moved: Whether it has left that place.
        still_m: (3,) where it last became still.
        still_frames: Frames since then.
    """

    place_m: FloatArray
    frames: int
    moved: bool
    still_m: FloatArray
    still_frames: int


def first_seen(hand_m: FloatArray) -> Rest:
    """A hand that nothing is known of but its last frames (T, 3)."""
    rest = Rest(hand_m[0], 0, False, hand_m[0], 0)
    for place_m in hand_m[1:]:
        rest = watch(rest, place_m, 1)
    return rest


def watch(rest: Rest, hand_m: FloatArray, passed: int) -> Rest:
    """Take the hand's place (3,), `passed` frames after the last one."""
    rest = replace(rest, frames=rest.frames + passed, still_frames=rest.still_frames + passed)
    if float(np.linalg.norm(hand_m - rest.place_m)) > MOVED_M:
        rest = replace(rest, moved=True)
    if float(np.linalg.norm(hand_m - rest.still_m)) > STILL_M:
        rest = replace(rest, still_m=hand_m, still_frames=0)
    return rest


def rests(rest: Rest | None, hand_m: FloatArray) -> float:
    """How much a hand at (3,) still rests where it was first seen: 1 there, 0 for good once it has moved."""
    return 0.0 if rest is None or rest.moved else max(0.0, 1.0 - float(np.linalg.norm(hand_m - rest.place_m)) / MOVED_M)


def is_waiting(rest: Rest, rest_frames: int) -> bool:
    """Whether the hand has rested for longer than it ever did before a motion."""
    return not rest.moved and rest.frames > rest_frames


def is_back(rest: Rest, still_frames: int) -> bool:
    """Whether the hand has moved and come back to rest."""
    back = float(np.linalg.norm(rest.still_m - rest.place_m)) <= BACK_M
    return rest.moved and back and rest.still_frames >= still_frames

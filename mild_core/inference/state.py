# SPDX-License-Identifier: Apache-2.0
"""All that inference remembers, as a value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from mild_core.errors import DataError
from mild_core.inference.gesture_recogniser import GestureState
from mild_core.inference.member import MemberState
from mild_core.inference.recognition import Recognition
from mild_core.inference.rest_detection import Rest
from mild_core.joint_measurements import JointTracks
from mild_core.shapes import FloatArray


@dataclass(frozen=True, eq=False)
class CopyState:
    """One of the S copies of what remembers; they take turns.

    Attributes:
        index: Number of the window that it saw last; -1 before the first.
        members: By interaction that may be the one, one per member of the model.
    """

    index: int
    members: tuple[tuple[MemberState, ...], ...]


@dataclass(frozen=True, eq=False)
class InferenceState:
    """All that inference remembers.

    Attributes:
        counts: Windows by outcome, and events, since the start.
        outcome: Of the newest window; "" before the first.
        detail: Why that window was not used, for people; "" when it was.
        stamp_ns: Of the newest accepted window; None before the first.
        index: Its number since the start or the last reset.
        copies: S of them.
        recognition: Which interaction it is.
        novelty: See `NoveltyDetector.follow`; (0,) in a model without one.
        units: (R,) of the reservoir; None before the first window, and in a model without one.
        rest: Where the hand rested; None before the first window.
        published: What the newest motion says of the interaction; None before the first.
        named: Whether that motion names it.
        gestures: Of the recogniser of gestures; None in a model without one.
        joints: The robot's own word on where it is.
        start: (J,) where the robot stood when the person came [rad]; None: it has not said.
    """

    recognition: Recognition
    copies: tuple[CopyState, ...]
    novelty: FloatArray
    units: FloatArray | None = None
    rest: Rest | None = None
    published: Recognition | None = None
    named: bool = False
    gestures: GestureState | None = None
    joints: JointTracks = field(default_factory=JointTracks)
    start: FloatArray | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    outcome: str = ""
    detail: str = ""
    stamp_ns: int | None = None
    index: int = -1

    def counted(self, events: Mapping[str, int]) -> dict[str, int]:
        """The counts with what happened added."""
        counts = dict(self.counts)
        for name, number in events.items():
            counts[name] = counts.get(name, 0) + number
        return counts

    def refused(self, error: DataError) -> InferenceState:
        """The state after an input that cannot be used."""
        return replace(self, counts=self.counted({error.reason: 1}), outcome=error.reason, detail=error.detail)

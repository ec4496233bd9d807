# SPDX-License-Identifier: Apache-2.0
"""A person before a tracker, and all that a tracker may make of them: pure functions of frames and time.

A fault takes what the tracker would say (one frame of one person) and the time since the fault began [s], and
gives the messages that it says instead: none, one or several, each with any number of people.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mild_core.signals import SkeletonFrame
from mild_ros.simulation.person import BODY_JOINTS, bodies, skeleton_frames
from tools.scenes import SCENES, Scene, arm_track

People = tuple[SkeletonFrame, ...]
"""Everyone in one message."""

TrackerFault = Callable[[SkeletonFrame, float], tuple[People, ...]]
"""The messages in place of a frame, this long [s] after the fault began."""

TRACKER_HZ = 30.0

HANDSHAKE = SCENES[1]

_OTHER_SIDE = {name: name.replace("left_", "right_", 1) for name in BODY_JOINTS if name.startswith("left_")}
_OTHER_SIDE |= {other: name for name, other in _OTHER_SIDE.items()}
BYSTANDER = 7
"""The tracker's number for another person."""


class SimulatedPerson:
    """Stands still, raises the hand, and shakes hands without end.

    Args:
        scene: Whose first pose is a rest, and whose swings lead back to where they began.
    """

    STILL_S = 1.5
    """Before the hand is raised: a second to be calibrated in, and some."""

    def __init__(self, scene: Scene = HANDSHAKE) -> None:
        ends_s = np.cumsum([2.6, *(pose.after_s for pose in scene.poses)])
        self._begin_s = float(ends_s[0]) - self.STILL_S
        self._again_s, self._end_s = float(ends_s[3]), float(ends_s[-2])
        self._frames = list(skeleton_frames(bodies(arm_track(scene, TRACKER_HZ)), TRACKER_HZ, 0))
        self._start_ns: int | None = None

    def restart(self) -> None:
        """With the next frame, stand still with the hand down."""
        self._start_ns = None

    def seen(self, now_ns: int) -> SkeletonFrame:
        """What a good tracker says of them now."""
        if self._start_ns is None:
            self._start_ns = now_ns
        time_s = self._begin_s + (now_ns - self._start_ns) * 1e-9
        if time_s > self._end_s:
            time_s = self._again_s + (time_s - self._again_s) % (self._end_s - self._again_s)
        return replace(self._frames[round(time_s * TRACKER_HZ)], stamp_ns=now_ns)


def as_it_is(frame: SkeletonFrame, _: float) -> tuple[People, ...]:
    """No fault."""
    return ((frame,),)


def silent(_frame: SkeletonFrame, _: float) -> tuple[People, ...]:
    """Nothing comes."""
    return ()


def no_person(_frame: SkeletonFrame, _: float) -> tuple[People, ...]:
    """Messages come, without a person in them."""
    return ((),)


def pausing(on_s: float, off_s: float) -> TrackerFault:
    """Nothing comes for `off_s`, then all is well for `on_s`, and so on."""

    def fault(frame: SkeletonFrame, since_s: float) -> tuple[People, ...]:
        return () if since_s % (off_s + on_s) < off_s else ((frame,),)

    return fault


def repeated(times: int) -> TrackerFault:
    """Every message comes several times."""

    def fault(frame: SkeletonFrame, _: float) -> tuple[People, ...]:
        return ((frame,),) * times

    return fault


class Frozen:
    """The tracker hangs: what it saw when the fault began comes again and again under new stamps."""

    def __init__(self) -> None:
        self._seen: SkeletonFrame | None = None
        self._since_s = 0.0

    def __call__(self, frame: SkeletonFrame, since_s: float) -> tuple[People, ...]:
        """The people that are seen."""
        if self._seen is None or since_s < self._since_s:
            self._seen = frame
        self._since_s = since_s
        return ((replace(self._seen, stamp_ns=frame.stamp_ns),),)


def shifted(shift_s: float) -> TrackerFault:
    """The tracker's clock is wrong."""

    def fault(frame: SkeletonFrame, _: float) -> tuple[People, ...]:
        return ((replace(frame, stamp_ns=frame.stamp_ns + round(shift_s * 1e9)),),)

    return fault


def with_late_copies(late_s: float) -> TrackerFault:
    """After every message comes one that is older."""

    def fault(frame: SkeletonFrame, _: float) -> tuple[People, ...]:
        return (frame,), (replace(frame, stamp_ns=frame.stamp_ns - round(late_s * 1e9)),)

    return fault


def renumbered(frame: SkeletonFrame, _: float) -> tuple[People, ...]:
    """A second person comes by, and the tracker swaps the two numbers."""
    other = replace(_moved(frame, (1.2, 0.0, 0.6)), person_id=frame.person_id)
    return ((other, replace(frame, person_id=BYSTANDER)),)


def another_person(frame: SkeletonFrame, _: float) -> tuple[People, ...]:
    """The person is gone, and another person moves in the same way elsewhere."""
    return ((replace(_moved(frame, (1.2, 0.0, 0.6)), person_id=BYSTANDER),),)


def without(joint: str) -> TrackerFault:
    """A joint is not in the message."""

    def fault(frame: SkeletonFrame, _: float) -> tuple[People, ...]:
        kept = [place for place, name in enumerate(frame.joint_names) if name != joint]
        names = tuple(frame.joint_names[place] for place in kept)
        positions, confidence = frame.positions_m[kept], frame.confidence[kept]
        return ((replace(frame, joint_names=names, positions_m=positions, confidence=confidence),),)

    return fault


def placed_at(joint: str, value: float) -> TrackerFault:
    """All three coordinates [m] of a joint are `value`."""

    def fault(frame: SkeletonFrame, _: float) -> tuple[People, ...]:
        positions = np.array(frame.positions_m)
        positions[frame.joint_names.index(joint)] = value
        return ((replace(frame, positions_m=positions),),)

    return fault


def turned(rows: tuple[tuple[float, float, float], ...]) -> TrackerFault:
    """All positions are multiplied by a matrix: mirrored, in other axes or in other units."""
    matrix = np.array(rows)

    def fault(frame: SkeletonFrame, _: float) -> tuple[People, ...]:
        return ((replace(frame, positions_m=frame.positions_m @ matrix.T),),)

    return fault


def left_is_right(frame: SkeletonFrame, _: float) -> tuple[People, ...]:
    """Names of the joints of left and right are swapped."""
    return ((replace(frame, joint_names=tuple(_OTHER_SIDE.get(name, name) for name in frame.joint_names)),),)


def in_frame(frame_id: str) -> TrackerFault:
    """Messages say that they are in another tf frame."""

    def fault(frame: SkeletonFrame, _: float) -> tuple[People, ...]:
        return ((replace(frame, frame_id=frame_id),),)

    return fault


def _moved(frame: SkeletonFrame, by_m: tuple[float, float, float]) -> SkeletonFrame:
    return replace(frame, positions_m=frame.positions_m + np.array(by_m))

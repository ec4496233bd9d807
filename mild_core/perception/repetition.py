# SPDX-License-Identifier: Apache-2.0
"""Whether a tracker measures a body or only repeats it: no living person's joints are equal to the bit for long.

A hung driver sends its newest skeleton under new stamps, and some trackers keep a body whose person has left, or the
last place of a joint that they lost. Trackers that publish more often than they measure repeat a frame too, but never
for so long.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from mild_core.perception.joint_validity import Body, usable

FORGOTTEN_NS = 1_000_000_000
"""A body that was not seen for so long is another one when it comes back."""

Joints = tuple[tuple[float, ...], ...]


class Run(NamedTuple):
    """Joints that are equal in every message from one stamp to another [ns]."""

    joints: Joints
    since_ns: int
    newest_ns: int

    def after(self, joints: Joints, stamp_ns: int) -> Run:
        """The run that these joints go on with, or a new one."""
        same = joints == self.joints and stamp_ns >= self.newest_ns
        return Run(joints, self.since_ns if same else stamp_ns, stamp_ns)

    def lasts(self, longest_ns: int) -> bool:
        """Whether it has gone on for longer than this. Joints that are not seen repeat nothing."""
        return bool(self.joints) and self.newest_ns - self.since_ns > longest_ns


class Repetition(NamedTuple):
    """Runs of all believed joints of a body, and of those of its watched arm."""

    body: Run
    arm: Run


Repetitions = Mapping[int, Repetition]
"""By the tracker's number for the person."""


def repeated(
    before: Repetitions, bodies: Iterable[Body], arm_names: Sequence[str], min_confidence: float
) -> Repetitions:
    """What repeats itself after a message with these bodies.

    Args:
        before: Before that message.
        bodies: Everyone in it.
        arm_names: Joints of the watched arm.
        min_confidence: Least confidence of a joint that is used.
    """
    after: dict[int, Repetition] = {}
    for body in bodies:
        stamp_ns, number = body.frame.stamp_ns, body.frame.person_id
        both = zip(body.points, body.confidence, strict=True)
        seen = [tuple(point) if sure >= min_confidence and usable(point) else () for point, sure in both]
        places = [body.places[name] for name in arm_names if name in body.places]
        joints = tuple([point for point in seen if point])
        arm = tuple([seen[place] for place in places if seen[place]])
        old = before.get(number)
        if old is None:
            after[number] = Repetition(Run(joints, stamp_ns, stamp_ns), Run(arm, stamp_ns, stamp_ns))
        else:
            after[number] = Repetition(old.body.after(joints, stamp_ns), old.arm.after(arm, stamp_ns))
    newest_ns = max([one.body.newest_ns for one in after.values()], default=0)
    for number, old in before.items():
        if number not in after and newest_ns - old.body.newest_ns <= FORGOTTEN_NS:
            after[number] = old
    return after

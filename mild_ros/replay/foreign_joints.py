# SPDX-License-Identifier: Apache-2.0
"""Whether a bag's joint states are of our robot, or of another one."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import islice

from mild_core.errors import DataError
from mild_ros.bag.reader import BagReader

LOOKED_AT = 20
"""Messages of which one names all joints of the robot, if it is there: drivers publish a gripper by itself."""


def foreign_joints(bag: BagReader, wanted: Sequence[str]) -> str:
    """Which joints the bag's joint_states name, for people, if those wanted are not among them; otherwise ""."""
    named: list[set[str]] = []
    for raw in islice(bag.messages(["/joint_states"]), LOOKED_AT):
        with suppress(DataError):
            named.append(set(map(str, bag.decode(raw).name)))
    if not named or any(names.issuperset(wanted) for names in named):
        return ""
    first, *others = sorted(set().union(*named)) or ["no names"]
    return f"{first} and {len(others)} others" if others else first

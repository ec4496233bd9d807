# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1, converted before they are read."""

from __future__ import annotations

from pathlib import Path

from rosbags.convert import convert
from rosbags.highlevel import AnyReader
from rosbags.typesys.store import Typestore

from mild_core.errors import BagError
from mild_ros.bag_budgets import Account, OverBudgetError, check_scratch

SUFFIX = ".bag"

CHECK_BYTES = 1 << 24
"""As in `salvage.py`."""


def as_rosbag2(path: Path, scratch: Path, types: Typestore) -> tuple[Path, str]:
    """Convert a .bag file into one of ROS 2 in the empty folder `scratch`.

    Args:
        path: The bag.
        scratch: Gets the converted one.
        types: Of ROS 2; messages of other types are left out.

    Returns:
        The converted bag, and what was left out ("" for nothing).

    Raises:
        BagError: It cannot be read, or holds nothing that ROS 2 knows.
    """
    target = scratch / "converted"
    try:
        with AnyReader([path]) as reader:
            counts = {connection.msgtype: 0 for connection in reader.connections}
            for connection in reader.connections:
                counts[connection.msgtype] += connection.msgcount
            _check_size(reader, scratch, path)
        known = sorted(name for name in counts if name in types.fielddefs)
        if known:
            convert([path], target, "mcap", 9, None, "none", None, types, (), (), (), known)
    except OverBudgetError:
        raise
    except Exception as error:  # the readers raise many classes on foreign bytes
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        problem = f"cannot be read as a bag of ROS 1 ({reason})"
        raise BagError(str(path), problem, "mend it with `rosbag reindex` of ROS 1, or record it again") from None
    unknown = {name: count for name, count in counts.items() if name not in known}
    if not known:
        raise BagError(str(path), "holds no message of a type that ROS 2 knows", "choose another bag")
    told = ", ".join(f"{count} of {name}" for name, count in unknown.items())
    return target, f"left out, as ROS 2 has no such type: {told}" if unknown else ""


def _check_size(reader: AnyReader, scratch: Path, path: Path) -> None:
    """Read everything once before it is written: an index may name the same message again and again.

    Raises:
        OverBudgetError: It would be too much.
    """
    size, unpacked, checked = path.stat().st_size, 0, 0
    for _, _, data in reader.messages():
        unpacked += len(data)
        if unpacked >= checked + CHECK_BYTES:
            checked = unpacked
            check_scratch(scratch, unpacked, size)
    Account.of(path).use()  # what was read counts once

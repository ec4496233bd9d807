# SPDX-License-Identifier: Apache-2.0
"""Faults of a bag, reported before anything else is loaded."""

from __future__ import annotations

from pathlib import Path

from mild_core.errors import BagError
from mild_core.perception.skeletons import SkeletonSource
from mild_ros.bag.people import source_fault
from mild_ros.bag.reader import open_bag
from mild_ros.command_line.console import Console


def report_lost(bag: Path, salvage: bool, console: Console) -> None:
    """Say what of a bag could not be read, if anything.

    Raises:
        BagError: Nothing can.
    """
    with open_bag(bag, salvage=salvage) as opened:
        if opened.lost:
            console.print(f"{bag}: {opened.lost}", style="yellow", highlight=False, soft_wrap=True)


def check_source(bag: Path, salvage: bool, source: SkeletonSource, topic: str = "") -> None:
    """Reject a bag in which this source shows no person before anything is done with it.

    Raises:
        BagError: As the live check of the source says it.
    """
    with open_bag(bag, salvage=salvage) as opened:
        fault, remedy = source_fault(opened, source, topic)
    if fault:
        raise BagError(str(bag), f"shows no person to {source.name}: {fault}", remedy)

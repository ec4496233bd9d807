# SPDX-License-Identifier: Apache-2.0
"""What of a bag cannot be read, told before anything else is loaded."""

from __future__ import annotations

from pathlib import Path

from mild_ros.bags import open_bag
from mild_ros.command_line.console import Console


def tell_lost(bag: Path, salvage: bool, console: Console) -> None:
    """Say what of a bag could not be read, if anything.

    Raises:
        BagError: Nothing can.
    """
    with open_bag(bag, salvage=salvage) as opened:
        if opened.lost:
            console.print(f"{bag}: {opened.lost}", style="yellow", highlight=False, soft_wrap=True)

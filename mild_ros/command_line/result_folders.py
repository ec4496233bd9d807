# SPDX-License-Identifier: Apache-2.0
"""Where results go when no place was given: a folder for each bag, and never another bag's."""

from __future__ import annotations

from itertools import count
from pathlib import Path

OF = "bag.txt"
"""In a folder of results: the bag that they are of."""


def folder_of(parent: Path, bag: Path) -> Path:
    """A folder in `parent` by the bag's name; beside that of another bag of this name, with a number.

    The results of the same bag before lie there, and are replaced. It is made, and says whose it is.
    """
    bag = bag.resolve()
    name = bag.stem if bag.is_file() else bag.name
    numbered = (parent / (name if number == 1 else f"{name}_{number}") for number in count(1))
    folder = next(place for place in numbered if not place.exists() or _is_of(place, bag))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / OF).write_text(f"{bag}\n", errors="surrogateescape")
    return folder


def _is_of(folder: Path, bag: Path) -> bool:
    marker = folder / OF
    return marker.is_file() and marker.read_text(errors="surrogateescape") == f"{bag}\n"

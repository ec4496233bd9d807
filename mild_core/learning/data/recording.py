# SPDX-License-Identifier: Apache-2.0
"""What is known of a published recording before it is read, and what comes of reading it."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from mild_core.errors import unknown_name
from mild_core.inference.manifest import HumanPlacement
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.units import ANGLES, POSITIONS, Unit
from mild_core.learning.data.windows import Protocol

SPLITS = ("train", "test")
CHUNK_BYTES = 1 << 16


@dataclass(frozen=True)
class Demonstrations:
    """The trials of a recording as its publishers split them; either part may be empty."""

    train: tuple[Demonstration, ...]
    test: tuple[Demonstration, ...]

    def split(self, name: str) -> tuple[Demonstration, ...]:
        """The trials of split `name`.

        Raises:
            SetupError: `name` is not one of `SPLITS`.
        """
        if name not in SPLITS:
            raise unknown_name("split", name, SPLITS)
        return self.train if name == "train" else self.test


@dataclass(frozen=True)
class Download:
    """A file as its publisher offers it.

    Attributes:
        url: Of one revision, so that it stays what it is.
        sha256: Of its content, hexadecimal; "" where only `git_blob` is known.
        size_bytes: Of its content; None where it is not known.
        git_blob: Name of its content in its publisher's git repository, a SHA-1.
    """

    url: str
    sha256: str = ""
    size_bytes: int | None = None
    git_blob: str = ""

    def is_content_of(self, path: Path) -> bool:
        """Whether a file holds what its publisher offers.

        Source of `git_blob`: Pro Git, "Git Objects": the SHA-1 of "blob", the content's size, NUL and the content.
        """
        wanted = self.sha256 or self.git_blob
        hashed = hashlib.sha256() if self.sha256 else hashlib.sha1(f"blob {path.stat().st_size}\0".encode())
        with path.open("rb") as file:
            while chunk := file.read(CHUNK_BYTES):
                hashed.update(chunk)
        return hashed.hexdigest() == wanted


@dataclass(frozen=True)
class Recording:
    """One published recording, or a folder of trials (`trials.recording_of`).

    Attributes:
        name: Its name in `DATASETS`.
        title: For people.
        file: Where it lies below the data folder.
        rate_hz: Frames per second.
        interactions: Their names, in the order of its labels.
        touching: Those in which hands meet, which shows where the person stood; none where no robot was there.
        observed_names: Observed joints, from the shoulder outwards.
        observed_side: "right" or "left" arm of the person.
        robot: Name in `retargeting.robots.ROBOTS`, or of a robot file; "" when the controlled agent is a second person.
        controlled_names: Controlled joints in the order of the recorded columns.
        licence: What is known of it, for people.
        spdx: The same as an SPDX expression; `NOASSERTION` where its publisher states none.
        source: Who recorded it and where it is published.
        read: From the file to demonstrations; raises DatasetError.
        protocols: How it is cut, by name: figures compare only within one of them.
        placement: Where the person stood before the robot, if the recording says so; None has it fitted to `touching`.
        download: Where its file can be fetched; None where its publisher offers no single file.
    """

    name: str
    title: str
    file: str
    rate_hz: float
    interactions: tuple[str, ...]
    touching: tuple[str, ...]
    observed_names: tuple[str, ...]
    observed_side: str
    robot: str
    controlled_names: tuple[str, ...]
    licence: str
    source: str
    read: Callable[[Path], Demonstrations]
    protocols: Mapping[str, Protocol]
    placement: HumanPlacement | None = None
    spdx: str = "NOASSERTION"
    download: Download | None = None

    @property
    def unit(self) -> Unit:
        """Of the controlled agent's motion, and so of errors."""
        return ANGLES if self.robot else POSITIONS

    @property
    def known_as(self) -> str:
        """What `datasets.recording_named` finds it by: its name, or the path of a folder of trials."""
        return self.file if Path(self.file).is_absolute() else self.name

    def default_path(self) -> Path:
        """Where it lies, or would be put: below the folder of recordings, or beside a checkout if it is there."""
        beside = Path(__file__).parents[3] / ".." / "shared" / "data" / self.file
        if not os.environ.get("MILD_DATA") and beside.exists() and not Path(self.file).is_absolute():
            return Path(os.path.relpath(beside))
        return data_folder() / self.file


def data_folder() -> Path:
    """Where recordings lie: $MILD_DATA, or the user's data folder.

    Source of the latter: XDG Base Directory Specification.
    """
    if given := os.environ.get("MILD_DATA"):
        return Path(given).expanduser()
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "mild_ros" / "data"

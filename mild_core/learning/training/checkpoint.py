# SPDX-License-Identifier: Apache-2.0
"""Snapshots on disk: an interrupted training goes on from its last whole epoch.

A file holds tensors and a few words about them and can run nothing. It is written beside and then moved, so that it is
whole or absent whatever happens.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from mild_core.errors import SetupError
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol
from mild_core.learning.training.settings import TrainingSettings
from mild_core.learning.training.snapshot import Snapshot

FOLDER = "training"
LARGEST_BYTES = 256 << 20


def identity(
    demonstrations: Sequence[Demonstration],
    protocol: Protocol,
    settings: TrainingSettings,
    seed: int,
    start: Mapping[str, NDArray[Any]] | None = None,
) -> str:
    """A digest of all that `train` takes: what is interrupted may only be gone on with by the same."""
    digest = hashlib.sha256(repr((protocol, settings, seed, torch.__version__)).encode())
    for trial in demonstrations:
        digest.update(repr((trial.trial, trial.interaction, trial.rate_hz, trial.observed_m.shape)).encode())
        digest.update(trial.observed_m.tobytes() + trial.controlled.tobytes())
    for name, array in sorted((start or {}).items()):
        digest.update(name.encode() + array.tobytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Checkpoint:
    """The newest snapshots of one training, a file per member.

    Attributes:
        folder: Where they are.
        identity: Of that training, see `identity`.
    """

    folder: Path
    identity: str

    def write(self, member: int, snapshot: Snapshot) -> None:
        """Take the place of that member's last snapshot.

        Raises:
            OSError: The disk is full or read-only.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        tensors = {name: value.detach().contiguous() for name, value in snapshot.tensors.items()}
        about = {"identity": self.identity, "epochs": str(snapshot.epochs), "steps": str(snapshot.steps)}
        beside = self.folder / "unfinished"
        try:
            save_file(tensors, beside, about)
        except SafetensorError as error:
            with suppress(OSError):
                beside.unlink()
            raise SetupError(str(beside), f"cannot be written ({error})", "make room on the disk") from None
        os.replace(beside, self._file(member))

    def read(self, members: int) -> tuple[Snapshot, ...]:
        """The snapshots that there are, of the first members.

        Raises:
            SetupError: One is broken or of another training.
        """
        count = next((n for n in range(members) if not self._file(n).is_file()), members)
        return tuple(self._read(self._file(member)) for member in range(count))

    def remove(self) -> None:
        """What was interrupted is done, or was nothing."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _file(self, member: int) -> Path:
        return self.folder / f"member_{member}.safetensors"

    def _read(self, path: Path) -> Snapshot:
        remedy = f"delete {self.folder} to start over, or give another --out"
        if path.stat().st_size > LARGEST_BYTES:
            raise SetupError(str(path), f"is larger than {LARGEST_BYTES >> 20} MB", remedy)
        try:
            with safe_open(path, framework="pt") as file:
                about = file.metadata() or {}
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  # it is no mapping
            epochs, steps = int(about.get("epochs", "")), int(about.get("steps", ""))
        except (SafetensorError, ValueError) as error:
            raise SetupError(str(path), f"cannot be read ({error})", remedy) from None
        if about.get("identity") != self.identity:
            raise SetupError(str(path), "is of another training: other trials, settings, seed or torch", remedy)
        return Snapshot(epochs, steps, tensors)

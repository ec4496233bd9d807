# SPDX-License-Identifier: Apache-2.0
"""A person's calibration in a file, so that a node that starts again needs no neutral second."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

from mild_core.budgets import parse_json, read_file
from mild_core.errors import SetupError
from mild_core.perception.calibration import Calibration, calibration_from_mapping

if TYPE_CHECKING:
    from mild_ros.node_kit.diagnostics import Diagnostics

LARGEST_BYTES = 10_000
"""A calibration takes some 500 bytes."""


class CalibrationFile:
    """Where calibrations are kept.

    Args:
        name: Path of the file, which need not exist; "" keeps none.

    Raises:
        SetupError: Its folder does not exist.
    """

    def __init__(self, name: str) -> None:
        self._path = Path(name).expanduser() if name else None
        self._kept: Calibration | None = None
        if self._path is not None and not self._path.parent.is_dir():
            raise SetupError("parameter calibration_file", f"{self._path.parent} is no folder", "make it first")

    def read(self) -> Calibration | None:
        """The calibration in the file; None when there is no file yet.

        Raises:
            SetupError: What is there is no calibration.
        """
        if self._path is None or not self._path.exists():
            return None
        try:
            content = read_file(self._path, LARGEST_BYTES)
            self._kept = calibration_from_mapping(parse_json(content))
        except (ValueError, SetupError) as error:
            why = error.problem if isinstance(error, SetupError) else str(error)
            raise SetupError(f"calibration_file {self._path}", why, "remove it and calibrate again") from None
        return self._kept

    def keep(self, calibration: Calibration | None, diagnostics: Diagnostics) -> None:
        """Write a new calibration: whole or not at all, as a reader sees it. A full disk is a warning."""
        if self._path is None or calibration is None or calibration is self._kept:
            return
        self._kept = calibration
        scratch = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        try:
            scratch.write_text(json.dumps(calibration.as_mapping(), indent=2) + "\n")
            scratch.replace(self._path)
        except OSError as error:
            scratch.unlink(missing_ok=True)
            diagnostics.complain("calibration_file", f"cannot be written ({error.strerror})")

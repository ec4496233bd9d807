# SPDX-License-Identifier: Apache-2.0
"""A folder for temporary files that only this user can write to."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from mild_core.errors import SetupError


def private_folder() -> Path:
    """The folder.

    Raises:
        SetupError: It belongs to another user.
    """
    folder = Path(tempfile.gettempdir(), f"mild_ros-{os.getuid()}")
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise SetupError(str(folder), "can be written by other users", "remove it, or set TMPDIR")
    return folder

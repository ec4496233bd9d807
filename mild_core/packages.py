# SPDX-License-Identifier: Apache-2.0
"""Files of installed packages by `package://<package>/<path>`, as descriptions of robots name them."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from mild_core.errors import SetupError

PACKAGE = "package://"
"""Before the name of a package and a path in it."""


def package_file(name: str) -> Path:
    """A file of an installed package, by `package://<package>/<path>`: of a ROS workspace, or of a Python wheel.

    Raises:
        SetupError: There is no such package, or no such file in it.
    """
    package, _, rest = name.removeprefix(PACKAGE).partition("/")
    if not package or ".." in (package, *Path(rest).parts):
        raise SetupError(name, "names no file of a package", f"write {PACKAGE}<package>/<path>")
    places = [Path(prefix, "share", package) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if prefix]
    places += [Path(folder, "cmeel.prefix", "share", package) for folder in sys.path]
    for place in places:
        if (place / rest).is_file():
            return place / rest
    there = next((place for place in places if place.is_dir()), None)
    if there is not None:
        raise SetupError(name, f"{there} has no file '{rest}'", "check the path in the package")
    raise SetupError(name, f"package '{package}' is not installed", f"pip install {package}, or source its workspace")

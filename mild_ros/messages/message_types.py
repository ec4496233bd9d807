# SPDX-License-Identifier: Apache-2.0
"""Classes of messages by the names of their types, which come from bags and from the network.

A name chooses a module to import, so a name is only followed where the ament index lists its package as one of
interfaces, and only to the files of that installation: never to a module that happens to lie in the current folder or
elsewhere on Python's path.
"""

from __future__ import annotations

import importlib
import os
import re
import sys
from functools import cache
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from mild_core.errors import SetupError

PACKAGED = {"tf2_msgs", "hri_msgs", "zed_msgs"}
"""Packages of messages that apt has but not every ROS installation; `yolo_msgs` has to be built."""

INDEX = Path("share", "ament_index", "resource_index", "rosidl_interfaces")
"""Where the ament index of an installation lists packages of messages and services."""

_TYPE_NAME = re.compile(r"([a-z][a-z0-9_]*)/(msg|srv)/([A-Z]\w*)", re.ASCII)


def interface_class(type_name: str) -> Any | None:
    """The class of e.g. `sensor_msgs/msg/JointState` or `std_srvs/srv/SetBool`; None when it is not installed here."""
    parts = _TYPE_NAME.fullmatch(type_name)
    if parts is None or not _is_installed(parts[1]):
        return None
    try:
        return getattr(importlib.import_module(f"{parts[1]}.{parts[2]}"), parts[3], None)
    except ImportError:
        return None


def message_class(type_name: str) -> Any | None:
    """As `interface_class`, of messages only: a topic has no services."""
    return interface_class(type_name) if "/msg/" in type_name else None


def required_message_class(type_name: str) -> type[Any]:
    """The class of a message type that is needed, e.g. of `geometry_msgs/msg/PoseArray`.

    Raises:
        SetupError: Its package is not installed.
    """
    found = message_class(type_name)
    if found is None:
        package = type_name.split("/")[0]
        remedy = f"apt install ros-jazzy-{package.replace('_', '-')}"
        if package not in PACKAGED:
            remedy = f"build {package} in your workspace and source it"
        raise SetupError(type_name, f"the package {package} is not installed", remedy)
    assert isinstance(found, type)
    return found


def _is_installed(package: str) -> bool:
    """Whether the ament index lists this package of interfaces and Python would take it from that installation."""
    return _is_listed(package, os.environ.get("AMENT_PREFIX_PATH", ""), tuple(sys.path))


@cache
def _is_listed(package: str, prefix_path: str, _places: tuple[str, ...]) -> bool:
    """As `_is_installed`, for one state of the environment and of Python's path."""
    # A relative prefix would be one of the current folder. The wheels of ROS do not set the variable.
    prefixes = [*prefix_path.split(os.pathsep), sys.prefix]
    listing = [prefix for prefix in prefixes if os.path.isabs(prefix) and (Path(prefix) / INDEX / package).is_file()]
    spec = PathFinder.find_spec(package) if listing else None
    folders = list(spec.submodule_search_locations or ()) if spec else []
    return bool(folders) and all(
        any(_is_within(os.path.dirname(folder), prefix) for prefix in listing) for folder in folders
    )


def _is_within(folder: str, prefix: str) -> bool:
    """Whether a folder of packages belongs to an installation; files in it may be links, as colcon makes them."""
    root = os.path.realpath(prefix)
    return os.path.commonpath([root, os.path.realpath(folder)]) == root

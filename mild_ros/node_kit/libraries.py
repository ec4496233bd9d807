# SPDX-License-Identifier: Apache-2.0
"""Libraries of others that the shell needs, and what to do where one is missing or broken."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

from mild_core.errors import SetupError

NEEDED = (
    "numpy",
    "numba",
    "pinocchio",
    "ruckig",
    "pybullet",
    "rosbags",
    "safetensors",
    "viser",
    "yourdfpy",
    "matplotlib",
)
"""What nodes, replay and pictures import."""

OURS = ("mild_core", "mild_ros", "test")

OF_ROS = ("rclpy", "ament_index_python", "builtin_interfaces", "rcl_interfaces")
"""Packages of ROS 2 beside those of messages and services."""

OF_LEARNING = ("torch", "scipy")
"""What training imports; the extra `learning` of this package installs it."""

REMEDY = "remove .venv and run ./mild doctor; with pip: install mild_ros again; with apt: docs/deployment.md"


def unusable(error: ImportError) -> SetupError:
    """What to do about a library that cannot be imported; raises `error` again when the fault is in our own code."""
    package = (error.name or "").split(".")[0]
    if package in OF_ROS or package.endswith(("_msgs", "_srvs")):
        remedy = "source a ROS 2 Jazzy, or run ./mild in a checkout, which brings one"
        return SetupError("ROS 2", f"is not installed here (no {package}), and this needs it", remedy)
    if package in ("", *OURS):
        raise error
    remedy = "pip install '.[learning]' in the folder of mild_ros" if package in OF_LEARNING else REMEDY
    return SetupError(f"library {package}", f"cannot be imported ({str(error).splitlines()[0]})", remedy)


def check_needed() -> None:
    """Look for every library that a node imports, without importing it.

    Raises:
        ImportError: One is missing, and which.
    """
    import_module("rclpy")
    for name in NEEDED:
        if find_spec(name) is None:
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)

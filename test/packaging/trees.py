# SPDX-License-Identifier: Apache-2.0
"""Copies of the checkout to build from, so that a test leaves nothing in the checkout itself."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from test.habits.tree import ROOT, files


def copy_of_checkout(folder: Path) -> Path:
    """What is committed, or could be, in a new folder."""
    for path in files(ROOT):
        target = folder / path.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, target)
    return folder


def venv_beside_ours(folder: Path) -> Path:
    """A new venv that also sees all that is installed in ours, but not the checkout, which ours has by a link."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    (site,) = folder.glob("lib/python3*/site-packages")
    (ours,) = Path(sys.prefix).glob("lib/python3*/site-packages")
    (site / "ours.pth").write_text(f"{ours}\n")
    return folder


OF_ROS = re.compile(r"_?ros_|ros2|rcl|rmw|rpy|ament|rosidl|.*_(msgs|interfaces|srvs)$|.*_(msgs|interfaces|srvs)-")
"""Names of what the wheels of ROS 2 install; `rosbags` is none of them."""


def venv_without_ros(folder: Path) -> Path:
    """A new venv that sees all that is installed in ours but ROS 2 and the checkout."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    (site,) = folder.glob("lib/python3*/site-packages")
    (ours,) = Path(sys.prefix).glob("lib/python3*/site-packages")
    for path in ours.iterdir():
        if not OF_ROS.match(path.name) and "mild_ros" not in path.name and path.suffix != ".pth":
            (site / path.name).symlink_to(path)
    shutil.copy(ours / "cmeel.pth", site)  # where pinocchio lies
    return folder


def run(command: list[str], folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run to the end, without our own package in reach of Python or ROS."""
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "AMENT_PREFIX_PATH")}
    environment.update(variables)
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=240
    )

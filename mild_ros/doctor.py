# SPDX-License-Identifier: Apache-2.0
"""What has to be right on a machine before nodes of ours can talk, each looked at by trying it."""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from mild_core.errors import MildError
from mild_core.inference.model import load_model
from mild_ros.processes import DOMAINS, PYTHON
from mild_ros.share import model_folder, model_names
from mild_ros.simulation.quiet import quiet_terminal

PYTHONS = ((3, 11), (3, 12))
LEAST_SHARED_MEMORY_MB = 16
"""Fast DDS takes some MB per process and falls back to UDP without; below this it fails now and then."""

DISCOVERY_PATIENCE_S = 20.0
MACHINES_PATIENCE_S = 30.0

REPORT_PATIENCE_S = 3.0
"""Nodes report once a second; discovery takes its time."""


@dataclass(frozen=True)
class Finding:
    """What one look has shown.

    Attributes:
        subject: What was looked at.
        well: Whether it is as it should be.
        seen: What was seen.
        remedy: What to do where it is not well.
    """

    subject: str
    well: bool
    seen: str
    remedy: str = ""


def python() -> Finding:
    """The Python that runs."""
    version = sys.version_info[:2]
    seen = f"{version[0]}.{version[1]} in {sys.prefix}"
    return Finding("Python", version in PYTHONS, seen, "use 3.11 or 3.12: MILD_PYTHON=python3.12 ./mild doctor")


def libraries() -> Finding:
    """Everything that the nodes import."""
    missing = []
    for name in ("rclpy", "numpy", "numba", "ruckig", "pybullet", "rosbags", "safetensors", "viser", "matplotlib"):
        try:
            with quiet_terminal():  # pybullet tells when it was built
                import_module(name)
        except ImportError as error:
            missing.append(f"{name} ({error})")
    seen = "all import" if not missing else f"missing: {', '.join(missing)}"
    return Finding("Libraries", not missing, seen, "remove .venv and run ./mild doctor again; with apt: rosdep install")


def distribution() -> Finding:
    """Which ROS 2 the environment says it is, and whether two of them are mixed."""
    name = os.environ.get("ROS_DISTRO", "jazzy")
    prefixes = [path for path in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if path]
    mixed = any(path.startswith("/opt/ros/") for path in prefixes) and sys.prefix in prefixes
    seen = f"{name}, {len(prefixes)} prefix(es)" + (", two installations mixed" if mixed else "")
    return Finding("ROS 2", name == "jazzy" and not mixed, seen, "use a terminal that has not sourced another ROS")


def domain() -> Finding:
    """Who may hear us."""
    given = os.environ.get("ROS_DOMAIN_ID", "0")
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    well = given.isdigit() and (int(given) == 0 or int(given) in DOMAINS)
    seen = f"{given}, discovery range {reach}"
    return Finding("ROS_DOMAIN_ID", well, seen, f"choose one from 0 to {DOMAINS[-1]}, the same on every machine")


def shared_memory() -> Finding:
    """Room for messages between processes of one machine."""
    place = Path("/dev/shm")
    if not os.access(place, os.W_OK):
        return Finding("Shared memory", False, f"{place} cannot be written", "mount it, in a container with --ipc=host")
    free_mb = shutil.disk_usage(place).free // 1_000_000
    seen = f"{free_mb} MB free in {place}"
    remedy = f"remove fastrtps_* of ended programs from {place}, or give it more room"
    return Finding("Shared memory", free_mb >= LEAST_SHARED_MEMORY_MB, seen, remedy)


def log_folder() -> Finding:
    """Where rclpy writes its logs: without it, it does not start."""
    place = Path(os.environ.get("ROS_LOG_DIR") or Path(os.environ.get("ROS_HOME") or Path.home() / ".ros", "log"))
    try:
        place.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        return Finding("Log folder", False, f"{place}: {error.strerror}", "set ROS_LOG_DIR to where you may write")
    return Finding("Log folder", True, str(place))


def discovery() -> Finding:
    """Whether two processes hear each other over DDS."""
    names = (f"one_{os.getpid()}", f"two_{os.getpid()}")
    ends = _heard(*(("hello", own, DISCOVERY_PATIENCE_S, other) for own, other in (names, names[::-1])))
    deaf = [said for said, other in zip(ends, reversed(names), strict=True) if other not in said]
    said = deaf[0] if deaf and isinstance(deaf[0], str) else f"nothing heard in {DISCOVERY_PATIENCE_S:.0f} s"
    remedy = "allow multicast on lo (ip link set lo multicast on), or set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST"
    return Finding("Discovery", not deaf, said if deaf else "two processes hear each other", remedy)


def other_machines() -> Finding:
    """Whether a doctor on another machine is heard; only when it is asked for."""
    (names,) = _heard(("hello", platform.node(), MACHINES_PATIENCE_S))
    if isinstance(names, str):
        return Finding("Other machines", False, names, "see docs/troubleshooting.md")
    seen = f"{platform.node()} hears {', '.join(names)}" if names else f"none heard in {MACHINES_PATIENCE_S:.0f} s"
    remedy = (
        "run it on both at once; the same ROS_DOMAIN_ID, range SUBNET and multicast on both,"
        " or ROS_STATIC_PEERS with the other's address; a firewall must let UDP 7400 and up pass"
    )
    return Finding("Other machines", bool(names), seen, remedy)


def running_nodes() -> Finding:
    """What the nodes of this domain say of themselves: rates, frames and all else that is wrong."""
    (found,) = _heard(("reports", REPORT_PATIENCE_S))
    if not isinstance(found, dict):
        return Finding("Running nodes", False, str(found), "see docs/troubleshooting.md")
    if not found:
        where = os.environ.get("ROS_DOMAIN_ID", "0")
        return Finding("Running nodes", True, f"none reports in domain {where}")
    told = {}
    for name, report in found.items():
        rates = {key: value for key, value in report["values"].items() if key.endswith(" rate [Hz]")}
        flowing = ", ".join(f"{key.removesuffix(' rate [Hz]')} {value} Hz" for key, value in rates.items())
        told[name] = f"{name}: {report['message']}" + (f" ({flowing})" if flowing else "")
    unwell = [told[name] for name, report in found.items() if report["level"]]
    return Finding("Running nodes", not unwell, "; ".join(unwell or told.values()), "see docs/troubleshooting.md")


def _heard(*questions: tuple[object, ...]) -> list[Any]:
    """The answers of `mild_ros.hearing`, asked all at once; of one that failed, the last line that it said."""
    command = [*PYTHON, "-m", "mild_ros.hearing"]
    asked = [
        subprocess.Popen([*command, *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for words in questions
    ]
    ends = [(process.communicate(), process.returncode) for process in asked]
    return [
        json.loads(out) if code == 0 else ([*error.strip().splitlines(), ""])[-2:][0] or f"ended with code {code}"
        for (out, error), code in ends
    ]


def models() -> Finding:
    """Whether every model that came with the package answers as it did when it was trained."""
    names, faults = model_names(), []
    for name in names:
        try:
            load_model(model_folder(name))
        except MildError as error:
            faults.append(str(error))
    seen = "; ".join(faults) if faults else f"{', '.join(names)}: golden samples answered alike"
    return Finding("Models", bool(names) and not faults, seen, "restore the folder models from the repository")


EXAMINATIONS: tuple[Callable[[], Finding], ...] = (
    *(python, libraries, distribution, domain, shared_memory, log_folder, discovery, running_nodes, models),
)


def examinations(*, machines: bool = False) -> tuple[Callable[[], Finding], ...]:
    """What is looked at; with `machines` also for a doctor on another one."""
    return (*EXAMINATIONS, other_machines) if machines else EXAMINATIONS

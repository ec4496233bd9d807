# SPDX-License-Identifier: Apache-2.0
"""What has to be right on a machine before nodes of ours can talk, each looked at by trying it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from mild_core.errors import MildError
from mild_core.inference.model import load_model
from mild_ros.processes import DOMAINS
from mild_ros.share import model_folder, model_names
from mild_ros.simulation.quiet import quiet_terminal

PYTHONS = ((3, 11), (3, 12))
LEAST_SHARED_MEMORY_MB = 16
"""Fast DDS takes some MB per process and falls back to UDP without; below this it fails now and then."""

DISCOVERY_PATIENCE_S = 20.0

HEAR_EACH_OTHER = """
import sys, time, rclpy
from std_msgs.msg import String
rclpy.init(args=[])
node = rclpy.create_node("doctor_" + sys.argv[1])
heard = []
node.create_subscription(String, "mild_doctor_" + sys.argv[2], heard.append, 10)
sender = node.create_publisher(String, "mild_doctor_" + sys.argv[1], 10)
end = time.monotonic() + float(sys.argv[3])
after = 0
while time.monotonic() < end and after < 20:
    sender.publish(String(data="hello"))
    rclpy.spin_once(node, timeout_sec=0.05)
    after += bool(heard)
rclpy.try_shutdown()
sys.exit(0 if heard else 1)
"""
"""A program that says hello until it has heard the other one, and a little longer for the other one's sake."""


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
    command = [sys.executable, "-c", HEAR_EACH_OTHER]
    pairs = (("one", "two"), ("two", "one"))
    patience = str(DISCOVERY_PATIENCE_S)
    talkers = [subprocess.Popen([*command, *pair, patience], stderr=subprocess.PIPE) for pair in pairs]
    ends = [(talker.communicate()[1], talker.returncode) for talker in talkers]
    failures = [text.decode(errors="replace").strip().splitlines() for text, code in ends if code]
    said = next((lines[-1] for lines in failures if lines), f"nothing heard in {DISCOVERY_PATIENCE_S:.0f} s")
    remedy = "allow multicast on lo (ip link set lo multicast on), or set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST"
    return Finding("Discovery", not failures, said if failures else "two processes hear each other", remedy)


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
    *(python, libraries, distribution, domain, shared_memory, log_folder, discovery, models),
)


def examine() -> Iterator[Finding]:
    """Look at one thing after the other."""
    for examination in EXAMINATIONS:
        yield examination()

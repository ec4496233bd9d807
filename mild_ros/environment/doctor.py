# SPDX-License-Identifier: Apache-2.0
"""What has to be right on a machine before nodes of ours can talk, each looked at by trying it."""

from __future__ import annotations

import fcntl
import json
import os
import platform
import pwd
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from mild_core.errors import MildError
from mild_core.resources import load_model, model_names, share_folder
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.environment.processes import DOMAINS, PYTHON, shared_memory_owners
from mild_ros.node_kit.dds_variables import (
    DOMAINS_TEXT,
    HARMLESS,
    LAST_DOMAIN,
    PAIRED,
    UNNAMED,
    given,
    problems,
    profiles_here,
)
from mild_ros.node_kit.libraries import NEEDED, REMEDY
from mild_ros.simulation.quiet import quiet_terminal

SEE = "see docs/troubleshooting.md"
SAME = "as for Discovery"

PYTHONS = ((3, 11), (3, 12))
LEAST_SHARED_MEMORY_MB = 16
"""Fast DDS takes some MB per process and falls back to UDP without; below this it fails now and then."""

DISCOVERY_PATIENCE_S = 20.0
AGAIN_PATIENCE_S = 12.0
"""For two processes to hear each other without a variable that may have kept them apart."""

MACHINES_PATIENCE_S = 30.0

SENDERS_PATIENCE_S = 6.0
"""Of which discovery takes up to two; the slowest tracker sends five times a second."""

HANGING_S = 20.0
"""A process that looks for others ends this much later than it was asked to, at the latest."""

_GET_FLAGS, _IS_UP = 0x8913, 0x1
"""SIOCGIFFLAGS and IFF_UP of netdevice(7)."""

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
    ros = ("rclpy",) if has_ros() else ()  # where there is none, `distribution` says so
    for name in (*ros, *NEEDED):
        try:
            with quiet_terminal():  # pybullet prints when it was built
                import_module(name)
        except ImportError as error:
            missing.append(f"{name} ({error})")
    seen = "all import" if not missing else f"missing: {', '.join(missing)}"
    return Finding("Libraries", not missing, seen, REMEDY)


def has_ros() -> bool:
    """Whether a ROS 2 is installed here."""
    return find_spec("rclpy") is not None


def distribution() -> Finding:
    """Which ROS 2 the environment says it is, and whether two of them are mixed."""
    if not has_ros():
        seen = "not installed here: models, replay in process, view, train and evaluate work without; nodes do not"
        return Finding("ROS 2", False, seen, "source a ROS 2 Jazzy, or run ./mild in a checkout, which brings one")
    name = os.environ.get("ROS_DISTRO", "jazzy")
    prefixes = [path for path in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if path]
    mixed = any(path.startswith("/opt/ros/") for path in prefixes) and sys.prefix in prefixes
    seen = f"{name}, {len(prefixes)} prefix(es)" + (", two installations mixed" if mixed else "")
    return Finding("ROS 2", name == "jazzy" and not mixed, seen, "use a terminal that has not sourced another ROS")


def domain() -> Finding:
    """Who may hear us."""
    given = os.environ.get("ROS_DOMAIN_ID") or "0"
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"
    well = given.isdecimal() and int(given) <= LAST_DOMAIN
    seen = f"{given}, discovery range {reach}"
    if well and int(given) > DOMAINS[-1]:
        seen += f"; above {DOMAINS[-1]} other programs may take its ports"
    return Finding("ROS_DOMAIN_ID", well, seen, f"set it to {DOMAINS_TEXT}, the same on every machine")


def shared_memory() -> Finding:
    """Room for messages between processes of one machine."""
    place = Path("/dev/shm")
    if not os.access(place, os.W_OK):
        remedy = f"as root: mount -t tmpfs tmpfs {place}; a container: start it with --ipc=host or --shm-size=64m"
        return Finding("Shared memory", False, f"{place} cannot be written", remedy)
    free_mb = shutil.disk_usage(place).free // 1_000_000
    seen = f"{free_mb} MB free in {place}"
    remedy = (
        f"when no node runs: rm {place}/fastrtps_*; or give it more room, as root: mount -o remount,size=64M {place};"
        " a container: --shm-size=64m"
    )
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


def environment() -> Finding:
    """DDS settings in the environment, variable by variable."""
    wrong = problems()
    found_settings = [f"{name}={value} ({wrong.get(name) or variable.does})" for name, value, variable in given()]
    found_settings += [f"{name} in this folder (settings of Fast DDS)" for name in profiles_here()]
    seen = "; ".join(found_settings) or "nothing is set that changes DDS"
    return Finding("DDS settings", not wrong, seen, "; ".join(f"{name}: {problem}" for name, problem in wrong.items()))


def discovery() -> Finding:
    """Whether two processes hear each other over DDS."""
    said = _deaf(DISCOVERY_PATIENCE_S, os.environ)
    if said is None:
        return Finding("Discovery", True, "two processes hear each other")
    if first := _first():
        return Finding("Discovery", False, said, first)
    is_up = _loopback_is_up()
    remedy = _to_be_heard(is_up=is_up)
    if is_up and (culprits := _culprits()):
        named = " and ".join(f"{name}={os.environ[name]}" for name in culprits)
        remedy = (
            f"unset {' '.join(culprits)}: with {named} nothing is received, without it two processes hear each other"
        )
    return Finding("Discovery", False, said, remedy)


def _first() -> str:
    """What has to be mended before any node starts; "" for nothing."""
    unwell = [finding for finding in (domain(), log_folder()) if not finding.well]
    return f"first mend {unwell[0].subject}: {unwell[0].remedy}" if unwell else ""


def _to_be_heard(*, is_up: bool) -> str:
    """What lets two processes hear each other where no variable keeps them apart.

    Loopback has no multicast on most machines, and Fast DDS does without.
    """
    if not is_up:
        return "bring loopback up: ip link set lo up"
    remedies = []
    if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper() != "LOCALHOST":
        remedies.append("set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST")
    remedies.append("let a firewall pass UDP from port 7400 up on lo, and to 239.255.0.1")
    return ", or ".join(remedies)


def _loopback_is_up() -> bool:
    """Whether there is an interface `lo` and it is up. Source: netdevice(7)."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        try:
            answer = fcntl.ioctl(any_socket, _GET_FLAGS, struct.pack("16sh", b"lo", 0))
        except OSError:
            return False
    return bool(struct.unpack_from("h", answer, 16)[0] & _IS_UP)


def _deaf(patience_s: float, environment: Mapping[str, str]) -> str | None:
    """Why two processes do not hear each other; None when they do."""
    names = (f"{PAIRED}one_{os.getpid()}", f"{PAIRED}two_{os.getpid()}")
    both = (("hello", own, patience_s, other) for own, other in (names, names[::-1]))
    ends = _heard(*both, environment=environment)
    deaf = [said for said, other in zip(ends, reversed(names), strict=True) if other not in said]
    if not deaf:
        return None
    return deaf[0] if isinstance(deaf[0], str) else f"nothing heard in {patience_s:.0f} s"


def _culprits() -> list[str]:
    """Variables without which two processes hear each other: one if one will do, else all that were tried together."""
    suspects = [name for name, _, _ in given() if name not in HARMLESS]
    trials = [[name] for name in suspects] + [suspects] * (len(suspects) > 1)

    def hear_without(names: list[str]) -> bool:
        return _deaf(AGAIN_PATIENCE_S, {key: value for key, value in os.environ.items() if key not in names}) is None

    with ThreadPoolExecutor(max_workers=4) as pool:
        return next((names for names, heard in zip(trials, pool.map(hear_without, trials), strict=True) if heard), [])


def reception() -> Finding:
    """Whether what other nodes of this domain publish arrives: seen and not heard is another user, or a container."""
    (found,) = _heard(("senders", SENDERS_PATIENCE_S))
    if not isinstance(found, dict):
        return Finding("Running nodes heard", False, str(found), _first() or SAME)
    strangers = _strangers()
    unheard = {name: sender["publishes"] for name, sender in found.items() if _is_unheard(name, sender, strangers)}
    if not unheard:
        return Finding("Running nodes heard", True, f"{len(found)} other nodes, none of them seen without being heard")
    named = "; ".join(f"{name} publishes {_some(topics)}" for name, topics in unheard.items())
    who = f"here runs a node of {' and '.join(strangers)}" if strangers else "it hangs, or runs in another container"
    remedy = (
        "run both as one user, containers with --ipc=host --network=host; or before you start one of the two"
        " export ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET FASTDDS_BUILTIN_TRANSPORTS=UDPv4: docs/deployment.md"
    )
    return Finding("Running nodes heard", False, f"{named}, and nothing of it arrives: {who}", remedy)


def _is_unheard(name: str, sender: Mapping[str, Any], strangers: list[str]) -> bool:
    """Whether a node is seen and not heard, rather than one that has nothing to say."""
    if sender["came"] or sender["answers"]:
        return False
    return sender["answers"] is False or name == UNNAMED or bool(strangers)


def _some(names: list[str], most: int = 3) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _strangers() -> list[str]:
    """Other users whose nodes are in this domain, by the shared memory of its ports: `user 'name' (1234)`."""
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    owners = shared_memory_owners().get(int(domain) if domain.isdecimal() else 0, set())
    return [_user(number) for number in sorted(owners - {os.getuid()})]


def _user(number: int) -> str:
    try:
        return f"user '{pwd.getpwuid(number).pw_name}' ({number})"
    except KeyError:
        return f"user {number}"


def other_machines() -> Finding:
    """Whether a doctor on another machine is heard; only when it is asked for."""
    (names,) = _heard(("hello", platform.node(), MACHINES_PATIENCE_S))
    if isinstance(names, str):
        return Finding("Other machines", False, names, _first() or SAME)
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
        return Finding("Running nodes", False, str(found), _first() or SAME)
    if not found:
        where = os.environ.get("ROS_DOMAIN_ID") or "0"
        return Finding("Running nodes", True, f"none reports in domain {where}")
    lines = {}
    for name, report in found.items():
        rates = {key: value for key, value in report["values"].items() if key.endswith(" rate [Hz]")}
        flowing = ", ".join(f"{key.removesuffix(' rate [Hz]')} {value} Hz" for key, value in rates.items())
        lines[name] = f"{name}: {report['message']}" + (f" ({flowing})" if flowing else "")
    unwell = [lines[name] for name, report in found.items() if report["level"]]
    return Finding("Running nodes", not unwell, "; ".join(unwell or lines.values()), SEE)


def _heard(*questions: tuple[object, ...], environment: Mapping[str, str] | None = None) -> list[Any]:
    """The answers of `discovery_probe`, asked all at once; of one that failed, the last line that it said."""
    command = [*PYTHON, "-m", "mild_ros.environment.discovery_probe"]
    asked = [
        subprocess.Popen(
            [*command, *map(str, words)], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for words in questions
    ]
    return [_answer(process) for process in asked]


def _answer(process: subprocess.Popen[str]) -> Any:
    """What a process answered; the last line that it said where it failed or hangs."""
    try:
        out, said = process.communicate(timeout=MACHINES_PATIENCE_S + HANGING_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return "ROS 2 hangs while it starts"
    if process.returncode == 0:
        return json.loads(out)
    return (said.strip().splitlines() or [f"ended with code {process.returncode}"])[-1]


def models() -> Finding:
    """Whether every model that came with the package answers as it did when it was trained."""
    names, here = model_names(), share_folder("models")
    folders = {path.name for path in here.iterdir() if path.is_dir()}
    faults = [f"{here / name}: holds no model" for name in sorted({PipelineParameters().model, *folders} - {*names})]
    for name in names:
        try:
            load_model(name)
        except (MildError, ImportError) as error:
            faults.append(str(error))
    seen = "; ".join(faults) if faults else f"{', '.join(names)}: golden samples answered alike"
    return Finding("Models", not faults, seen, "in a checkout: git restore models; otherwise install the package again")


EXAMINATIONS: tuple[Callable[[], Finding], ...] = (
    *(python, libraries, distribution, domain, environment, shared_memory, log_folder),
    *(discovery, reception, running_nodes, models),
)

WITHOUT_ROS: tuple[Callable[[], Finding], ...] = (python, libraries, distribution, models)
"""Where there is no ROS 2 the rest would only say so again."""


LISTENING = (discovery, reception, running_nodes)
"""These wait for others, in processes of their own: they are started first, and all at once."""


@contextmanager
def examinations(*, machines: bool = False) -> Iterator[tuple[Callable[[], Finding], ...]]:
    """What is looked at, to be asked in this order; with `machines` also for a doctor on another one."""
    if not has_ros():
        yield WITHOUT_ROS
        return
    with ThreadPoolExecutor() as pool:
        started = {one: pool.submit(one) for one in LISTENING}
        found = tuple(started[one].result if one in started else one for one in EXAMINATIONS)
        yield (*found, other_machines) if machines else found

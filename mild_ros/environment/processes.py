# SPDX-License-Identifier: Apache-2.0
"""Our nodes as processes of their own, in a ROS 2 domain of their own, and none of them left behind."""

from __future__ import annotations

import ctypes
import os
import random
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType, TracebackType

from mild_core.errors import SetupError
from mild_ros.environment.local_dds import local_environment

DOMAINS = range(1, 102)
"""Above it the ports of a domain reach into those that Linux hands out to any process (32768 and up)."""

DOMAIN_LOCK = "\0mild_ros-domain-{}"
"""Abstract name of the socket that reserves a domain: runs and test sessions keep out of each other's way.

It is no file, so it belongs to no user, needs no permission and ends with its process; and it is seen exactly where a
domain's ports are, in one network namespace. Source: unix(7).
"""

FIRST_PORT, PORTS_PER_DOMAIN = 7400, 250
"""Source: DDSI-RTPS 2.3, 9.6.1.1: the ports of a domain."""

POLITE_S, FIRM_S = 10.0, 5.0
"""How long a node may take to end after SIGINT, and after SIGTERM."""

PYTHON = (sys.executable, "-P")
"""How a child of ours starts: what lies in the current folder is never taken for a module."""

_DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of prctl(2)."""

_PRCTL = ctypes.CDLL(None).prctl


def end_with_parent() -> None:
    """Called in a child between fork and exec: when its parent is killed outright, it is killed too."""
    _PRCTL(_DIE_WITH_PARENT, signal.SIGKILL)


@contextmanager
def private_domain() -> Iterator[int]:
    """A ROS 2 domain that nothing on this machine uses, reserved until the block is left.

    Raises:
        SetupError: All are taken.
    """
    domain, lock = hold_domain()
    with lock:
        yield domain


def hold_domain() -> tuple[int, socket.socket]:
    """A ROS 2 domain that nothing on this machine uses, of whichever user; it is reserved until the socket is closed.

    Raises:
        SetupError: All are taken.
    """
    owners = shared_memory_owners()
    strange = {domain for domain, users in owners.items() if users - {os.getuid()}}
    free = list(set(DOMAINS) - _domains_in_use())
    random.shuffle(free)
    # What a killed process left in shared memory may be locked for ever, and another user's cannot be opened.
    for domain in sorted(free, key=lambda one: (one in strange, one in owners)):
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            lock.bind(DOMAIN_LOCK.format(domain))
        except OSError:
            lock.close()
        else:
            return domain, lock
    raise SetupError("ROS_DOMAIN_ID", f"all domains from 1 to {DOMAINS[-1]} are in use", "end some ROS 2 programs")


def shared_memory_owners() -> dict[int, set[int]]:
    """Who has, or has left, the shared memory of each domain's ports: numbers of users by domain.

    A process cannot open another user's, so messages through shared memory are dropped where there is some.
    """
    found: dict[int, set[int]] = {}
    for path in Path("/dev/shm").glob("fastrtps_port*"):
        number = re.match(r"fastrtps_port(\d+)", path.name)
        with suppress(OSError):
            if number:
                found.setdefault((int(number[1]) - FIRST_PORT) // PORTS_PER_DOMAIN, set()).add(path.stat().st_uid)
    return found


def _domains_in_use() -> set[int]:
    """Domains whose ports are bound."""
    found = set()
    for table in ("/proc/net/udp", "/proc/net/udp6"):
        lines = Path(table).read_text().splitlines()[1:] if Path(table).exists() else []
        ports = (int(line.split()[1].rsplit(":", 1)[1], 16) for line in lines)
        found |= {(port - FIRST_PORT) // PORTS_PER_DOMAIN for port in ports if port >= FIRST_PORT}
    return found & set(DOMAINS)


class Nodes:
    """Nodes of ours, ended in reverse order when the block is left, however it is left.

    SIGTERM and SIGHUP (a closed terminal) end this process in order too; and when it is killed outright, the nodes are
    with it.

    Args:
        domain: The ROS 2 domain they talk in.
        log_folder: What each of them prints goes into a file there.

    Attributes:
        log_folder: That folder.
    """

    def __init__(self, domain: int, log_folder: Path) -> None:
        log_folder.mkdir(parents=True, exist_ok=True)
        self.log_folder = log_folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        own = {"ROS_LOG_DIR": str(log_folder), "PYTHONUNBUFFERED": "1", "PYTHONSAFEPATH": "1"}
        self._environment = local_environment(os.environ, domain) | own

    def __enter__(self) -> Nodes:
        ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN  # by nohup
        numbers = (signal.SIGTERM,) if ignored else (signal.SIGTERM, signal.SIGHUP)
        self._before = {number: signal.signal(number, _interrupt) for number in numbers}
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for name in reversed(list(self._running)):
            self.stop(name)
        for number, before in self._before.items():
            signal.signal(number, before)

    def start(self, name: str, parameters: Mapping[str, object], topics: Mapping[str, str] | None = None) -> None:
        """Start the executable `name` of ours with these parameters, and with other names for its `topics`."""
        words = [word for key, value in parameters.items() for word in ("-p", f"{key}:={as_yaml(value)}")]
        words += [word for topic, other in (topics or {}).items() for word in ("-r", f"{topic}:={other}")]
        command = [*PYTHON, "-m", f"mild_ros.nodes.{name}_node", "--ros-args", *words]
        with self._log(name).open("wb") as log:
            self._running[name] = subprocess.Popen(
                command,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # control-C reaches this process, which then ends them in order
                preexec_fn=end_with_parent,
            )

    def has_ended(self, name: str) -> bool:
        """Whether a node has ended by itself, and well.

        Raises:
            SetupError: It failed; the problem is the last thing that it said.
        """
        code = self._running[name].poll()
        if code:
            raise SetupError(f"node {name}", self._last_words(name, code), f"see {self._log(name)}")
        return code == 0

    def check(self, *but: str) -> None:
        """Look after all nodes; those in `but` may end.

        Raises:
            SetupError: One has failed, or ended before its time.
        """
        for name in self._running:
            if self.has_ended(name) and name not in but:
                raise SetupError(f"node {name}", "has ended before its time", f"see {self._log(name)}")

    def has_said(self, name: str, words: str) -> bool:
        """Whether a node has printed `words`."""
        return words in self._log(name).read_text(errors="replace")

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a node."""
        self._running[name].send_signal(number)

    def kill(self, name: str) -> None:
        """End a node without asking."""
        process = self._running.pop(name)
        process.kill()
        process.wait()

    def stop(self, name: str) -> None:
        """End a node: ask, ask again, then end it."""
        process = self._running.pop(name)
        for number, patience_s in ((signal.SIGINT, POLITE_S), (signal.SIGTERM, FIRM_S), (signal.SIGKILL, FIRM_S)):
            if process.poll() is None:
                process.send_signal(number)
            deadline = time.monotonic() + patience_s
            while process.poll() is None and time.monotonic() < deadline:
                time.sleep(0.01)
        process.wait()

    def _log(self, name: str) -> Path:
        return self.log_folder / f"{name}.log"

    def _last_words(self, name: str, code: int) -> str:
        lines = [line.strip() for line in self._log(name).read_text(errors="replace").splitlines() if line.strip()]
        said = lines[-1].removeprefix(f"mild_ros {name}: ") if lines else "said nothing"
        return f"ended with code {code}: {said}"


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def as_yaml(value: object) -> str:
    """A value as ROS reads it: in its YAML a bare `y` is true, so texts have quotes."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(as_yaml(item) for item in value)}]"
    return "'" + str(value).replace("'", "''") + "'"

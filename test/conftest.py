# SPDX-License-Identifier: Apache-2.0
"""What every test may rely on: a ROS 2 domain of its own, one thread, recordings if any, nothing left running."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import tempfile
import time
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

from mild_ros.environment.processes import hold_domain

ROOT = Path(__file__).resolve().parent.parent
DOMAIN_LOCK = pytest.StashKey[socket.socket]()

MARK = f"MILD_TEST_SESSION={uuid.uuid4().hex}"
"""In the environment of everything that this session starts, however deep and wherever it moves to."""


def pytest_configure(config: pytest.Config) -> None:
    """Before any import of numpy or rclpy: both read their environment once."""
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[variable] = "1"
    domain, config.stash[DOMAIN_LOCK] = hold_domain()  # no demo and no other test session, of whichever user, has it
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_LOG_DIR"] = tempfile.mkdtemp(prefix="mild_ros-test-log-")
    os.environ["MPLBACKEND"] = "Agg"
    name, _, value = MARK.partition("=")
    os.environ[name] = value


def pytest_unconfigure(config: pytest.Config) -> None:
    config.stash[DOMAIN_LOCK].close()
    shutil.rmtree(os.environ["ROS_LOG_DIR"], ignore_errors=True)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--heavy", action="store_true", help="also run what takes minutes, or needs root or a compiler")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what talks over DDS, before `-m` chooses by marks, and skip what is heavy unless it is asked for."""
    skip = pytest.mark.skip(reason="heavy: ./mild test --heavy runs it")
    for item in items:
        if "heavy" in item.keywords and not config.getoption("--heavy"):
            item.add_marker(skip)
        if "ros_domain" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.talks)


@pytest.fixture(scope="session")
def ros_domain() -> int:
    """The ROS 2 domain that is this session's alone, or this worker's; already in the environment, for children too.

    Who talks over DDS asks for it, directly or by another fixture: `./mild test` runs such tests two at a time, and all
    of a file in one worker, so that they share what a fixture of the module has started.
    """
    return int(os.environ["ROS_DOMAIN_ID"])


@pytest.fixture(scope="session")
def mild_data() -> Path:
    """The folder of recordings, which may not be republished: $MILD_DATA, or shared/data beside the checkout."""
    return _existing("MILD_DATA", ROOT.parent / "shared" / "data", "recordings")


@pytest.fixture(scope="session")
def shared_bags() -> Path:
    """The folder of bags recorded from real trackers: $MILD_BAGS, or shared/bags beside the checkout."""
    return _existing("MILD_BAGS", ROOT.parent / "shared" / "bags", "real bags")


def _existing(variable: str, default: Path, what: str) -> Path:
    folder = Path(os.environ.get(variable) or default)
    if not folder.is_dir():
        pytest.skip(f"no {what}: {folder} is no folder; name it in {variable}")
    return folder


def processes_left(mark: str) -> dict[int, str]:
    """Process id and command line of everything alive whose environment holds `mark`, this process excepted."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if int(folder.name) == os.getpid() or mark.encode() not in (folder / "environ").read_bytes().split(b"\0"):
                continue
            command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
        except OSError:  # it ended meanwhile, or is another user's
            continue
        if command and "multiprocessing.resource_tracker" not in command:  # Python's own: ends with this process
            found[int(folder.name)] = command
    return found


@pytest.fixture(autouse=True, scope="module")
def _nothing_left_running() -> Iterator[None]:
    """Fail the last test of a module whose processes outlive it by five seconds, and end them."""
    before = processes_left(MARK)
    yield
    deadline = time.monotonic() + 5
    while (left := {pid: line for pid, line in processes_left(MARK).items() if pid not in before}) and (
        time.monotonic() < deadline
    ):
        time.sleep(0.05)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert not left, f"still running: {left}"

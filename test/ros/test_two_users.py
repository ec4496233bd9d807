# SPDX-License-Identifier: Apache-2.0
"""Two users of one machine: each runs nodes of its own, and nothing of the first is in the way of the second."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mild_ros.environment import processes
from mild_ros.environment.processes import hold_domain, private_domain

SECOND = 54321
READS = ("--inh-caps", "+dac_read_search", "--ambient-caps", "+dac_read_search")
"""The second user reads what we read, wherever Python is installed, and writes nothing of ours."""

HOLD = """
import tempfile
from mild_ros.assembly.private import private_folder
from mild_ros.environment.processes import hold_domain
(private_folder() / "note").write_text("mine")
print(hold_domain()[0])
"""


def as_second_user(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """What another user's command says, run in a folder that is theirs."""
    folder.mkdir()
    os.chown(folder, SECOND, SECOND)
    user = ("setpriv", "--reuid", str(SECOND), "--regid", str(SECOND), "--clear-groups", *READS)
    own = {"HOME": str(folder), "ROS_LOG_DIR": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [*user, sys.executable, "-P", *words],
        cwd=folder, env=os.environ | own, capture_output=True, text=True, timeout=560,
    )  # fmt: skip


needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to be two users")


def test_a_domain_is_held_by_one_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "DOMAINS", range(1, 100))
    with private_domain() as first:
        monkeypatch.setattr(processes, "DOMAINS", [first, 101])
        held, lock = hold_domain()
        lock.close()
        assert held == 101


@pytest.mark.parametrize("owner", [os.getuid(), os.getuid() + 1])
def test_a_domain_with_left_shared_memory_is_taken_last(owner: int, monkeypatch: pytest.MonkeyPatch) -> None:
    own = {90: {os.getuid()}}
    # A name of its own, since other tests hold domains at the same time.
    monkeypatch.setattr(processes, "DOMAIN_LOCK", f"\0test_two_users {os.getpid()} {{}}")
    monkeypatch.setattr(processes, "DOMAINS", [90, 91] if owner == os.getuid() else [90, 92])
    monkeypatch.setattr(
        processes, "shared_memory_owners", lambda: own | ({92: {owner}} if owner != os.getuid() else {})
    )
    monkeypatch.setattr(processes, "_domains_in_use", lambda: set())
    held, lock = hold_domain()
    lock.close()
    assert held == (91 if owner == os.getuid() else 90)


@needs_root
def test_the_second_user_finds_a_domain_and_a_folder(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    with private_domain() as first:
        said = as_second_user(tmp_path / "second", "-c", HOLD)
    assert said.returncode == 0, said.stderr
    assert int(said.stdout) != first


@needs_root
@pytest.mark.heavy
@pytest.mark.timeout(1200)
def test_both_run_the_demo_at_once(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    command = ("-m", "mild_ros.command_line.main", "demo")
    ours = subprocess.Popen([sys.executable, "-P", *command], cwd=tmp_path, stdout=subprocess.DEVNULL)
    theirs = as_second_user(tmp_path / "second", *command)
    assert (theirs.returncode, ours.wait(560)) == (0, 0), theirs.stderr
    assert (tmp_path / "second" / "out" / "demo" / "recorded").stat().st_uid == SECOND

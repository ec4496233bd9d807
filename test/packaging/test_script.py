# SPDX-License-Identifier: Apache-2.0
"""`./mild` as a newcomer meets it: help at once, one line for what cannot work, a fresh clone that sets itself up."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mild_ros.command_line.main import COMMANDS
from test.habits.tree import plant
from test.packaging.trees import ROOT, copy_of_checkout

NO_NETWORK = "the package index cannot be reached"


def _environment(**variables: str) -> dict[str, str]:
    """A login without anything of ours; HOME stays, for the installers' caches."""
    kept = {key: os.environ[key] for key in ("HOME", "SSL_CERT_FILE", "PIP_CERT") if key in os.environ}
    return {"PATH": "/usr/bin:/bin", **kept, **variables}


def _mild(folder: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    command = [str(folder / "mild"), *arguments]
    return subprocess.run(
        command, cwd=folder.parent, env=_environment(**variables), capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return copy_of_checkout(tmp_path_factory.mktemp("a clone") / "mild ros")


@pytest.mark.parametrize("arguments", [(), ("--help",), ("help",)])
def test_help_needs_no_set_up(clone: Path, arguments: tuple[str, ...]) -> None:
    result = _mild(clone, *arguments)
    assert result.returncode == 0
    assert "demo" in result.stdout
    assert not (clone / ".venv").exists()


def test_help_lists_every_command() -> None:
    lines = re.findall(r"^  (\w+)  +(.+)", _mild(ROOT, "--help").stdout, re.MULTILINE)
    offered = {name: text for name, text in lines if name not in ("check", "test")}
    assert len(lines) == len(offered) + 2
    assert {name: text.lower() + "." for name, text in offered.items()} == {
        name: text.lower() for name, text in COMMANDS.items()
    }


def test_an_unknown_command_is_one_line(clone: Path) -> None:
    result = _mild(clone, "dmeo")
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)
    assert "'dmeo' is unknown; did you mean demo?" in result.stderr
    assert "did you mean" not in _mild(clone, "nonsense").stderr


def test_an_interrupted_set_up_is_one_line(tmp_path: Path) -> None:
    folder = copy_of_checkout(tmp_path / "a clone")
    process = subprocess.Popen(
        [str(folder / "mild"), "models"], env=_environment(), stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stderr is not None
    assert "making .venv" in process.stderr.readline()
    os.killpg(process.pid, signal.SIGINT)  # control-C reaches the whole group
    assert process.wait(60.0) == 130
    assert process.stderr.read().splitlines() == ["mild: interrupted; the next call goes on with the set-up"]
    process.stderr.close()


def test_a_wrong_python_is_one_line(clone: Path, tmp_path: Path) -> None:
    old = plant(tmp_path, "python3.9", "#!/bin/sh\necho\n")
    old.chmod(0o755)
    for python in (str(old), "/nowhere/python"):
        result = _mild(clone, "demo", MILD_PYTHON=python)
        assert (result.returncode, result.stderr.count("\n")) == (2, 1)
        assert "not a Python 3.11 or 3.12" in result.stderr


def test_a_python_without_venv_is_one_line(clone: Path, tmp_path: Path) -> None:
    bare = plant(
        tmp_path, "python3", f'#!/bin/sh\ncase "$2" in *ensurepip*) exit 1;; esac\nexec "{sys.executable}" "$@"\n'
    )
    bare.chmod(0o755)
    result = _mild(clone, "demo", MILD_PYTHON=str(bare))
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)
    assert "apt install python3" in result.stderr


def test_another_machine_is_one_line(clone: Path, tmp_path: Path) -> None:
    plant(tmp_path, "uname", "#!/bin/sh\necho Linux aarch64\n").chmod(0o755)
    result = _mild(clone, "demo", PATH=f"{tmp_path}:/usr/bin:/bin")
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)
    assert "x86-64 Linux" in result.stderr


def test_a_full_disk_is_one_line(clone: Path, tmp_path: Path) -> None:
    plant(tmp_path, "df", "#!/bin/sh\nprintf 'Filesystem 1024-blocks Used Available\\nd 9 9 1000000\\n'\n").chmod(0o755)
    result = _mild(clone, "demo", PATH=f"{tmp_path}:/usr/bin:/bin")
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)
    assert "1000 MB free" in result.stderr


def test_no_network_is_one_line(tmp_path: Path) -> None:
    """A proxy without a listener is a network that is not there."""
    clone = copy_of_checkout(tmp_path / "clone")
    for module in ("venv.py", "ensurepip.py", "pip/__init__.py", "json.py"):  # the current folder, which is not asked
        plant(tmp_path, module, f"open({str(tmp_path / 'trace')!r}, 'a').write({module!r})\n")
    result = _mild(clone, "demo", HTTPS_PROXY="http://127.0.0.1:9", HTTP_PROXY="http://127.0.0.1:9")
    assert result.returncode == 2
    assert NO_NETWORK in result.stderr.splitlines()[-1]
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "trace").exists()


@pytest.mark.heavy
@pytest.mark.slow
def test_a_fresh_clone_sets_itself_up(clone: Path) -> None:
    """One call is killed half way. Then two at once: one does all the work again, the other waits; a third is quick."""
    command = [str(clone / "mild"), "models"]
    options = {
        "cwd": clone.parent,
        "env": _environment(),
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "text": True,
    }
    with subprocess.Popen(command, start_new_session=True, **options) as killed:
        assert killed.stderr is not None
        assert "making .venv" in killed.stderr.readline()
        os.killpg(killed.pid, signal.SIGKILL)
    both = [subprocess.Popen(command, **options) for _ in range(2)]
    said = [process.communicate(timeout=280) for process in both]
    if any(NO_NETWORK in stderr for _, stderr in said):
        pytest.skip("a fresh set-up needs the network")
    assert [process.returncode for process in both] == [0, 0], said
    assert sum("making .venv" in stderr for _, stderr in said) == 1
    assert sum("waiting for it" in stderr for _, stderr in said) == 1
    site = next((clone / ".venv").glob("lib/python3*/site-packages"))
    assert not (site / "torch").exists()
    begin = time.monotonic()
    again = _mild(clone, "models")
    assert (again.returncode, again.stderr) == (0, ""), again.stderr
    assert again.stdout == said[0][0]
    assert time.monotonic() - begin < 10  # a second on an idle machine; what is asserted is that nothing is installed

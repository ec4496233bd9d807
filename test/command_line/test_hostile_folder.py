# SPDX-License-Identifier: Apache-2.0
"""Nothing that lies in the current folder is ever run, whatever it is called."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mild_core import resources
from mild_core.errors import SetupError
from mild_core.resources import model_folder, share_folder
from mild_ros.environment.processes import PYTHON, Nodes
from mild_ros.messages.message_types import interface_class, message_class
from test.habits.tree import ROOT, plant

MODULES = (
    *("typer.py", "numpy.py", "rosbags/__init__.py", "mild_ros/__init__.py", "mild_core/__init__.py", "yaml.py"),
    *("sitecustomize.py", "usercustomize.py", "json.py", "venv.py", "pip/__init__.py", "uv.py", "rclpy/__init__.py"),
    *("std_msgs/__init__.py", "planted_msgs/__init__.py", "planted_msgs/msg/__init__.py", "git", "df"),
)
TRACE = "someone_ran_me"


@pytest.fixture
def hostile(tmp_path: Path) -> Path:
    """A folder full of modules, each of which leaves a trace when it is run."""
    folder = tmp_path / "hostile"
    for name in MODULES:
        leave = f"open({str(tmp_path / TRACE)!r}, 'a').write({name!r})\n"
        script = f"#!/bin/sh\necho {name} >>{tmp_path / TRACE}\n"
        plant(folder, name, leave if name.endswith(".py") else script).chmod(0o755)
    return folder


def assert_no_trace(folder: Path) -> None:
    trace = folder.parent / TRACE
    assert not trace.exists(), f"run from the current folder: {trace.read_text()}"


def mild(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    if Path(sys.prefix) != ROOT / ".venv":
        pytest.skip("these tests do not run in the Python that ./mild has set up")
    kept = {"HOME": os.environ["HOME"], "PATH": "/usr/bin:/bin", "PYTHONPATH": ".", "PYTHONSTARTUP": "sitecustomize.py"}
    command = [str(ROOT / "mild"), *words]
    return subprocess.run(command, cwd=folder, env=kept, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize(
    "words", [("models",), ("replay", "no_such_bag"), ("doctor", "--help"), ("evaluate", "--help")], ids=" ".join
)
def test_mild_takes_no_module_of_the_current_folder(hostile: Path, words: tuple[str, ...]) -> None:
    done = mild(hostile, *words)
    assert "Traceback" not in done.stderr
    assert done.returncode == (2 if "no_such_bag" in words else 0), done.stderr
    assert_no_trace(hostile)


def test_the_folder_is_one_that_would_be_run_from(hostile: Path) -> None:
    """Python's own habit, without which the tests here would show nothing."""
    unsafe = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    subprocess.run([sys.executable, "-m", "mild_ros"], cwd=hostile, env=unsafe, capture_output=True, check=False)
    assert (hostile.parent / TRACE).exists()


def test_nodes_that_we_start_take_no_module_of_the_current_folder(
    hostile: Path, tmp_path: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(hostile)
    with Nodes(ros_domain, tmp_path / "log") as nodes:
        nodes.start("markers", {"nosuch": 1})  # wrong, so that it ends by itself, with all imported
        code = nodes._running["markers"].wait(120)
    said = (tmp_path / "log" / "markers.log").read_text()
    assert (code, "nosuch" in said, "Traceback" in said) == (2, True, False), said
    assert_no_trace(hostile)


def test_executables_take_no_module_of_the_current_folder(hostile: Path) -> None:
    executable = Path(sys.prefix, "bin", "record")
    if not executable.exists():
        pytest.skip(f"there is no {executable}")
    done = subprocess.run([executable, "--help"], cwd=hostile, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    assert_no_trace(hostile)


NO_TYPES = (
    *("os/msg/system", "os/msg/System", "antigravity/msg/X", "planted_msgs/msg/X", "../msg/X", "a.b/msg/X", "x/msg/X "),
    *("mild_ros/msg/Node", "Std_msgs/msg/String", "std_msgs/msg/string", "std_msgs/action/String", "std_msgs/String"),
    *("importlib/msg/X", "std_msgs/msg/String/String", "std_msgs/msg/Nothing", "", "this/msg/X"),
)


def test_a_type_name_imports_nothing_but_installed_interfaces(hostile: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(hostile)
    monkeypatch.syspath_prepend("")
    before = set(sys.modules)
    assert [name for name in NO_TYPES if interface_class(name) is not None] == []
    assert {name.split(".")[0] for name in set(sys.modules) - before} <= {"std_msgs"}
    assert_no_trace(hostile)


def test_a_package_of_the_current_folder_hides_no_installed_one(hostile: Path) -> None:
    """In a Python of its own: here `std_msgs` is imported already."""
    for hidden_by, found in ((None, "String"), ("", "None"), (str(hostile), "None")):
        program = (
            f"from mild_ros.messages.message_types import message_class; import sys; first = {hidden_by!r}\n"
            "sys.path[:0] = [] if first is None else [first]\n"
            "print(getattr(message_class('std_msgs/msg/String'), '__name__', None))"
        )
        done = subprocess.run([*PYTHON, "-c", program], cwd=hostile, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout.strip()) == (0, found), done.stderr
        assert_no_trace(hostile)


def test_a_package_that_the_index_lists_elsewhere_is_not_taken(
    hostile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Listed there, importable here: that is not the installation which the index speaks of."""
    plant(tmp_path, "prefix/share/ament_index/resource_index/rosidl_interfaces/planted_msgs", "")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    monkeypatch.syspath_prepend(str(hostile))
    assert message_class("planted_msgs/msg/X") is None
    assert_no_trace(hostile)


def test_installed_interfaces_are_found() -> None:
    assert message_class("sensor_msgs/msg/JointState").__name__ == "JointState"
    assert interface_class("std_srvs/srv/SetBool").__name__ == "SetBool"
    assert message_class("std_srvs/srv/SetBool") is None


def test_a_bare_name_means_the_shipped_model_whatever_folder_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shipped, mine = "nuisi_partner_next", "my_model"
    for name in (shipped, mine):
        shutil.copytree(share_folder("models") / shipped, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    resources._print_once.cache_clear()
    assert model_folder(shipped) == share_folder("models") / shipped
    assert capsys.readouterr().err.count(f"the folder of that name here is ./{shipped}\n") == 1
    for path in (f"./{shipped}", f"{shipped}/", str(tmp_path / shipped)):
        assert model_folder(path).resolve() == tmp_path / shipped
    assert capsys.readouterr().err == ""
    assert model_folder(mine).resolve() == tmp_path / mine
    assert capsys.readouterr().err == "mild: model my_model: the folder of that name here is taken\n"
    for absent in ("nuisi_partner_nxt", "./nuisi", f"{shipped}/none"):
        with pytest.raises(SetupError, match=shipped):
            model_folder(absent)

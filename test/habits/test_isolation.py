# SPDX-License-Identifier: Apache-2.0
"""The core works where ROS is not installed, and the demo where torch is not."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from test.habits.tree import ROOT, imports, plant, python_files

ROS = ("rclpy", "rosbags", "pybullet", "viser", "yourdfpy", "ament_index_python", "typer")
MESSAGES = ("_msgs", "_interfaces", "std_srvs")
LEARNING = ("torch", "mild_core.learning")

WITHOUT = """
import importlib.abc, sys
refused = {refused!r}
class Absent(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if any(name == one or name.startswith(one + ".") or name.split(".")[0].endswith(one) for one in refused):
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Absent())
sys.path.insert(0, "")
{then}
"""


def _run_without(refused: tuple[str, ...], then: str, folder: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Run Python as it would be where `refused` (modules, or ends of their names) are not installed."""
    program = WITHOUT.format(refused=refused, then=then)
    return subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=False)


def needing_ros(root: Path) -> list[str]:
    """Files of test/core that import what is there only with ROS."""
    found = []
    for path in python_files(root, "test"):
        if path.relative_to(root).parts[:2] == ("test", "core"):
            tops = {item.module.split(".")[0] for item in imports(root, path)}
            found += [f"{path.relative_to(root)}: {top}" for top in tops if top in ROS or top.endswith(MESSAGES)]
    return found


@pytest.mark.parametrize("line", ["import rclpy", "def f():\n    from rosbags import x", "import std_msgs.msg"])
def test_a_core_test_that_needs_ros_is_rejected(tmp_path: Path, line: str) -> None:
    plant(tmp_path, "test/core/test_a.py", line)
    assert len(needing_ros(tmp_path)) == 1


def test_no_core_test_needs_ros() -> None:
    assert needing_ros(ROOT) == []


@pytest.mark.parametrize("module", ["rclpy", "std_msgs.msg", "mild_core.learning.data.demonstration"])
def test_what_is_refused_is_absent(module: str) -> None:
    result = _run_without((*ROS, *MESSAGES, *LEARNING), f"import {module}")
    assert "ModuleNotFoundError" in result.stderr


@pytest.mark.slow
def test_the_core_tests_can_be_collected_without_ros() -> None:
    then = "import pytest; sys.exit(pytest.main(['--collect-only', '-q', '-p', 'no:cacheprovider', 'test/core']))"
    result = _run_without((*ROS, *MESSAGES), then)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.slow
def test_the_run_time_core_needs_four_packages() -> None:
    """numpy, numba, ruckig, safetensors, and what these bring: every module but learning imports with no other."""
    names = [
        path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".") for path in python_files(ROOT, "mild_core")
    ]
    modules = sorted(name.removesuffix(".__init__") for name in names if not name.startswith("mild_core.learning"))
    refused = ("mild_ros", *ROS, *MESSAGES, *LEARNING, "scipy", "matplotlib", "rich", "PIL", "yaml", "trimesh")
    result = _run_without(refused, f"import importlib\nfor name in {modules!r}: importlib.import_module(name)")
    assert result.returncode == 0, result.stderr


@pytest.mark.slow
def test_every_command_of_the_smaller_set_up_starts_without_torch() -> None:
    commands = ("demo", "replay", "view", "models", "doctor", "evaluate", "plot", "train", "measure")
    then = (
        f"from mild_ros.command_line.main import main\nfor command in {commands}:\n"
        "    try: main([command, '--help'])\n    except SystemExit as end: assert end.code == 0, command"
    )
    result = _run_without(("torch",), then)
    assert result.returncode == 0, result.stderr
    for command in commands:
        assert f"Usage: mild {command} " in result.stdout


ROS_ONLY = ("rclpy", "ament_index_python", "rpyutils", *MESSAGES)


@pytest.mark.parametrize("words", [["models"], ["models", "yumi_buetepage_ahead"], ["data"]])
def test_what_does_not_need_ros_works_without_it(words: list[str]) -> None:
    result = _run_without(ROS_ONLY, f"from mild_ros.command_line.main import main\nmain({words!r})")
    assert result.returncode == 0, result.stderr
    assert "yumi" in result.stdout.lower()


@pytest.mark.slow
def test_a_bag_is_replayed_without_ros_to_the_same_bytes(tmp_path: Path) -> None:
    def digest(refused: tuple[str, ...]) -> str:
        words = ["replay", "bags/hand_wave", "--out", str(tmp_path / f"{len(refused)}")]
        result = _run_without(refused, f"from mild_ros.command_line.main import main\nmain({words!r})")
        assert result.returncode == 0, result.stderr
        return next(line for line in result.stdout.splitlines() if "SHA-256" in line)

    assert digest(ROS_ONLY) == digest(())


@pytest.mark.parametrize("words", [["status"], ["run", "pipeline"], ["record", "a_bag"], ["faults"], ["demo"]])
def test_what_needs_ros_says_so_in_one_line(words: list[str]) -> None:
    result = _run_without(ROS_ONLY, f"from mild_ros.command_line.main import main\nmain({words!r})")
    assert result.returncode == 2
    assert len(result.stderr.strip().splitlines()) == 1
    assert "ROS 2: is not installed here" in result.stderr

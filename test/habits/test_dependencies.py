# SPDX-License-Identifier: Apache-2.0
"""What the code imports is declared three times, and the three agree: the locks, setup.py, package.xml."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from test.habits.tree import ROOT, files, imports, parse, plant, python_files

DISTRIBUTIONS = {
    "PIL": "pillow",
    "ament_index_python": "ros-ament-index-python",
    "pinocchio": "pin",
    "mpl_toolkits": "matplotlib",
    "yaml": "pyyaml",
    "launch": "ros-launch",
    "launch_ros": "ros-launch-ros",
    "rclpy": "ros-rclpy",
}
"""Where the package's name is not the module's."""

ONLY_IN_ROS = ("ros-launch", "ros-launch-ros")
"""What `ros2 launch` brings along: a process that reads a launch file has it, and the package index has not."""

ROSDEP_KEYS = {
    "hypothesis": "python3-hypothesis",
    "matplotlib": "python3-matplotlib",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "pillow": "python3-pil",
    "pybullet": "python3-pybullet-pip",
    "pyyaml": "python3-yaml",
    "rich": "python3-rich",
    "ros-ament-index-python": "ament_index_python",
    "ros-rclpy": "rclpy",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "torch": "python3-torch",
    "typer": "python3-typer",
    "yourdfpy": "python3-yourdfpy-pip",
}
"""Keys that rosdistro has; safetensors, viser, daqp and ruckig's Python side have none."""

ONLY_HOST = "download.pytorch.org"


def distribution(module: str) -> str:
    """The package on the index, or in ROS, that brings `module`."""
    top = module.split(".")[0]
    if top.endswith(("_msgs", "_interfaces", "_srvs")):
        return "ros-" + top.replace("_", "-")
    return DISTRIBUTIONS.get(top, top.replace("_", "-").lower())


def imported(root: Path) -> dict[str, str]:
    """Every foreign distribution that mild_core and mild_ros import, and one place that does."""
    found = {}
    for path in python_files(root, "mild_core", "mild_ros"):
        for item in imports(root, path):
            top = item.module.split(".")[0]
            if top not in sys.stdlib_module_names and top not in ("mild_core", "mild_ros", "test"):
                found.setdefault(distribution(top), f"{path.relative_to(root)}:{item.line}")
    return found


def pins(lock: Path) -> set[str]:
    """The lines of a lock that name a package, as `name==version`."""
    return {line.split(";")[0].rstrip("\\ ") for line in lock.read_text().splitlines() if re.match(r"[a-z0-9]", line)}


def undeclared(root: Path) -> list[str]:
    """Imports that a lock, setup.py or package.xml does not know."""
    locks = sorted((root / "requirements").glob("*.txt"))
    locked = {re.split("==| @ ", pin)[0] for lock in locks for pin in pins(lock)}
    required = _required_by_setup(root / "setup.py")
    manifest = ElementTree.parse(root / "package.xml").getroot()
    keys = {element.text for element in manifest if element.tag.endswith("depend")}
    found = []
    for name, place in sorted(imported(root).items()):
        of_ros = name.startswith("ros-")
        key = ROSDEP_KEYS.get(name, name.removeprefix("ros-").replace("-", "_") if of_ros else None)
        if name not in locked and name not in ONLY_IN_ROS:
            found.append(f"{place}: {name} is in no lock")
        if not of_ros and name not in required:
            found.append(f"{place}: {name} is not in setup.py")
        if key is not None and key not in keys:
            found.append(f"{place}: {key} is not in package.xml")
    return found


def _required_by_setup(path: Path) -> set[str]:
    call = next(
        node for node in ast.walk(parse(path)) if isinstance(node, ast.Call) and ast.unparse(node.func) == "setup"
    )
    lists = [keyword.value for keyword in call.keywords if keyword.arg in ("install_requires", "extras_require")]
    texts = [node.value for part in lists for node in ast.walk(part) if isinstance(node, ast.Constant)]
    return {re.split(r"[ ;<>=]", text)[0] for text in texts}


def loose_pins(lock: Path) -> list[str]:
    """Packages of a lock without an exact version, or without a hash."""
    found = []
    for block in re.split(r"\n(?=\S)", lock.read_text()):
        if block.startswith("#") or not block.strip():
            continue
        if not re.match(r"[a-z0-9.-]+(==| @ https://)", block) or "--hash=sha256:" not in block:
            found.append(block.splitlines()[0])
    return found


def foreign_hosts(root: Path) -> list[str]:
    """Addresses to install from, other than the index that everybody's pip has and the one for the CPU build."""
    found = []
    for path in files(root):
        if path.suffix in (".txt", ".in", ".toml", ".cfg") or path.name in ("mild", "compile", "run", "setup.py"):
            urls = re.findall(r"(?:https?://|git\+|ssh://)([\w.-]*)", path.read_text())
            found += [f"{path.relative_to(root)}: {host}" for host in urls if host != ONLY_HOST]
    return found


def _plant_package(root: Path, import_line: str) -> None:
    plant(root, "mild_core/a.py", import_line)
    plant(
        root,
        "requirements/runtime.txt",
        "numpy==1.0 \\\n    --hash=sha256:0\nros-std-msgs==1.0 \\\n    --hash=sha256:0\n",
    )
    plant(root, "setup.py", 'setup(install_requires=["numpy>=1"])')
    plant(root, "package.xml", "<package><depend>python3-numpy</depend><exec_depend>std_msgs</exec_depend></package>")


@pytest.mark.parametrize(
    ("import_line", "misses"),
    [
        ("import numpy.linalg", 0),
        ("from std_msgs.msg import Header", 0),
        ("import viser", 2),
        ("def f():\n    import torch", 3),
        ("from geometry_msgs.msg import Pose", 2),
    ],
)
def test_an_undeclared_import_is_rejected(tmp_path: Path, import_line: str, misses: int) -> None:
    _plant_package(tmp_path, import_line)
    assert len(undeclared(tmp_path)) == misses


@pytest.mark.parametrize(
    "text", ["numpy>=2 \\\n    --hash=sha256:0\n", "numpy==2\n", "a==1 \\\n    --hash=sha256:0\nb==1\n"]
)
def test_a_loose_pin_is_rejected(tmp_path: Path, text: str) -> None:
    assert len(loose_pins(plant(tmp_path, "lock.txt", text))) == 1


@pytest.mark.parametrize("text", ["--extra-index-url https://wheels.example/simple", "x @ git+https://git.example/x"])
def test_a_foreign_host_is_rejected(tmp_path: Path, text: str) -> None:
    plant(tmp_path, "requirements/runtime.txt", text)
    assert foreign_hosts(tmp_path)


def test_every_import_is_declared() -> None:
    assert undeclared(ROOT) == []


@pytest.mark.parametrize("lock", sorted((ROOT / "requirements").glob("*.txt")), ids=lambda path: path.stem)
def test_every_pin_is_exact(lock: Path) -> None:
    assert pins(lock)
    assert loose_pins(lock) == []


def test_the_larger_lock_holds_the_smaller() -> None:
    assert pins(ROOT / "requirements/runtime.txt") <= pins(ROOT / "requirements/learning-and-test.txt")


def test_both_builds_of_torch_are_one_version() -> None:
    (version,) = {
        pin.removeprefix("torch==") for pin in pins(ROOT / "requirements/torch-pypi.txt") if pin[:6] == "torch="
    }
    builds = [pin for pin in pins(ROOT / "requirements/torch-cpu.txt") if f"/cpu/torch-{version}%2Bcpu-" in pin]
    assert len(builds) == 2


def test_nothing_else_is_asked() -> None:
    assert foreign_hosts(ROOT) == []


def test_setup_and_manifest_name_one_version() -> None:
    manifest = ElementTree.parse(ROOT / "package.xml").findtext("version")
    assert f'version="{manifest}"' in (ROOT / "setup.py").read_text()
    assert f"[{manifest}]" in (ROOT / "CHANGELOG.md").read_text()

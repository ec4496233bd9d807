# SPDX-License-Identifier: Apache-2.0
"""pip and colcon both put the package where Python, the ament index and `ros2 run` look for it."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from test.packaging.trees import ROOT, copy_of_checkout, run, venv_beside_ours, venv_without_ros

EXECUTABLES = {
    "perception",
    "inference",
    "retargeting",
    "pipeline",
    "simulation",
    "camera",
    "markers",
    "replay",
    "record",
    "mild",
}
ASK = """
import pathlib, mild_core, mild_ros
from ament_index_python.packages import get_package_prefix, get_package_share_directory
print(get_package_prefix("mild_ros"), get_package_share_directory("mild_ros"))
print(pathlib.Path(mild_core.__file__).parents[1], pathlib.Path(mild_ros.__file__).parents[1])
"""


class Installed(NamedTuple):
    """An installation: where it went, and how to run Python there."""

    prefix: Path
    python: list[str]
    variables: dict[str, str]


@pytest.fixture(scope="module")
def by_pip(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    folder = tmp_path_factory.mktemp("pip")
    source, venv = copy_of_checkout(folder / "source"), venv_beside_ours(folder / "venv")
    python = str(venv / "bin" / "python")
    options = ["--no-deps", "--no-build-isolation", "--ignore-installed", "--quiet"]
    result = run([sys.executable, "-m", "pip", "--python", python, "install", *options, str(source)], folder)
    assert result.returncode == 0, result.stdout + result.stderr
    return Installed(venv, [python], {"AMENT_PREFIX_PATH": str(venv)})


@pytest.fixture(scope="module")
def without_ros(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    folder = tmp_path_factory.mktemp("without_ros")
    source, venv = copy_of_checkout(folder / "source"), venv_without_ros(folder / "venv")
    python = str(venv / "bin" / "python")
    options = ["--no-deps", "--no-build-isolation", "--ignore-installed", "--quiet"]
    result = run([sys.executable, "-m", "pip", "--python", python, "install", *options, str(source)], folder)
    assert result.returncode == 0, result.stdout + result.stderr
    return Installed(venv, [python], {})


@pytest.fixture(scope="module")
def by_colcon(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    folder = tmp_path_factory.mktemp("colcon")
    copy_of_checkout(folder / "src" / "mild_ros")
    result = run([sys.executable, "-m", "colcon", "build"], folder)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "1 package finished" in result.stdout
    setup = 'source "$0/install/setup.bash" && exec "$@"'
    return Installed(folder / "install" / "mild_ros", ["bash", "-c", setup, str(folder), sys.executable], {})


@pytest.fixture(params=["by_pip", "by_colcon"])
def installed(request: pytest.FixtureRequest) -> Installed:
    given: Installed = request.getfixturevalue(request.param)
    return given


@pytest.mark.slow
def test_the_index_finds_it(installed: Installed, tmp_path: Path) -> None:
    result = run([*installed.python, "-c", ASK], tmp_path, **installed.variables)
    assert result.returncode == 0, result.stderr
    prefix, share, core, shell = map(Path, result.stdout.split())
    assert prefix == installed.prefix
    assert share == installed.prefix / "share" / "mild_ros"
    assert core == shell
    assert core.is_relative_to(installed.prefix)


@pytest.mark.slow
def test_nothing_is_missing(installed: Installed) -> None:
    (site,) = {path.parent for path in installed.prefix.rglob("mild_core") if path.is_dir()}
    for pattern in ("mild_core/**/*.py", "mild_ros/**/*.py", "mild_core/**/*.urdf", "mild_core/**/*.toml"):
        wanted = {path.relative_to(ROOT) for path in ROOT.glob(pattern) if path.parent.name != "launch"}
        assert wanted
        assert {name for name in wanted if not (site / name).is_file()} == set()
    share = installed.prefix / "share" / "mild_ros"
    assert (share / "package.xml").is_file()
    for kind in ("models", "bags", "mild_ros/launch", "mild_ros/config"):
        folder = ROOT / kind
        wanted = {path.relative_to(folder.parent) for path in folder.rglob("*") if path.is_file()}
        wanted = {name for name in wanted if name.suffix != ".pyc"}
        assert wanted
        assert {name for name in wanted if not (share / name).is_file()} == set()


@pytest.mark.slow
def test_ros2_run_finds_the_executables(installed: Installed) -> None:
    folder = installed.prefix / "lib" / "mild_ros"
    assert {path.name for path in folder.iterdir() if os.access(path, os.X_OK)} == EXECUTABLES


@pytest.mark.slow
def test_pip_puts_mild_alone_into_the_path(by_pip: Installed) -> None:
    ours = {path.name for path in (by_pip.prefix / "bin").iterdir() if path.name in EXECUTABLES}
    assert ours == {"mild"}


@pytest.mark.slow
def test_mild_run_finds_the_nodes(by_pip: Installed, tmp_path: Path) -> None:
    """And so does the launcher for `ros2 run`, which calls it."""
    for command in (["bin/mild", "run", "record"], ["lib/mild_ros/record"]):
        words = [str(by_pip.prefix / command[0]), *command[1:], "--ros-args", "-p", f"bag:={tmp_path}"]
        result = run(words, tmp_path, **by_pip.variables)
        assert (result.returncode, "exists already" in result.stderr) == (2, True), result.stderr


@pytest.mark.slow
def test_an_executable_starts_what_was_installed(installed: Installed, tmp_path: Path) -> None:
    """A wrong set-up ends it at once, with the line that says so: so it found its code, ROS and its models."""
    node = str(installed.prefix / "lib" / "mild_ros" / "inference")
    line = [node, "--ros-args", "-p", "model:=no_such_model"]
    command = line if installed.variables else [*installed.python[:-1], *line]
    result = run(command, tmp_path, **installed.variables)
    assert result.returncode == 2, result.stderr
    assert "'no_such_model' is unknown" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.slow
def test_without_ros_models_are_listed_and_the_rest_is_one_line(without_ros: Installed, tmp_path: Path) -> None:
    mild = str(without_ros.prefix / "bin" / "mild")
    shown = run([mild, "models"], tmp_path)
    assert (shown.returncode, "yumi_buetepage_ahead" in shown.stdout) == (0, True), shown.stderr
    for words in (["demo"], ["run", "pipeline"], ["launch", "live"], ["status"]):
        ended = run([mild, *words], tmp_path)
        assert (ended.returncode, ended.stderr.count("\n")) == (2, 1), (words, ended.stderr)
        assert "mild: ROS 2: is not installed here" in ended.stderr


@pytest.mark.heavy
@pytest.mark.timeout(900)
def test_without_ros_a_bag_is_replayed_and_viewed(without_ros: Installed, tmp_path: Path) -> None:
    mild = str(without_ros.prefix / "bin" / "mild")
    found = run([mild, "doctor", "--json"], tmp_path)
    unwell = [one for one in json.loads(found.stdout) if not one["well"]]
    assert [one["subject"] for one in unwell] == ["ROS 2"], found.stdout
    assert unwell[0]["seen"].startswith("not installed here")
    bag = str(without_ros.prefix / "share" / "mild_ros" / "bags" / "handshake")
    replayed = run([mild, "replay", bag, "--out", "run"], tmp_path)
    assert (replayed.returncode, "SHA-256" in replayed.stdout) == (0, True), replayed.stderr
    viewed = run([mild, "view", "run/recorded", "--out", "seen"], tmp_path)
    assert viewed.returncode == 0, viewed.stderr
    for folder in ("run", "seen"):
        assert {"filmstrip.png", "page.html", "plots.png"} <= {path.name for path in (tmp_path / folder).iterdir()}

# SPDX-License-Identifier: Apache-2.0
"""What launch files start and set exists: executables, parameters of every configuration, files that are named."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest
import yaml

from mild_core.errors import SetupError
from mild_core.resources import model_names
from mild_core.retargeting.robot_file import find_robot
from mild_ros.assembly.bag_settings import RecordParameters, ReplayParameters
from mild_ros.assembly.perception import manifest_of
from mild_ros.assembly.robot import check_fit
from mild_ros.assembly.settings import NODES, PipelineParameters
from mild_ros.bag.reader import open_bag
from mild_ros.commands.joint_naming import joint_naming
from mild_ros.controllers import OUTPUTS
from mild_ros.launching import table
from mild_ros.launching.table import LAUNCHES, commands, read_arguments, run_launch
from mild_ros.node_kit.parameter_files import read_parameters
from test.habits.tree import ROOT

CONFIGURATIONS = sorted((ROOT / "mild_ros/config").glob("*.yaml"))
LAUNCH_FILES = sorted((ROOT / "mild_ros/launch").glob("*.launch.py"))
CONFIGURATIONS_TO_LEARN = {path.stem for path in (ROOT / "mild_core/learning/configurations").glob("*.toml")}
PARAMETERS = {**NODES, "replay": ReplayParameters, "record": RecordParameters}


@pytest.mark.parametrize("path", CONFIGURATIONS, ids=lambda path: path.stem)
def test_every_configuration_is_accepted(path: Path) -> None:
    names = list(yaml.safe_load(path.read_text()))
    assert all(name.startswith("/**/") for name in names), "fits any namespace"
    for name in names:
        node = name.removeprefix("/**/")
        given = read_parameters(PARAMETERS[node], node, path.stem)
        assert find_robot(given.robot).name == given.robot
    given = read_parameters(PipelineParameters, "pipeline", path.stem)
    assert set(given.outputs) <= OUTPUTS.keys()
    joint_naming(find_robot(given.robot).joint_names, given.robot_joint_names)
    if given.model in model_names():
        check_fit(given.model, manifest_of(given.model).controlled, find_robot(given.robot))  # raises when it does not
    else:
        assert given.model in CONFIGURATIONS_TO_LEARN, "there is no such model, and no way to get it"


@pytest.mark.parametrize("name", LAUNCHES)
def test_a_launch_names_what_there_is(name: str) -> None:
    wanted = LAUNCHES[name]
    assert all(text for _, text in wanted.arguments.values()), "every argument is explained"
    for node in wanted.nodes:
        known = {entry.name for entry in fields(PARAMETERS[node.executable])} | {"use_sim_time"}
        assert {*node.parameters, *node.fixed} <= known
        assert {*node.parameters.values(), *node.topics.values()} <= wanted.arguments.keys()
        assert not node.only_with or node.only_with in wanted.arguments
    path = ROOT / f"mild_ros/launch/{name}.launch.py"
    assert f'describe("{name}")' in path.read_text()
    assert wanted.text in path.read_text()
    assert {file.name for file in LAUNCH_FILES} == {f"{each}.launch.py" for each in LAUNCHES}


@pytest.mark.parametrize("name", ["live", "simulation"])
def test_nodes_of_a_robot_are_started_again_unless_it_is_forbidden(name: str) -> None:
    assert LAUNCHES[name].arguments["respawn"][0] == "true"
    assert all(node.respawned for node in LAUNCHES[name].nodes)


def test_a_replay_ends_with_a_node_that_fails() -> None:
    assert LAUNCHES["replay"].ends_with_failure
    assert not any(node.respawned for node in LAUNCHES["replay"].nodes)


def test_arguments_reach_the_nodes() -> None:
    given = read_arguments(
        LAUNCHES["replay"], ["bag:=bags/handshake", "namespace:=left", "rate:=2", "loop:=True", "record:=out"]
    )
    lines = {node.executable: " ".join(words) for node, words in commands(LAUNCHES["replay"], given)}
    assert list(lines) == ["pipeline", "simulation", "record", "replay"]
    assert all("-r __ns:=/left" in line for line in lines.values())
    assert "--params-file" in lines["pipeline"]
    assert "-p bag:='out'" in lines["record"]
    assert "-p rate:=2.0 -p start_s:=0.0 -p loop:=true" in lines["replay"]
    assert "-p subscribers:=2" in lines["replay"]
    live = read_arguments(LAUNCHES["live"], ["skeleton:=/k4a/bodies"])
    ((_, words),) = commands(LAUNCHES["live"], live)
    assert words[-4:] == ["-p", "use_sim_time:=false", "-r", "skeleton:=/k4a/bodies"]


@pytest.mark.parametrize(
    ("name", "words", "problem"),
    [
        ("live", ["skeletn:=/a"], "did you mean 'skeleton'"),
        ("live", ["/a"], "write NAME:=VALUE"),
        ("live", ["respawn:=maybe"], "give true or false"),
        ("live", ["config:=nosuch"], "'nosuch' is unknown"),
        ("replay", [], "bag:=: is missing"),
        ("replay", ["bag:=a", "rate:=fast"], "is no number"),
    ],
)
def test_a_wrong_argument_is_one_line(name: str, words: list[str], problem: str) -> None:
    with pytest.raises(SetupError, match=problem):
        commands(LAUNCHES[name], read_arguments(LAUNCHES[name], words))


def test_a_launched_replay_ends_with_its_bag_and_a_failure_with_its_line(ros_domain: int, tmp_path: Path) -> None:
    """The whole way, of which every node's end is the launch's own to bring about."""
    command = [sys.executable, "-m", "mild_ros.command_line.main", "launch", "replay"]
    broken = subprocess.run(
        [*command, f"bag:={tmp_path / 'none'}"], capture_output=True, text=True, check=False, timeout=280
    )
    assert broken.returncode == 2
    assert "there is no such bag" in broken.stderr
    recorded = tmp_path / "recorded"
    words = [f"bag:={ROOT / 'bags' / 'hand_wave'}", "rate:=8", f"record:={recorded}"]
    whole = subprocess.run([*command, *words], capture_output=True, text=True, check=False, timeout=280)
    assert whole.returncode == 0, whole.stderr
    with open_bag(recorded) as bag:
        assert {"/joint_command", "/joint_states"} <= set(bag.topics)


def test_control_c_while_a_launched_node_loads_its_libraries_is_no_traceback(tmp_path: Path) -> None:
    (tmp_path / "loading_node.py").write_text("print('loads', flush=True)\nimport time\ntime.sleep(30)\n")
    command = [sys.executable, "-c", table.QUIETLY, "loading_node", "--ros-args"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    with subprocess.Popen(command, env=environment, text=True, **pipes) as node:
        assert node.stdout is not None
        assert node.stdout.readline() == "loads\n"
        node.send_signal(signal.SIGINT)
        assert node.communicate(timeout=20)[1] == ""
    assert node.returncode == -signal.SIGINT


REFUSES = "import sys, time; print('mild_ros {}: model: is none; give one', file=sys.stderr); sys.exit(2)"
GOES_ON = """
import signal, sys
signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
while True:
    print('a line that scrolls the other away', file=sys.stderr, flush=True)
    signal.sigtimedwait([], 0.05)
"""


@pytest.mark.parametrize(("other", "respawn"), [(GOES_ON, "true"), (REFUSES.format("simulation"), "false")])
def test_a_refused_set_up_ends_a_launch_with_its_line_last(
    other: str, respawn: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """It would be refused again: it is no crash to start again after."""
    nodes = LAUNCHES["simulation"].nodes
    programs = (REFUSES.format("pipeline"), other)
    planted = [(node, [sys.executable, "-c", text]) for node, text in zip(nodes, programs, strict=True)]
    monkeypatch.setattr(table, "commands", lambda *_: planted)
    monkeypatch.setattr(table, "FAILED_S", 0.3)
    assert run_launch(LAUNCHES["simulation"], {"respawn": respawn}) == 2
    said = capfd.readouterr().err.splitlines()
    assert "model: is none" in said[-1]
    assert said.count("mild_ros pipeline: model: is none; give one") == 2, "when it happens, and at the end"


def test_the_default_configuration_is_there() -> None:
    assert {path.stem for path in CONFIGURATIONS} >= {"yumi", "yumi_abb", "pepper", "pepper_naoqi"}

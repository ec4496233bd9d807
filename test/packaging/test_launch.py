# SPDX-License-Identifier: Apache-2.0
"""What launch files start and set exists: executables, parameters of every configuration, files that are named."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
import yaml

from mild_core.retargeting.robot_file import find_robot
from mild_ros.assembly.perception import manifest_of
from mild_ros.assembly.robot import check_fit
from mild_ros.bag_settings import RecordParameters, ReplayParameters
from mild_ros.controllers import OUTPUTS
from mild_ros.joint_naming import joint_naming
from mild_ros.parameter_files import read_parameters
from mild_ros.settings import NODES, PipelineParameters
from mild_ros.share import model_names
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


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.stem)
def test_a_launch_file_names_what_there_is(path: Path) -> None:
    tree = ast.parse(path.read_text())
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == "Node"]
    executables = {keyword.value.value for call in calls for keyword in call.keywords if keyword.arg == "executable"}
    assert executables, "starts something"
    assert executables <= PARAMETERS.keys()
    arguments = next(node.value for node in tree.body if isinstance(node, ast.Assign))
    assert all(ast.literal_eval(arguments).values()), "every argument is explained"
    for word in (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)):
        if isinstance(word, str) and word.endswith(".launch.py") and " " not in word:
            assert (path.parent / word).is_file()


@pytest.mark.parametrize("name", ["live", "simulation"])
def test_nodes_of_a_robot_are_started_again_unless_it_is_forbidden(name: str) -> None:
    tree = ast.parse((ROOT / f"mild_ros/launch/{name}.launch.py").read_text())
    arguments = next(ast.literal_eval(node.value) for node in tree.body if isinstance(node, ast.Assign))
    assert arguments["respawn"][0] == "true"
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == "Node"]
    for node in nodes:
        given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
        assert (given["respawn"], given["respawn_delay"]) == ("given['respawn']", "RESPAWN_DELAY_S")
    text = (ROOT / "mild_ros/launch/simulation.launch.py").read_text()
    assert '"robot_from_camera", "use_sim_time", "respawn")\n' in text, "passed on to the pipeline"


def test_a_replay_ends_with_a_node_that_fails() -> None:
    assert '("respawn", "false")' in (ROOT / "mild_ros/launch/replay.launch.py").read_text()


def test_the_default_configuration_is_there() -> None:
    assert {path.stem for path in CONFIGURATIONS} >= {"yumi", "yumi_abb", "pepper", "pepper_naoqi"}

# SPDX-License-Identifier: Apache-2.0
"""What launch files start and set exists: executables, parameters of every configuration, files that are named."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
import yaml

from mild_ros.bag_settings import RecordParameters, ReplayParameters
from mild_ros.joint_naming import joint_naming
from mild_ros.parameters import from_values
from mild_ros.settings import NODES
from test.habits.tree import ROOT

CONFIGURATIONS = sorted((ROOT / "mild_ros/config").glob("*.yaml"))
LAUNCH_FILES = sorted((ROOT / "mild_ros/launch").glob("*.launch.py"))
PARAMETERS = {**NODES, "replay": ReplayParameters, "record": RecordParameters}


@pytest.mark.parametrize("path", CONFIGURATIONS, ids=lambda path: path.stem)
def test_every_configuration_is_accepted(path: Path) -> None:
    for name, content in yaml.safe_load(path.read_text()).items():
        assert name.startswith("/**/"), "fits any namespace"
        given = from_values(NODES[name.removeprefix("/**/")], content["ros__parameters"])
        names = getattr(given, "robot_joint_names", ())
        assert not names or joint_naming(tuple("abcdefg"[: len(names)]), names)


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


def test_the_default_configuration_is_there() -> None:
    assert {path.stem for path in CONFIGURATIONS} >= {"yumi", "yumi_abb"}

# SPDX-License-Identifier: Apache-2.0
"""The ten lines of README and the examples that need no ROS node run, as they stand."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import mild_core
from mild_core.retargeting.robot_file import find_robot
from mild_core.signals import RECOGNITION_STATES
from mild_ros.assembly.inference import load
from mild_ros.assembly.perception import skeleton_source
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.bag.camera import with_camera
from mild_ros.replay.in_process import Inputs, Step, replay_in_process
from test.habits.tree import ROOT

EXAMPLES = ROOT / "examples"


def test_each_example_is_short_and_named_by_the_tests() -> None:
    lines = {path.name: len(path.read_text().splitlines()) for path in EXAMPLES.iterdir() if path.is_file()}
    assert max(lines.values()) < 40, lines
    tests = "".join(path.read_text() for path in (ROOT / "test").rglob("test_*.py"))
    assert [name for name in lines if name not in tests and name != "my_robot.urdf"] == []


def test_the_public_names_are_there() -> None:
    assert {name: getattr(mild_core, name) for name in mild_core.__all__}.keys() <= set(dir(mild_core))
    assert {name for names in mild_core._PLACES.values() for name in names} == set(mild_core.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Robot'"):
        mild_core.Robot  # noqa: B018


def test_a_model_is_stepped_without_ros(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example = runpy.run_path(str(EXAMPLES / "step_a_model.py"))
    example["main"]()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 8
    assert all(line.startswith("handshake") or line.split()[0] in RECOGNITION_STATES for line in lines)

    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    assert len(block.splitlines()) <= 12
    frames = [*example["skeletons"](4.0)]
    standing = np.array([[0.0, 0.0, 0.9], [0.0, 0.36, 1.4], [0.0, 0.36, 1.1], [0.05, 0.36, 0.8]])
    names = ("pelvis", "left_shoulder", "left_elbow", "left_hand")
    rng = np.random.default_rng(1)
    whole = [
        mild_core.SkeletonFrame(
            frame.stamp_ns,
            frame.frame_id,
            1,
            (*frame.joint_names, *names),
            np.concatenate([frame.positions_m, standing + rng.normal(0.0, 0.001, standing.shape)]),
            np.ones(7),
        )
        for frame in frames
    ]
    (tmp_path / "readme.py").write_text(block)
    runpy.run_path(str(tmp_path / "readme.py"), init_globals={"frames": whole})
    assert len(capsys.readouterr().out.splitlines()) > 80


def test_a_robot_file_of_ones_own_moves() -> None:
    bag = ROOT / "bags/handshake"
    robot = str(EXAMPLES / "my_robot.toml")
    parameters = with_camera(PipelineParameters(robot=robot, model="nuisi_partner_next", interaction="handshake"), bag)
    pipeline = make_pipeline(parameters, load(parameters.model))
    found, ways = find_robot(robot), []

    def keep(step: Step) -> None:
        ways.extend(command.positions_rad for command in step.output.commands)

    summary = replay_in_process(bag, pipeline, Inputs(skeleton_source(parameters), found), on_step=keep)
    assert summary.commands > 100
    assert float(np.abs(np.array(ways) - found.home_rad).max()) > 0.2
    assert ((ways >= found.lower_rad) & (ways <= found.upper_rad)).all()


def test_a_replay_is_plotted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picture = tmp_path / "commands.png"
    monkeypatch.setattr(sys, "argv", ["replay_and_plot.py", str(ROOT / "bags/handshake"), str(picture)])
    runpy.run_path(str(EXAMPLES / "replay_and_plot.py"), run_name="__main__")
    assert picture.stat().st_size > 10_000

# SPDX-License-Identifier: Apache-2.0
"""Options of `mild replay`: parameters as the nodes take them, and flags only where they can work."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robots.yumi import YUMI
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.bag.reader import open_bag
from mild_ros.command_line.main import main
from mild_ros.command_line.result_folders import folder_of
from mild_ros.node_kit.parameter_files import changed, read_parameters
from mild_ros.replay.trial_bag import NEUTRAL_S, write_trial
from test.habits.tree import ROOT

OF_TWO_NODES = """
/**:
  ros__parameters: {robot: pepper, side: left}
/left/pipeline:
  ros__parameters:
    side: right
    joint_names: [right_hand, ""]
/**/simulation:
  ros__parameters: {gui: true}
"""


def test_what_is_named_counts_more_than_what_is_given_and_that_more_than_the_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(OF_TWO_NODES)
    given = ["max_gap_s:=0.2", "model:=a", "frame_id:='y'"]
    for name in (str(file), str(file.with_suffix(""))):
        read = read_parameters(PipelineParameters, "pipeline", name, given, model="b", source=None)
        assert changed(read) == {
            **{"robot": "pepper", "joint_names": ("right_hand", ""), "max_gap_s": 0.2, "model": "b", "frame_id": "y"},
        }, "those of all nodes first, then those of this one; none of another one"


@pytest.mark.parametrize(
    ("config", "given", "words"),
    [
        ("yumy", [], "config: 'yumy' is unknown; did you mean 'yumi'?"),
        ("", ["side=left"], "-p side=left: has no :="),
        ("", ["sid:=left"], "parameter: 'sid' is unknown; did you mean 'side'?"),
        ("", ["side:=[left"], "is no YAML"),
        ("", ["max_gap_s:=9.0"], "parameter max_gap_s: is 9 s; give a value in 0.01 … 2 s"),
        ("other", [], "has no parameters of pipeline"),
        ("flat", [], "pipeline has no ros__parameters"),
    ],
)
def test_what_is_wrong_is_one_line(
    config: str, given: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "other.yaml").write_text("/**/simulation: {ros__parameters: {gui: true}}")
    (tmp_path / "flat.yaml").write_text("pipeline: {side: left}")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SetupError) as refused:
        read_parameters(PipelineParameters, "pipeline", config, given)
    assert words in str(refused.value)


@pytest.mark.parametrize("words", [["--rate", "2"], ["--loop"], ["--paused"], ["--rate", "2", "--lock-step"]])
def test_what_needs_real_time_is_refused_without(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["replay", str(tmp_path / "bag"), "--out", str(tmp_path / "out"), *words])
    assert capsys.readouterr().err.startswith(f"mild: {words[0]}: needs nodes in real time")


@pytest.mark.parametrize("words", [["--config", "pepper"], ["--source", "nuitrack", "--dds"]])
def test_a_bag_of_another_tracker_is_refused_before_anything_runs(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["replay", str(ROOT / "bags" / "handshake"), "--out", str(tmp_path / "out"), *words])
    said = capsys.readouterr()
    assert "handshake: shows no person to nuitrack: it brings markers 100 to 131 in frame" in said.err
    assert "set source to azure_kinect" in said.err
    assert said.out == ""
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("robot", [YUMI, None])
def test_a_trial_becomes_a_bag_of_a_person_and_of_the_robot_if_one_answered(
    tmp_path: Path, robot: RobotModel | None
) -> None:
    arm_m = np.tile([[0.0, 0.0, 0.0], [0.0, 0.0, -0.3], [0.0, 0.0, -0.55]], (20, 1, 1))
    answer = np.zeros((20, 3, 3)) if robot is None else np.tile(robot.home_rad, (20, 1))
    write_trial(tmp_path / "bag", arm_m, robot, answer, 20.0)
    with open_bag(tmp_path / "bag") as bag:
        counts = {topic: summary.count for topic, summary in bag.topics.items()}
    people = {"/skeleton": 20 + round(NEUTRAL_S * 20.0)}
    assert counts == people | ({"/joint_states": 1, "/true_motion": people["/skeleton"]} if robot else {})


def test_two_bags_of_one_name_keep_their_results_and_the_same_bag_its_own(tmp_path: Path) -> None:
    bags = [tmp_path / place / "recorded" for place in ("a", "b")]
    for bag in bags:
        bag.mkdir(parents=True)
    bags.append(tmp_path / "recorded.mcap")
    bags[-1].touch()
    out = tmp_path / "out"
    names = [folder_of(out, bag).name for bag in (*bags, *bags)]
    assert names == ["recorded", "recorded_2", "recorded_3"] * 2
    (out / "take.1").mkdir()
    assert folder_of(out, tmp_path / "take.1").name == "take.1_2", "results that do not say of what they are"

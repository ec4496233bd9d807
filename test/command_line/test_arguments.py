# SPDX-License-Identifier: Apache-2.0
"""Wrong arguments are reported in one line before anything that takes its time is loaded."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mild_core.errors import SetupError
from mild_ros.assembly.arguments import check_parameters
from mild_ros.assembly.settings import PipelineParameters
from test.habits.tree import ROOT

BAG = str(ROOT / "bags" / "handshake")
SLOW_TO_LOAD = {"matplotlib", "pinocchio", "pybullet", "viser", "yourdfpy", "mild_core.inference.model"}

WRONG = {
    "interaction of model": ["replay", BAG, "--interaction", "handshak"],
    "interaction of model yumi_buetepage_ahead": ["demo", "--interaction", "handshak"],
    "model: 'yumi' is unknown": ["replay", BAG, "--model", "yumi"],
    "robot: 'yomi' is unknown": ["replay", BAG, "--dds", "-p", "robot:=yomi"],
    "did you mean 'yumi'": ["view", BAG, "-p", "robot:=yomi"],
    "parameter outputs": ["replay", BAG, "-p", "outputs:=[joint_trajektory]"],
    "parameter robot_from_camera": ["replay", BAG, "-p", "robot_from_camera:=1 2"],
    "parameter side": ["replay", BAG, "-p", "side:=middle"],
    "there is no such bag": ["replay", "bags/handshak"],
    "no_bag: there is no such bag": ["view", "no_bag"],
    "scene: 'handshak' is unknown": ["demo", "--scene", "handshak"],
    "it moves RShoulderPitch": ["demo", "--model", "pepper_nuisi_next"],
    "is no folder": ["replay", BAG, "--out", "file/out"],
    "unexpected extra argument(s) (model:=x); write -p model:=x": ["replay", BAG, "model:=x"],
    "write --model x": ["evaluate", "model:=x"],
    "no such option: --confg; did you mean '--config'?": ["replay", BAG, "--confg", "yumi"],
    "did you mean '--release'?": ["hold", "--relase"],
    "option '--start' requires an argument; see mild replay --help": ["replay", "--start"],
    "no such command 'qqq'; there are latent, window": ["plot", "qqq"],
    "missing option '--out'; see mild train --help": ["train"],
    "parameter model: is empty; give a text": ["replay", BAG, "-p", "model:="],
}

EACH = """
import io, json, sys
from contextlib import redirect_stderr
from mild_ros.command_line.main import main
results = []
for words in json.loads(sys.argv[1]):
    said = io.StringIO()
    with redirect_stderr(said):
        try:
            main(words)
        except SystemExit as ended:
            results.append([ended.code, said.getvalue()])
print(json.dumps([results, sorted(sys.modules)]))
"""


def test_each_is_one_line_and_loads_nothing_slow(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    command = [sys.executable, "-P", "-c", EACH, json.dumps(list(WRONG.values()))]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=120)
    results, loaded = json.loads(done.stdout.splitlines()[-1])
    for (code, said), words in zip(results, WRONG, strict=True):
        assert code == 2
        assert said.count("\n") == 1, said
        assert words in said
    assert SLOW_TO_LOAD & set(loaded) == set()
    assert [path.name for path in tmp_path.iterdir()] == ["file"], "nothing was made for a run that cannot be"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_of_another_user_is_no_place_for_results(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    command = [sys.executable, "-m", "mild_ros.command_line.main", "replay", BAG, "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, f"{tmp_path} cannot be written" in done.stderr) == (2, True)


@pytest.mark.parametrize("given", [{"robot_joint_names": ("a",)}, {"source": "motion_capture"}], ids=str)
def test_what_does_not_fit_is_refused(given: dict[str, object]) -> None:
    with pytest.raises(SetupError, match="joint_names"):
        check_parameters(PipelineParameters(**given))  # type: ignore[arg-type]


def test_defaults_are_accepted() -> None:
    check_parameters(PipelineParameters())

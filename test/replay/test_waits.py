# SPDX-License-Identifier: Apache-2.0
"""Every wait of a run is bounded and ends in one line, whatever its nodes do not do; and none of them stays behind."""

from __future__ import annotations

import os
import re
import signal
import sys
from pathlib import Path

import pytest

from mild_core.errors import SetupError
from mild_ros.assembly.bag_settings import FIRST_HEARD
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.command_line.main import main
from mild_ros.environment import processes
from mild_ros.environment.processes import Nodes
from mild_ros.replay import demo
from mild_ros.replay.demo import READY, RunOptions, run_nodes
from test.conftest import MARK, ROOT, processes_left
from test.replay.made_model import save_random_model
from test.replay.test_inputs import tracked

HANGING = """
import signal, sys
node = sys.argv[2].removeprefix("mild_ros.nodes.").removesuffix("_node")
print({said!r}.get(node, ""), flush=True)
signal.pause()
"""
"""A node that says a few words and then nothing more, for ever."""

AT_WORK = {"pipeline": READY.format(PipelineParameters().model), "record": FIRST_HEARD.format("/joint_command")}


@pytest.mark.parametrize(
    ("said", "last", "problem"),
    [
        ({}, "starting nodes", "are not ready within 1 s"),
        ({"pipeline": AT_WORK["pipeline"]}, "looking for each other", "do not hear each other within 1 s"),
        (AT_WORK, "looking for each other", "do not hear each other within 1 s"),
        (AT_WORK | {"replay": "replaying"}, "replaying", "did not end within 1 s"),
    ],
    ids=["load", "recorder", "replay", "end"],
)
def test_a_node_that_hangs_ends_the_run_in_one_line(
    said: dict[str, str], last: str, problem: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "PYTHON", (sys.executable, "-c", HANGING.format(said=said)))
    monkeypatch.setattr(demo, "PATIENCE_S", 1.0)
    monkeypatch.setattr(demo, "DISCOVERY_S", 1.0)
    monkeypatch.setattr(demo, "OVERDUE_S", 0.95)
    reported: list[str] = []
    before = processes_left(MARK)
    behind_its_end = RunOptions(start_s=100.0)
    with pytest.raises(SetupError, match=re.escape(f"nodes: {problem}; see {tmp_path}")):
        run_nodes(ROOT / "bags/handshake", tmp_path, behind_its_end, lambda what, share: reported.append(what))
    assert reported[-1] == last
    assert processes_left(MARK).keys() <= before.keys()


def test_a_closed_terminal_ends_a_run_in_order_unless_it_is_not_hung_up(tmp_path: Path) -> None:
    heard: list[int] = []
    numbers = (signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, lambda number, _frame: heard.append(number)) for number in numbers}
    try:
        for number in numbers:
            with pytest.raises(KeyboardInterrupt), Nodes(1, tmp_path):
                os.kill(os.getpid(), number)
            os.kill(os.getpid(), number)
        assert heard == list(numbers), "what was there before hears them again"
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        with Nodes(1, tmp_path):
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@pytest.mark.heavy
def test_live_too_the_last_line_says_why_the_robot_never_moved(
    tmp_path: Path, ros_domain: int, capfd: pytest.CaptureFixture[str]
) -> None:
    """The real nodes, in real time: a bag that is all zeros."""
    model = save_random_model(tmp_path / "random")
    bag = tracked(tmp_path / "bag", lambda index, time_ns: time_ns)
    with pytest.raises(SystemExit, match="2"):
        main(["replay", str(bag), "--dds", "--model", str(model), "--out", str(tmp_path / "out")])
    line = capfd.readouterr().err.splitlines()[-1]
    assert line.startswith("mild: replay: the robot never moved: the person was never calibrated: "), line
    assert "60 messages were 'zeroed'" in line

# SPDX-License-Identifier: Apache-2.0
"""Operating nodes without the `ros2` command: run, status, hold, enable, reset, record, over DDS."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mild_core.errors import SetupError
from mild_ros.bag.reader import open_bag
from mild_ros.command_line.main import main
from mild_ros.command_line.operator_client import meant
from mild_ros.command_line.run import NODES
from mild_ros.environment.processes import private_domain
from mild_ros.node_kit.running import check_words

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0


def mild(*words: str, **variables: str) -> subprocess.Popen[str]:
    """`./mild` with these words, started: several are asked for side by side, since each waits for DDS."""
    command = [sys.executable, "-m", "mild_ros.command_line.main", *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, cwd=ROOT, env=os.environ | variables, text=True, **pipes)


def ended(started: subprocess.Popen[str]) -> subprocess.CompletedProcess[str]:
    """What it has said, and its exit code."""
    with started:
        said = started.communicate(timeout=PATIENCE_S)
    return subprocess.CompletedProcess(started.args, started.returncode, *said)


@pytest.fixture(scope="module")
def pipeline(ros_domain: int, tmp_path_factory: pytest.TempPathFactory):  # type: ignore[no-untyped-def]
    """A pipeline that `mild run` has started.

    Its domain is its own: a pipeline that another test killed is seen for seconds after its end, and of two commanders
    none sends.
    """
    log = tmp_path_factory.mktemp("run") / "pipeline.log"
    command = [sys.executable, "-m", "mild_ros.command_line.main", "run", "pipeline", "-p", "interaction:=handshake"]
    with private_domain() as domain, pytest.MonkeyPatch.context() as patch, log.open("w") as output:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        process = subprocess.Popen(command, cwd=ROOT, stdout=output, stderr=subprocess.STDOUT)
        try:
            deadline = time.monotonic() + PATIENCE_S
            while "may command" not in log.read_text():
                assert process.poll() is None, log.read_text()
                assert time.monotonic() < deadline, log.read_text()
                time.sleep(0.05)
            yield process
            process.send_signal(signal.SIGINT)
            assert process.wait(20.0) == 0, "the signal reaches the node itself, and so does its exit code"
        finally:
            if process.poll() is None:
                process.kill()


def test_status_shows_every_node_and_its_mode(pipeline: subprocess.Popen[bytes]) -> None:
    for_people, for_programs = mild("status"), mild("status", "--json")
    shown = ended(for_people)
    assert shown.returncode == 0, shown.stderr
    assert "pipeline: waiting" in shown.stdout
    found = json.loads(ended(for_programs).stdout)
    assert [one["name"] for one in found] == ["pipeline"]
    assert found[0]["values"]["model"] == "yumi_buetepage_ahead"


def test_an_operator_holds_releases_disables_and_resets(pipeline: subprocess.Popen[bytes]) -> None:
    elsewhere = mild("hold", "--namespace", "left")
    for words, service in (
        (("hold",), "/pipeline/hold"),
        (("hold", "--release"), "/pipeline/hold"),
        (("enable", "--off"), "/pipeline/enable"),
        (("enable",), "/pipeline/enable"),
        (("reset",), "/pipeline/reset"),
    ):
        answered = ended(mild(*words))
        assert answered.returncode == 0, answered.stderr
        assert service in answered.stdout
    other = ended(elsewhere)
    assert other.returncode == 2
    assert "no node with ~/hold under left" in other.stderr


def test_record_writes_a_bag_and_ends_with_control_c(pipeline: subprocess.Popen[bytes], tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    command = [sys.executable, "-m", "mild_ros.command_line.main", "record", str(bag), "/diagnostics"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert process.stdout is not None
    try:
        for line in process.stdout:
            if "first message on /diagnostics" in line:
                break
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0
    finally:
        if process.poll() is None:
            process.kill()
        process.stdout.close()
    with open_bag(bag) as opened:
        assert set(opened.topics) == {"/diagnostics"}


NO_SERVER = "127.0.0.1:4"  # a port that only root can have, and no discovery server has


def test_where_nothing_runs_it_is_one_line_that_names_what_keeps_nodes_apart(ros_domain: int) -> None:
    server = {"ROS_DISCOVERY_SERVER": NO_SERVER}
    commands = [(word, server) for word in ("status", "hold")] + [("status", {})]
    commands += [("status", {"ROS_DISCOVERY_SERVER": "10.0.0.7:11811"})]
    for started, (_, variables) in [(mild(word, ROS_DOMAIN_ID="102", **more), (word, more)) for word, more in commands]:
        done = ended(started)
        assert done.returncode == 2
        assert len(done.stderr.strip().splitlines()) == 1
        assert "ROS domain 102" in done.stderr
        assert "start one: ./mild run pipeline" in done.stderr
        assert (f"ROS_DISCOVERY_SERVER: no server runs at {NO_SERVER}" in done.stderr) == (variables == server)
        assert ("is it ROS_DISCOVERY_SERVER=10" in done.stderr) == (variables not in (server, {}))


def test_a_call_means_the_services_of_its_name_and_type_under_its_namespace() -> None:
    setting, trigger = "std_srvs/srv/SetBool", "std_srvs/srv/Trigger"
    found = [
        ("/right/pipeline/hold", [setting]),
        ("/left/pipeline/hold", [setting]),
        ("/leftover/pipeline/hold", [setting]),
        ("/left/pipeline/reset", [trigger]),
        ("/left/gripper/hold", [trigger]),
        ("/left/pipeline/withhold", [setting]),
    ]
    assert meant("hold", "", found) == ["/left/pipeline/hold", "/leftover/pipeline/hold", "/right/pipeline/hold"]
    assert meant("hold", "/left/", found) == meant("hold", "left", found) == ["/left/pipeline/hold"]
    assert meant("reset", "", found) == ["/left/pipeline/reset"]
    assert meant("enable", "", found) == []


def test_an_unknown_node_suggests_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", "pipelin"])
    assert ended.value.code == 2
    assert "did you mean 'pipeline'?" in capsys.readouterr().err


def test_run_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", "--help"])
    assert ended.value.code == 0
    shown = capsys.readouterr().out
    assert all(node in shown for node in NODES)


@pytest.mark.parametrize("words", [["model:=x"], ["--ros-args", "model:=x"], ["--ros-args", "-p", "a:=1", "model:=x"]])
def test_a_forgotten_flag_does_not_run_the_default_model(words: list[str]) -> None:
    with pytest.raises(SetupError, match="write --ros-args -p model:=x"):
        check_words(words, ["model", "a"])


def test_a_parameter_without_a_value_is_one_line_of_ours() -> None:
    with pytest.raises(SetupError, match="-p model:=: has no value; give one, or leave it out"):
        check_words(["--ros-args", "-p", "model:="], ["model"])


def test_words_with_flags_are_taken() -> None:
    check_words(["--ros-args", "-p", "model:=x", "-r", "skeleton:=/a", "--log-level", "pipeline:=debug"], ["model"])

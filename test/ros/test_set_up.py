# SPDX-License-Identifier: Apache-2.0
"""Whatever is set up wrongly is one line on the terminal and exit code 2, never a traceback."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from mild_core.inference.manifest import ControlledAgent
from mild_core.inference.model import save_model
from test.core.inference.random_model import manifest, paper_member, random_arrays
from test.ros.processes import ROOT, START_S, NodeProcess, Probe, without_log_lines

pytestmark = pytest.mark.slow


def refused(node: NodeProcess, message: str) -> None:
    """It ends with code 2 and one line that begins with `message`."""
    assert node.wait() == 2, node.output()
    (line,) = without_log_lines(node.output())
    assert line.startswith(f"mild_ros {node.name}: {message}")
    assert "; " in line, "and says what would work"


@pytest.mark.parametrize(
    ("name", "parameters", "words", "message"),
    [
        ("retargeting", {"robot": "yummy"}, (), "robot: 'yummy' is unknown; did you mean 'yumi'?"),
        (
            "retargeting",
            {"control_rate_hz": 0.0},
            (),
            "parameter control_rate_hz: is 0 Hz; give a value in 10 … 500 Hz",
        ),
        ("retargeting", {"modell": "x"}, (), "parameter: 'modell' is unknown"),
        (
            "simulation",
            {"robot_description": "/no/such.urdf"},
            (),
            "parameter robot_description: no file /no/such.urdf",
        ),
        ("simulation", {}, ("--no-such-flag",), "--ros-args: "),
        ("simulation", {}, ("--params-file", "/no/such.yaml"), "--ros-args: "),
    ],
)
def test_a_wrong_set_up_is_one_line(
    start: Callable[..., NodeProcess], name: str, parameters: dict[str, object], words: tuple[str, ...], message: str
) -> None:
    refused(start(name, *words, **parameters), message)


@pytest.mark.parametrize("name", ["pipeline", "perception", "inference"])
def test_an_unknown_model_lists_those_there_are(start: Callable[..., NodeProcess], name: str) -> None:
    refused(start(name, model="yumi_buetepage_ahed"), "model: 'yumi_buetepage_ahed' is unknown; ")
    refused(start(name, model="/no/such/folder"), "model /no/such/folder: no such folder; ")


def cut_in_half(folder: Path) -> None:
    weights = folder / "weights.safetensors"
    weights.write_bytes(weights.read_bytes()[: weights.stat().st_size // 2])


def altered(folder: Path) -> None:
    weights = bytearray((folder / "weights.safetensors").read_bytes())
    weights[-100] ^= 1
    (folder / "weights.safetensors").write_bytes(weights)


def without_golden(folder: Path) -> None:
    (folder / "golden.npz").unlink()


def not_json(folder: Path) -> None:
    (folder / "manifest.json").write_text("{")


@pytest.mark.parametrize(
    ("harm", "file"),
    [
        (cut_in_half, "weights.safetensors"),
        (altered, "weights.safetensors"),
        (without_golden, "golden.npz"),
        (not_json, "manifest.json"),
    ],
)
def test_a_model_that_cannot_be_trusted_is_refused(
    start: Callable[..., NodeProcess], random_model: Path, tmp_path: Path, harm: Callable[[Path], None], file: str
) -> None:
    folder = tmp_path / "model"
    shutil.copytree(random_model, folder)
    harm(folder)
    refused(start("inference", model=folder), f"{folder / file}: ")


def test_a_model_of_another_robot_is_refused(start: Callable[..., NodeProcess], tmp_path: Path) -> None:
    joints = tuple(f"joint_{number}" for number in range(7))
    of = manifest((paper_member(),), controlled=ControlledAgent("robot_joints", "other", joints, "rad"))
    save_model(tmp_path / "model", of, random_arrays(of), "Random weights.\n")
    refused(start("pipeline", model=tmp_path / "model"), f"model {tmp_path / 'model'}: it moves joint_0, joint_1")


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            {"interaction": "hand_shak"},
            "interaction of model random: 'hand_shak' is unknown; did you mean",
        ),
        ({"source": "azure_kinetic"}, "parameter source: 'azure_kinetic' is unknown; did you mean 'azure_kinect'?"),
        ({"joint_names": ["right_hand"]}, "parameter joint_names: azure_kinect names its joints"),
        ({"source": "pose_array"}, "joint_names: [] has no joints"),
        ({"source": "pose_array", "joint_names": ["right_hnd"]}, "joint_names: 'right_hnd' is unknown; did you mean"),
        (
            {"source": "pose_array", "joint_names": ["right_shoulder", "right_elbow"]},
            "source pose_array: the model {model} observes right_hand, which the tracker does not give",
        ),
    ],
)
def test_what_does_not_fit_the_model_is_one_line(
    start: Callable[..., NodeProcess], random_model: Path, parameters: dict[str, object], message: str
) -> None:
    refused(start("pipeline", model=random_model, **parameters), message.format(model=random_model))


@pytest.mark.parametrize(
    ("variable", "value", "message"),
    [
        ("ROS_DOMAIN_ID", "233", "ROS_DOMAIN_ID: is '233'; set it to a number from 0 to 101, or up to 232 "),
        ("ROS_DOMAIN_ID", "mine", "ROS_DOMAIN_ID: is 'mine'; set it to a number from 0 to 101, or up to 232 "),
        ("HOME", "/proc/nowhere", "ROS log: failed to initialize logging: "),
        (
            "ROS_STATIC_PEERS",
            "10.0.0.300",
            "ROS_STATIC_PEERS: '10.0.0.300' is no IPv4 address and no name known here, so no node starts; correct it",
        ),
    ],
)
def test_a_wrong_environment_is_one_line(
    start: Callable[..., NodeProcess], monkeypatch: pytest.MonkeyPatch, variable: str, value: str, message: str
) -> None:
    monkeypatch.delenv("ROS_LOG_DIR")
    monkeypatch.setenv(variable, value)
    node = start("simulation")
    refused(node, message)
    assert ("set ROS_LOG_DIR to a folder that can be written" in node.output()) == (variable == "HOME")


def test_a_node_that_sees_no_other_names_what_of_the_environment_may_be_why(
    start: Callable[..., NodeProcess], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", "127.0.0.1:4")
    wrong = "ROS_DISCOVERY_SERVER: no server runs at 127.0.0.1:4"
    node = start("simulation")
    deadline_s = time.monotonic() + START_S
    while "no other node is seen" not in node.output():
        assert time.monotonic() < deadline_s, node.output()
        time.sleep(0.05)
    first, *_, last = node.output().splitlines()
    assert first.startswith(f"mild_ros simulation: {wrong}"), "before whatever DDS says"
    assert wrong in last


def test_help_lists_the_parameters() -> None:
    command = [sys.executable, "-m", "mild_ros.nodes.retargeting_node", "--help"]
    answer = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True)
    assert "control_rate_hz (default 100.0) [10 … 500 Hz]" in answer.stdout


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_while_loading_ends_it_too(start: Callable[..., NodeProcess], probe: Probe, number: int) -> None:
    node = start("simulation")
    # In the graph from the constructor of the node on, so it may still be loading the robot.
    probe.until(lambda: "simulation" in probe.node.get_node_names(), "the node in the graph")
    assert node.stop(number) == 0
    assert "Traceback" not in node.output()

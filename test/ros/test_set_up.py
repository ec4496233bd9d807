# SPDX-License-Identifier: Apache-2.0
"""Whatever is set up wrongly is one line on the terminal and exit code 2, never a traceback."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable

import pytest

from test.ros.processes import ROOT, NodeProcess, Probe, without_log_lines


@pytest.mark.parametrize(
    ("name", "parameters", "words", "message"),
    [
        ("retargeting", {"robot": "yummy"}, (), "parameter robot: 'yummy' is unknown; did you mean 'yumi'?"),
        (
            "retargeting",
            {"control_rate_hz": 0.0},
            (),
            "parameter control_rate_hz: is 0 Hz; give a value in 10 … 500 Hz",
        ),
        ("retargeting", {"model": "x"}, (), "parameter: 'model' is unknown"),
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
    node = start(name, *words, **parameters)
    assert node.wait() == 2, node.output()
    (line,) = without_log_lines(node.output())
    assert line.startswith(f"mild_ros {name}: {message}")


def test_help_lists_the_parameters() -> None:
    command = [sys.executable, "-m", "mild_ros.retargeting_node", "--help"]
    answer = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True)
    assert "control_rate_hz (default 100.0) [10 … 500 Hz]" in answer.stdout


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_loading_ends_it_too(start: Callable[..., NodeProcess], probe: Probe, number: int) -> None:
    node = start("simulation")
    # In the graph from the constructor of the node on, so it may still be loading the robot.
    probe.until(lambda: "simulation" in probe.node.get_node_names(), "the node in the graph")
    assert node.stop(number) == 0
    assert "Traceback" not in node.output()

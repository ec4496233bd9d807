# SPDX-License-Identifier: Apache-2.0
"""Nodes and a probe that end with the test, however it ends."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mild_ros.node_kit.priorities import CONTROL
from test.replay.made_model import save_random_model
from test.ros.processes import NodeProcess, Probe


@pytest.fixture
def start(tmp_path: Path, ros_domain: int) -> Iterator[Callable[..., NodeProcess]]:
    """Starts nodes: `start(name, *words, **parameters)`; those still alive afterwards must end with code 0."""
    started: list[NodeProcess] = []

    def begin(name: str, *words: str, **parameters: object) -> NodeProcess:
        started.append(NodeProcess(name, parameters, tmp_path / f"{name}-{len(started)}.log", words))
        return started[-1]

    try:
        yield begin
        alive = [node for node in started if node.process.poll() is None]
        for node in alive:
            assert node.stop() == 0, f"{node.name}:\n{node.output()}"
    finally:
        for node in started:
            if node.process.poll() is None:
                node.kill()


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Probe]:
    """The test's own node."""
    probe = Probe()
    yield probe
    probe.close()


@pytest.fixture(scope="session")
def real_time() -> bool:
    """Whether programs here may have the priority that control wants; tried in a process of its own."""
    attempt = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({CONTROL}))"
    return subprocess.run([sys.executable, "-c", attempt], stderr=subprocess.DEVNULL, check=False).returncode == 0


@pytest.fixture(scope="session")
def random_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a model with random weights that knows the arm of our scenes and everything else."""
    return save_random_model(tmp_path_factory.mktemp("models") / "random")

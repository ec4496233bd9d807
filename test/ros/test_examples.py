# SPDX-License-Identifier: Apache-2.0
"""The examples of a tracker and of an operator, beside a live pipeline."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from test.ros.processes import NodeProcess, Probe
from test.ros.surroundings import Surroundings

EXAMPLES = Path(__file__).parents[2] / "examples"

pytestmark = pytest.mark.slow


def test_a_tracker_of_ones_own_is_followed_and_a_script_commands(
    start: Callable[..., NodeProcess], probe: Probe, random_model: Path
) -> None:
    joints = ["pelvis", "left_shoulder", "right_shoulder", "right_elbow", "right_hand"]
    start(
        *("pipeline",),
        model=random_model,
        interaction="hand_shake",
        source="pose_array",
        source_axes="rep103",
        joint_names=joints,
        enabled=False,
    )
    around = Surroundings(probe, "pipeline")
    tracker = subprocess.Popen([sys.executable, EXAMPLES / "my_tracker.py"])
    try:
        probe.until(
            lambda: around.reports and int(around.status()[2].get("perception accepted", "0")) > 10, "a followed arm"
        )
        done = subprocess.run(
            [sys.executable, EXAMPLES / "operate.py"], capture_output=True, text=True, timeout=120, check=False
        )
        assert done.returncode == 0, done.stderr
        assert len(done.stdout.splitlines()) == 5
        assert "hand_shake" in done.stdout
    finally:
        tracker.terminate()
        tracker.wait(20.0)

# SPDX-License-Identifier: Apache-2.0
"""Control-C and SIGTERM end a run of real nodes in order: nothing stays behind, and what was recorded is whole."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mild_ros.bag.reader import open_bag
from test.conftest import MARK, ROOT, processes_left
from test.replay.processes import wait_until

PATIENCE_S = 240.0
"""The first start of all after a change compiles."""


def _heed_control_c() -> None:
    """A process that is started in the background of a shell is made to ignore it, and hands that down."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "command", "log", "words"),
    [
        (signal.SIGINT, ("replay", "bags/handshake", "--dds"), "replay.log", "replaying"),
        (signal.SIGTERM, ("demo",), "record.log", "recording"),
    ],
)
def test_a_signal_ends_every_node(
    tmp_path: Path, ros_domain: int, number: int, command: tuple[str, ...], log: str, words: str
) -> None:
    before = processes_left(MARK)
    words_of_mild = [sys.executable, "-m", "mild_ros.command_line.main", *command, "--out", str(tmp_path)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(words_of_mild, cwd=ROOT, text=True, preexec_fn=_heed_control_c, **pipes) as mild:
        said = tmp_path / "log" / log

        def running() -> bool:
            assert mild.poll() is None, mild.communicate()
            return said.exists() and words in said.read_text()

        wait_until(running, f"{words} in {log}", PATIENCE_S)
        mild.send_signal(number)
        _, errors = mild.communicate(timeout=60)
    assert mild.returncode == 130
    assert errors == "mild: interrupted\n"
    assert processes_left(MARK).keys() <= before.keys()
    with open_bag(tmp_path / "recorded") as bag:
        assert len(list(bag.messages())) == sum(topic.count for topic in bag.topics.values())

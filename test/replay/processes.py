# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes of their own, ended however a test ends, and waiting with a deadline."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

DEADLINE_S = 180.0
"""A node needs a second or two to start; this machine may be busy with much else."""


@contextmanager
def node(
    name: str, parameters: Mapping[str, object], *extra: str, **options: object
) -> Iterator[subprocess.Popen[str]]:
    """The node `name` with these parameters; SIGTERM when the block is left."""
    arguments = [f"{key}:={value}" for key, value in parameters.items()]
    words = [word for argument in arguments for word in ("-p", argument)]
    command = [sys.executable, "-m", f"mild_ros.nodes.{name}_node", "--ros-args", *words, *extra]
    process = subprocess.Popen(
        command,
        cwd=Path(__file__).parents[2],
        env=dict(os.environ),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.terminate()
        try:
            process.communicate(timeout=DEADLINE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise


def wait_until(happened: Callable[[], bool], what: str, seconds: float = DEADLINE_S) -> None:
    """Return as soon as `happened`, fail after the deadline."""
    deadline = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < deadline, f"no {what} within {seconds:g} s"
        time.sleep(0.02)

# SPDX-License-Identifier: Apache-2.0
"""Real nodes in processes of their own, and one node in the test that talks to them over DDS."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

ROOT = Path(__file__).parents[2]
START_S = 120.0
"""A node needs a second or two to start; a busy machine may take long, and recompiling a quarter of a minute."""

END_S = 10.0
"""A node ends within a fifth of a second; a busy machine may take longer."""


class NodeProcess:
    """A node of ours as a process.

    Args:
        name: Of the executable.
        parameters: By name, as on the command line.
        log: File that gets what it prints.
        words: Further words of the command line, after `--ros-args`.
    """

    def __init__(self, name: str, parameters: Mapping[str, object], log: Path, words: tuple[str, ...] = ()) -> None:
        given = [word for key, value in parameters.items() for word in ("-p", f"{key}:={_yaml(value)}")]
        command = [sys.executable, "-m", f"mild_ros.nodes.{name}_node", "--ros-args", *given, *words]
        self.name, self._log = name, log
        with log.open("w") as output:
            self.process = subprocess.Popen(command, cwd=ROOT, stdout=output, stderr=subprocess.STDOUT)

    def output(self) -> str:
        """What it has printed so far."""
        return self._log.read_text()

    def wait(self, seconds: float = START_S) -> int:
        """Wait for it to end by itself; its exit code."""
        return self.process.wait(seconds)

    def stop(self, number: int = signal.SIGTERM) -> int:
        """Signal it and wait; its exit code."""
        self.process.send_signal(number)
        return self.process.wait(END_S)

    def kill(self) -> None:
        """For the end of a test that failed."""
        self.process.kill()
        self.process.wait()


class Probe:
    """A node inside the test: publishes, listens, calls services, always with a deadline.

    Args:
        namespace: Before the names of its topics.
    """

    def __init__(self, namespace: str = "") -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = Node("probe", namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def listen(self, message_type: type, topic: str, quality: Any = 50) -> list[Any]:
        """A list that grows by every message that comes."""
        heard: list[Any] = []
        self.node.create_subscription(message_type, topic, heard.append, quality)
        return heard

    def spin(self, seconds: float = 0.02) -> None:
        """Take what has come, for at most so long."""
        self._executor.spin_once(timeout_sec=seconds)

    def until(
        self, happened: Callable[[], Any], what: str, seconds: float = START_S, seen: Callable[[], Any] = lambda: ""
    ) -> Any:
        """Spin until `happened` gives something true, which is returned; `seen` says what was there instead."""
        deadline = time.monotonic() + seconds
        while not (found := happened()):
            assert time.monotonic() < deadline, f"{what}: not within {seconds:g} s {seen()}"
            self.spin()
        return found

    def matched(self, publisher: Any, count: int = 1) -> None:
        """Wait until so many subscribers listen."""
        self.until(
            lambda: publisher.get_subscription_count() >= count, f"{count} subscribers of {publisher.topic_name}"
        )

    def call(self, service_type: type, name: str, request: Any) -> Any:
        """The answer of a service."""
        client = self.node.create_client(service_type, name)
        self.until(client.service_is_ready, f"service {name}")
        future = client.call_async(request)
        self.until(future.done, f"answer of {name}")
        return future.result()

    def now_ns(self) -> int:
        return int(self.node.get_clock().now().nanoseconds)


def _yaml(value: object) -> str:
    """A value as `-p name:=value` wants it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple | list):
        return "[" + ", ".join(f'"{item}"' for item in value) + "]"
    return str(value)


def without_log_lines(output: str) -> list[str]:
    """Lines that are no line of the ROS log."""
    return [line for line in output.splitlines() if line and not re.match(r"\[(INFO|WARN|ERROR|FATAL)\]", line)]

# SPDX-License-Identifier: Apache-2.0
"""No callback of a node ends it: what one raises is counted, named, an ERROR, and the next message is taken."""

from __future__ import annotations

import ast
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from mild_core.errors import DataError
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.guarded import GuardedNode

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.slow


class Fragile(GuardedNode):
    """Raises what a message says."""

    def __init__(self) -> None:
        super().__init__("fragile")
        self.taken: list[str] = []
        self.lost = 0
        self.diagnostics = Diagnostics(self, ())
        self.diagnostics.alarms["frame"] = (DiagnosticStatus.WARN, "in frame 'camera\r\n[INFO] all is well'")
        self.on_lost = self._count
        self.create_subscription(String, "words", self._on_word, 50)
        self.create_service(Trigger, "~/break", self._on_break)
        self.create_timer(0.05, self._on_time)

    def _count(self) -> None:
        self.lost += 1

    def _on_word(self, message: Any) -> None:
        match message.data:
            case "value":
                raise ValueError("\x1b[31mcannot convert float NaN to integer\n[FATAL] forged")
            case "index":
                raise IndexError("0 rows")
            case "data":
                raise DataError("wrong_layout", "nothing is in it")
        self.taken.append(message.data)

    def _on_break(self, _wish: Any, _answer: Any) -> Any:
        raise RuntimeError("broken")

    def _on_time(self) -> None:
        raise OSError("no room")


@pytest.fixture
def spun(ros_domain: int) -> Iterator[tuple[Fragile, Node, Callable[[Callable[[], Any], str], Any]]]:
    rclpy.init()
    node, other, executor = Fragile(), Node("other"), EventsExecutor()
    executor.add_node(node)
    executor.add_node(other)

    def until(happened: Callable[[], Any], what: str) -> Any:
        end_s = time.monotonic() + 60.0
        while not (found := happened()):
            assert time.monotonic() < end_s, what
            executor.spin_once(timeout_sec=0.05)
        return found

    yield node, other, until
    for one in (node, other):
        executor.remove_node(one)
        one.destroy_node()
    executor.shutdown()
    rclpy.try_shutdown()


def test_whatever_a_callback_raises_is_counted_and_the_node_goes_on(spun: Any) -> None:
    node, other, until = spun
    reports: list[Any] = []
    other.create_subscription(DiagnosticArray, "/diagnostics", lambda array: reports.append(array.status[0]), 10)
    words = other.create_publisher(String, "words", 50)
    until(lambda: words.get_subscription_count(), "a subscription")
    for word in ("value", "index", "data", "good"):
        words.publish(String(data=word))
    until(lambda: node.taken == ["good"], "the good word after the bad ones")
    assert node.lost >= 3
    client = other.create_client(Trigger, "/fragile/break")
    until(client.service_is_ready, "the service")
    answer = client.call_async(Trigger.Request())
    until(answer.done, "an answer")
    assert (answer.result().success, answer.result().message) == (False, "failed (RuntimeError); see the log")

    def reported() -> Any:
        return next((one for one in reports if "words IndexError: 0 rows" in one.message), None)

    status = until(reported, "a report")
    assert status.level == DiagnosticStatus.ERROR
    assert "on_time OSError: no room" in status.message
    assert "in frame 'camera\\x0d\\x0a[INFO] all is well'" in status.message, "a foreign line is no line of ours"
    assert "ValueError: \\x1b[31mcannot convert" in status.message
    values = {pair.key: pair.value for pair in status.values}
    assert int(values["messages unusable"]) >= 3
    assert int(values["messages wrong_layout"]) == 1
    assert all(text.isprintable() for text in (status.message, *values, *values.values()))


def test_every_node_of_ours_is_guarded() -> None:
    found = []
    for path in (ROOT / "mild_ros" / "nodes").glob("*_node.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and node.name.endswith("Node"):
                found.append(node.name)
                assert [base.id for base in node.bases if isinstance(base, ast.Name)] != ["Node"], path
    assert len(found) >= 8

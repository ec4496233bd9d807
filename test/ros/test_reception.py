# SPDX-License-Identifier: Apache-2.0
"""Reception over DDS: what is used of a flood is bounded, the newest always is, and every message is accounted for."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from std_msgs.msg import String

from mild_ros.assembly.settings import PerceptionParameters
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.parameters import declare
from mild_ros.node_kit.quality_of_service import SENSOR
from mild_ros.node_kit.reception import FLOOD_REST, KEPT, PER_S, Reception
from mild_ros.node_kit.threads import StageNode
from test.ros.processes import Probe


class Heard:
    """A node of ours that writes down what it takes."""

    def __init__(self) -> None:
        self.node = StageNode("hears")
        declare(self.node, PerceptionParameters)
        self.diagnostics = Diagnostics(self.node, ("words",))
        self.texts: list[str] = []
        self.work_s = 0.0
        self.reception = Reception(self.node, self.diagnostics)
        self.reception.subscribe(String, "words", self._on_word, SENSOR)

    def _on_word(self, message: Any) -> None:
        self.texts.append(message.data)
        end_s = time.thread_time() + self.work_s
        while time.thread_time() < end_s:
            pass
        self.diagnostics.flowed("words")

    def counted(self) -> tuple[int, int, int]:
        """Messages that were used, that newer ones took the place of, and that never came."""
        dropped = int(self.diagnostics._superseded["words"])
        return len(self.texts), dropped, self.diagnostics._streams["words"].lost


@pytest.fixture
def heard(ros_domain: int, tmp_path: Path) -> Iterator[Heard]:
    rclpy.init()
    heard = Heard()
    executor = SingleThreadedExecutor()
    executor.add_node(heard.node)
    heard.node.start_threads()
    yield heard
    heard.node.stop_threads()
    executor.shutdown()
    heard.node.destroy_node()
    rclpy.try_shutdown()


def until_taken(probe: Probe, heard: Heard, text: str) -> None:
    probe.until(lambda: heard.texts and heard.texts[-1] == text, f"{text} is taken", 20.0)


def test_of_a_flood_so_many_a_second_are_used_and_the_last_one_is_among_them(heard: Heard, probe: Probe) -> None:
    words = probe.node.create_publisher(String, "words", SENSOR)
    probe.matched(words)
    words.publish(String(data="first"))
    until_taken(probe, heard, "first")
    started_s, sent = time.monotonic(), 1
    while time.monotonic() < started_s + 1.0:
        for _ in range(10):
            words.publish(String(data=str(sent)))
            sent += 1
        probe.spin(0.001)
    words.publish(String(data="last"))
    until_taken(probe, heard, "last")
    used, dropped, lost = heard.counted()
    assert used <= KEPT + 1 + PER_S * (time.monotonic() - started_s)
    assert used >= 20, "a flood shuts out no other publisher"
    assert used + dropped + lost == sent + 1


def test_a_flood_is_followed_by_a_rest_of_twice_its_work_and_a_message_by_none(heard: Heard, probe: Probe) -> None:
    heard.node.stop_threads()
    heard.work_s = 0.01
    words = probe.node.create_publisher(String, "words", SENSOR)
    probe.matched(words)
    waiting = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, heard.node.context.handle)
    words.publish(String(data="one"))
    probe.until(lambda: heard.reception._receive(waiting) == 0.0 and heard.texts == ["one"], "it is used")
    rests_s: list[float] = []

    def flooded() -> bool:
        for _ in range(3 * KEPT):
            words.publish(String(data="flood"))
        count = len(heard.texts)
        rests_s.append(heard.reception._receive(waiting))
        return rests_s[-1] > 0.0 and rests_s[-1] >= FLOOD_REST * heard.work_s * (len(heard.texts) - count)

    probe.until(flooded, "a rest", 2.0, lambda: rests_s)
    assert rests_s[-1] >= FLOOD_REST * heard.work_s


def test_what_has_no_place_in_dds_is_lost_and_nothing_else_is(heard: Heard, probe: Probe) -> None:
    words = probe.node.create_publisher(String, "words", SENSOR)
    probe.matched(words)
    words.publish(String(data="first"))
    until_taken(probe, heard, "first")
    assert heard.counted() == (1, 0, 0)
    held = threading.Event()
    with heard.reception.lock:
        words.publish(String(data="waits for the lock"))
        held.wait(0.1)
        for number in range(120):
            words.publish(String(data=str(number)))
            probe.spin(0.001)
    words.publish(String(data="last"))
    until_taken(probe, heard, "last")
    used, dropped, lost = heard.counted()
    assert used + dropped + lost == 123
    assert lost == pytest.approx(120 + 1 - SENSOR.depth, abs=1), "`last` may be taken together with them or after them"


def test_of_two_publishers_no_loss_is_counted(heard: Heard, probe: Probe) -> None:
    words = [probe.node.create_publisher(String, "words", SENSOR) for _ in range(2)]
    probe.until(lambda: heard.node.count_publishers("words") == 2, "both")
    for number in range(200):
        words[number % 2].publish(String(data=str(number)))
        words[0].publish(String(data="more"))
        probe.spin(0.001)
    words[1].publish(String(data="last"))
    until_taken(probe, heard, "last")
    assert heard.counted()[2] == 0

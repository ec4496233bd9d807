# SPDX-License-Identifier: Apache-2.0
"""`python -m mild_ros.hearing`: who is heard over DDS, for `mild doctor`, which asks in processes of their own.

    python -m mild_ros.hearing hello NAME SECONDS [WANTED]   says NAME, prints the names that it hears
    python -m mild_ros.hearing reports SECONDS               prints the newest report of each node on /diagnostics

Both print one line of JSON.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from std_msgs.msg import String

PERIOD_S = 0.05
STAY_S = 1.0
"""Whoever has heard the other one goes on for so long, for the other one's sake."""


def hello(node: Node, name: str, seconds: float, wanted: str = "") -> list[str]:
    """Say a name until another is heard (`wanted`, or any), and a little longer.

    Returns:
        The names heard, sorted.
    """
    heard: set[str] = set()

    def take(message: Any) -> None:
        heard.add(message.data)

    node.create_subscription(String, "/mild_doctor", take, 10)
    sender = node.create_publisher(String, "/mild_doctor", 10)
    node.create_timer(PERIOD_S, lambda: sender.publish(String(data=name)))  # it hears itself too: no loop sets the pace
    end_s = time.monotonic() + seconds
    found = False
    while time.monotonic() < end_s:
        rclpy.spin_once(node, timeout_sec=PERIOD_S)
        others = heard - {name}
        if not found and (wanted in others if wanted else bool(others)):
            found, end_s = True, min(end_s, time.monotonic() + STAY_S)
    return sorted(heard - {name})


def reports(node: Node, seconds: float) -> dict[str, dict[str, Any]]:
    """What each node says of itself: level, message and values by name."""
    newest: dict[str, dict[str, Any]] = {}

    def take(message: Any) -> None:
        for status in message.status:
            values = {value.key: value.value for value in status.values}
            newest[status.name] = {"level": ord(status.level), "message": status.message, "values": values}

    node.create_subscription(DiagnosticArray, "/diagnostics", take, 10)
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        rclpy.spin_once(node, timeout_sec=PERIOD_S)
    return newest


def main(words: list[str]) -> None:
    """Run one of the two and print."""
    rclpy.init(args=[])
    node = rclpy.create_node(f"mild_doctor_{time.monotonic_ns()}")
    try:
        if words[0] == "hello":
            found: Any = hello(node, words[1], float(words[2]), *words[3:])
        else:
            found = reports(node, float(words[1]))
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1:])

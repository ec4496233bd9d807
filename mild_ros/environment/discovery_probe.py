# SPDX-License-Identifier: Apache-2.0
"""Discovery over DDS for `mild doctor`, in a process of its own (`python -m mild_ros.environment.discovery_probe`).

One of:

    hello NAME SECONDS [WANTED]   says NAME, prints the names that it hears
    reports SECONDS               prints the newest report of each node on /diagnostics
    senders SECONDS               prints which node publishes what, and what arrived of it

Each prints one line of JSON to standard output, and nothing else: what Fast DDS prints goes to standard error.
"""

from __future__ import annotations

import json
import os
import sys
import time
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import String

from mild_core.errors import SetupError
from mild_ros.messages.message_types import message_class
from mild_ros.node_kit.dds_variables import PAIRED, UNNAMED
from mild_ros.node_kit.quality_of_service import SENSOR
from mild_ros.node_kit.ros_errors import refused_in_one_line

PERIOD_S = 0.05
OWN_NAME = "mild_doctor_"
"""Names of the doctor's nodes begin so."""

OF_EVERY_NODE = ("/rosout", "/parameter_events", "/mild_doctor")
"""Topics on which a node may be silent for ever."""

UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""What rclpy calls a node whose name has not arrived."""

MOST_TOPICS = 60
"""So many are listened to."""

STAY_S = 1.0
"""A process that has heard its peer goes on for this long, so that the peer hears it too [s]."""


def hello(node: Node, name: str, seconds: float, wanted: str = "") -> list[str]:
    """Say a name until another is heard (`wanted`, or any), and a little longer.

    Returns:
        The names heard, sorted.
    """
    heard: set[str] = set()

    def take(message: Any) -> None:
        heard.add(message.data)

    def others() -> set[str]:
        """Names of others; a process that looks for all others excludes pairs that look for each other."""
        return {one for one in heard - {name} if wanted or not one.startswith(PAIRED)}

    node.create_subscription(String, "/mild_doctor", take, 10)
    sender = node.create_publisher(String, "/mild_doctor", 10)
    node.create_timer(PERIOD_S, lambda: sender.publish(String(data=name)))  # it hears itself too: no loop sets the pace
    end_s = time.monotonic() + seconds
    found = False
    while time.monotonic() < end_s:
        rclpy.spin_once(node, timeout_sec=PERIOD_S)
        if not found and (wanted in others() if wanted else bool(others())):
            found, end_s = True, min(end_s, time.monotonic() + STAY_S)
    return sorted(others())


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


@dataclass
class Sender:
    """Another node, as it is seen and heard.

    Attributes:
        publishes: Topics that it offers, but for those of every node.
        came: Those of them on which something arrived, of whichever publisher.
        answers: Whether it answered a request; None where it could not be asked: it serves no parameters, or its name
            did not arrive either.
    """

    publishes: list[str] = field(default_factory=list)
    came: list[str] = field(default_factory=list)
    answers: bool | None = None


def senders(node: Node, seconds: float) -> dict[str, dict[str, Any]]:
    """Every other node of the domain: what it publishes, what arrived of that, and whether it answers.

    Publishers are known from DDS itself, names of nodes from a message: of a node that is seen and not heard the name
    is missing, here `UNNAMED`.
    """
    came: set[str] = set()
    listening: set[str] = set()
    asked: dict[str, tuple[Client, Future]] = {}
    end_s = time.monotonic() + seconds
    found: dict[str, Sender] = {}
    while time.monotonic() < end_s:
        found = {}
        for topic, kinds in node.get_topic_names_and_types():
            if topic in OF_EVERY_NODE:
                continue
            for name in _publishers(node, topic):
                found.setdefault(name, Sender()).publishes.append(topic)
            kind = message_class(kinds[0])
            if topic not in listening and kind is not None and len(listening) < MOST_TOPICS:
                listening.add(topic)
                node.create_subscription(kind, topic, partial(_note, came, topic), SENSOR, raw=True)
        for name in found:
            _ask(node, name, asked)
        rclpy.spin_once(node, timeout_sec=PERIOD_S)
    for name, sender in found.items():
        sender.came = sorted(came & set(sender.publishes))
        sender.answers = asked[name][1].done() if name in asked else None
    return {name: asdict(sender) for name, sender in sorted(found.items())}


def _publishers(node: Node, topic: str) -> set[str]:
    """Full names of the nodes that publish a topic, but for the doctor's and hidden ones."""
    ends = {(one.node_name, one.node_namespace) for one in node.get_publishers_info_by_topic(topic)}
    names = {UNNAMED if name == UNKNOWN else f"{namespace.rstrip('/')}/{name}" for name, namespace in ends}
    return {name for name in names if not name.rpartition("/")[2].startswith((OWN_NAME, "_"))}


def _note(came: set[str], topic: str, _data: bytes) -> None:
    came.add(topic)


def _ask(node: Node, name: str, asked: dict[str, tuple[Client, Future]]) -> None:
    """Ask a node once for its parameters, as soon as it is seen to serve them: every reachable node answers."""
    service = f"{name}/list_parameters"
    if name in asked or name == UNNAMED or service not in dict(node.get_service_names_and_types()):
        return
    client = node.create_client(ListParameters, service)
    if client.service_is_ready():
        asked[name] = (client, client.call_async(ListParameters.Request()))
    else:
        node.destroy_client(client)


def _answer_alone() -> int:
    """Keep standard output for the answer: what others print there goes to standard error from now on."""
    answer = os.dup(sys.stdout.fileno())
    sys.stdout.flush()
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return answer


def main(words: list[str]) -> None:
    """Run one of them and print."""
    answer = _answer_alone()
    try:
        with refused_in_one_line():
            rclpy.init(args=[])
            node = rclpy.create_node(f"{OWN_NAME}{time.monotonic_ns()}")
    except SetupError as error:
        sys.exit(error.problem)
    try:
        if words[0] == "hello":
            found: Any = hello(node, words[1], float(words[2]), *words[3:])
        else:
            found = (senders if words[0] == "senders" else reports)(node, float(words[1]))
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    with os.fdopen(answer, "w") as out:
        print(json.dumps(found), file=out)


if __name__ == "__main__":
    main(sys.argv[1:])

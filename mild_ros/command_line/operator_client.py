# SPDX-License-Identifier: Apache-2.0
"""What an operator does to running nodes from a terminal: look at them, hold, enable and reset them.

Does what `ros2 service call` and `ros2 topic echo` do, for installations without the `ros2` command.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from mild_core.errors import SetupError
from mild_ros.node_kit.dds_variables import domain_id, heard_remedy
from mild_ros.node_kit.ros_errors import refused_in_one_line

DISCOVERY_S = 8.0
"""Longest wait for nodes to be discovered: a second where nothing else runs, several on a busy machine."""

SETTLE_S = 0.3
"""After the first node of a kind was discovered, others of it get this long."""

START_ONE = "start one: ./mild run pipeline; same ROS_DOMAIN_ID and discovery range? see ./mild doctor"

ANSWER_S = 5.0
"""Longest wait for the answer of a service."""

SERVICES: Mapping[str, type[Any]] = {"hold": SetBool, "enable": SetBool, "reset": Trigger, "pause": SetBool}
"""Private services (`~/hold`) of our nodes, by their last name."""

LEVELS = {DiagnosticStatus.OK: "ok", DiagnosticStatus.WARN: "warning", DiagnosticStatus.ERROR: "ERROR"}


@dataclass(frozen=True)
class NodeStatus:
    """What a node reports of itself in `/diagnostics`.

    Attributes:
        name: Of the node, with its namespace.
        level: `ok`, `warning`, `ERROR` or `stale`.
        message: What is wrong, or what it does.
        values: Every fact it reports.
    """

    name: str
    level: str
    message: str
    values: Mapping[str, str]


@dataclass(frozen=True)
class Answer:
    """What a node answered to a call.

    Attributes:
        service: Full name of the service.
        success: Whether it was done.
        message: In the node's words.
    """

    service: str
    success: bool
    message: str


class OperatorClient:
    """A short-lived node that talks to the nodes of this domain. Use `operator_client`."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self._node, self._executor = node, executor

    def call(self, name: str, namespace: str = "", data: bool | None = None) -> list[Answer]:
        """Call the service `~/name` of every node of ours that has one.

        Args:
            name: A key of `SERVICES`.
            namespace: Only of nodes in this namespace; "" for all.
            data: The request of a `std_srvs/SetBool`.

        Raises:
            SetupError: No node has such a service, or one does not answer.
        """
        kind = SERVICES[name]
        services = self._discovered(lambda: meant(name, namespace, self._node.get_service_names_and_types()))
        if not services:
            where = f" under {namespace}" if namespace else ""
            problem = f"no node with ~/{name}{where} in ROS domain {domain_id()} within {DISCOVERY_S:g} s"
            raise SetupError(name, problem, heard_remedy(START_ONE))
        request = kind.Request() if data is None else kind.Request(data=data)
        futures = {service: self._node.create_client(kind, service).call_async(request) for service in services}
        self._until(lambda: all(future.done() for future in futures.values()), ANSWER_S)
        silent = [service for service, future in futures.items() if not future.done()]
        if silent:
            problem = f"no answer within {ANSWER_S:g} s"
            raise SetupError(", ".join(silent), problem, "is the node alive? see ./mild status")
        found = {service: future.result() for service, future in futures.items()}
        return [Answer(service, bool(one.success), str(one.message)) for service, one in found.items()]

    def say(self, topic: str, text: str) -> int:
        """Publish a text once, to all who listen; returns how many.

        Raises:
            SetupError: No node does.
        """
        publisher = self._node.create_publisher(String, topic, 10)
        self._until(lambda: publisher.get_subscription_count() > 0, DISCOVERY_S)
        if not publisher.get_subscription_count():
            problem = f"no node listens in ROS domain {domain_id()} within {DISCOVERY_S:g} s"
            remedy = "start ./mild record first; same ROS_DOMAIN_ID and discovery range? see ./mild doctor"
            raise SetupError(topic, problem, heard_remedy(remedy))
        self._until(lambda: False, SETTLE_S)
        publisher.publish(String(data=text))
        publisher.wait_for_all_acked(Duration(seconds=ANSWER_S))
        return int(publisher.get_subscription_count())

    def statuses(self, patience_s: float = DISCOVERY_S) -> list[NodeStatus]:
        """What the nodes of ours in this domain report, by name; nodes report once a second."""
        found: dict[str, NodeStatus] = {}

        def take(message: DiagnosticArray) -> None:
            for status in message.status:
                values = {entry.key: entry.value for entry in status.values}
                found[status.name] = NodeStatus(status.name, LEVELS.get(status.level, "stale"), status.message, values)

        subscription = self._node.create_subscription(DiagnosticArray, "/diagnostics", take, 50)
        self._until(lambda: bool(found), patience_s)
        self._until(lambda: False, 1.1 if found else 0.0)  # everybody else's next report
        self._node.destroy_subscription(subscription)
        return [found[name] for name in sorted(found)]

    def _discovered(self, look: Callable[[], list[str]]) -> list[str]:
        self._until(lambda: bool(look()), DISCOVERY_S)
        if look():
            self._until(lambda: False, SETTLE_S)
        return look()

    def _until(self, happened: Callable[[], bool], patience_s: float) -> None:
        """Take what comes until `happened`, for at most so long."""
        deadline_s = time.monotonic() + patience_s
        while not happened() and time.monotonic() < deadline_s:
            self._executor.spin_once(timeout_sec=0.02)


def meant(name: str, namespace: str, found: Iterable[tuple[str, Sequence[str]]]) -> list[str]:
    """Of all services found, with their types, those that a call of `~/name` under a namespace means."""
    wanted = f"std_srvs/srv/{SERVICES[name].__name__}"
    prefix = f"/{namespace.strip('/')}/" if namespace.strip("/") else "/"
    return sorted(
        service
        for service, types in found
        if service.endswith(f"/{name}") and service.startswith(prefix) and wanted in types
    )


@contextmanager
def operator_client() -> Iterator[OperatorClient]:
    """An `OperatorClient` in the domain of this terminal.

    Raises:
        SetupError: ROS 2 refuses to start in this environment.
    """
    domain_id()
    context = rclpy.Context()
    with refused_in_one_line():
        rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
        node = Node("mild_operator", context=context, start_parameter_services=False, enable_rosout=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        yield OperatorClient(node, executor)
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)

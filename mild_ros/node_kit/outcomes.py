# SPDX-License-Identifier: Apache-2.0
"""Publishes the outcome of each input on `handled`, on request."""

from __future__ import annotations

from std_msgs.msg import Header

from mild_ros.messages.handled import Handled, handled_to_msg
from mild_ros.node_kit.guarded import UNUSABLE, GuardedNode
from mild_ros.node_kit.quality_of_service import HANDLED


class OutcomePublisher:
    """The outcome of every input.

    Args:
        node: Whose.
        wanted: Whether to publish them at all.
    """

    def __init__(self, node: GuardedNode, wanted: bool) -> None:
        self._publisher = node.create_publisher(Header, "handled", HANDLED) if wanted else None
        node.on_lost = lambda: self.report(node.executable, 0, UNUSABLE, node.get_clock().now().nanoseconds)

    def report(self, stage: str, outputs: int, outcome: str, stamp_ns: int) -> None:
        """An input is done with: how many outputs it had and how it ended."""
        if self._publisher is not None:
            self._publisher.publish(handled_to_msg(Handled(stage, outputs, outcome, stamp_ns)))

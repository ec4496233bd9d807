# SPDX-License-Identifier: Apache-2.0
"""What retargeting is doing and how hard the arm shall be, on topics of their own; and the operator's `~/hold`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from std_msgs.msg import Float64, String
from std_srvs.srv import SetBool

from mild_core.retargeting.stage import Request, RetargetingState
from mild_core.signals import JointCommand
from mild_ros.quality_of_service import LATCHED

STIFFNESS_STEP = 0.02
"""Smaller changes are not told: nobody feels them."""


class LifeTopics:
    """The topics `mode` and `stiffness`, which say what changes, and the service `~/hold`.

    Args:
        node: Who commands.
        request: Hands an operator's request to the stages; `hold` leads to a command at once.
    """

    def __init__(self, node: Node, request: Callable[[Request], None]) -> None:
        self._request = request
        self._mode, self._stiffness = "", -1.0
        self._modes = node.create_publisher(String, "mode", LATCHED)
        self._hints = node.create_publisher(Float64, "stiffness", LATCHED)
        node.create_service(SetBool, "~/hold", self._on_hold)

    def tell(self, state: RetargetingState, commands: tuple[JointCommand, ...]) -> None:
        """Say what has changed."""
        if state.mode.value != self._mode:
            self._mode = state.mode.value
            self._modes.publish(String(data=self._mode))
        stiffness = commands[-1].stiffness if commands else self._stiffness
        if abs(stiffness - self._stiffness) >= STIFFNESS_STEP or (stiffness == 1.0 != self._stiffness):
            self._stiffness = stiffness
            self._hints.publish(Float64(data=stiffness))

    def _on_hold(self, wish: Any, answer: Any) -> Any:
        self._request(Request("hold" if wish.data else "release"))
        answer.success = True
        answer.message = "held: stops smoothly at once and stays" if wish.data else "released: goes home, then ready"
        return answer

# SPDX-License-Identifier: Apache-2.0
"""`~/enable` and `~/reset` of a node that commands nothing itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.quality_of_service import SERVICE


class OperatorServices:
    """What an operator may ask of a stage.

    Args:
        node: Who answers.
        diagnostics: Where a disabled node says so.
        reset: Forgets everything and returns what the operator should know.

    Attributes:
        enabled: Whether inputs are to be used.
    """

    def __init__(self, node: Node, diagnostics: Diagnostics, reset: Callable[[], str]) -> None:
        self.enabled = True
        self._diagnostics, self._reset = diagnostics, reset
        node.create_service(SetBool, "~/enable", self._on_enable, qos_profile=SERVICE)
        node.create_service(Trigger, "~/reset", self._on_reset, qos_profile=SERVICE)

    def _on_enable(self, wish: Any, answer: Any) -> Any:
        self.enabled = bool(wish.data)
        self._diagnostics.summary = answer.message = "enabled" if self.enabled else "disabled by the operator"
        answer.success = True
        return answer

    def _on_reset(self, _wish: Any, answer: Any) -> Any:
        answer.message = self._reset()
        answer.success = True
        return answer

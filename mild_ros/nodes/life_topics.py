# SPDX-License-Identifier: Apache-2.0
"""What retargeting is doing and how hard the arm shall be, on topics of their own; and the operator's `~/hold`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from std_msgs.msg import Float64, String
from std_srvs.srv import SetBool

from mild_core.retargeting.modes import Mode
from mild_core.retargeting.stage import Request, RetargetingState
from mild_core.signals import JointCommand
from mild_ros.node_kit.quality_of_service import LATCHED, SERVICE
from mild_ros.node_kit.threads import StageNode

STIFFNESS_STEP = 0.02
"""Smaller changes are not published: they cannot be felt."""

HOLDS_AT_ONCE = 16
"""Requests of `~/hold` that are served in one control period: so many take a tenth of it."""


class LifeTopics:
    """The topics `mode` and `stiffness`, which say what changes, and the service `~/hold`.

    Args:
        node: Who commands.
        request: Hands an operator's request to retargeting and returns its state; `hold` leads to a command at once.
        polled: Whether `serve_hold` serves `~/hold`; otherwise the executor does.
    """

    def __init__(self, node: StageNode, request: Callable[[Request], RetargetingState], *, polled: bool) -> None:
        self._request = request
        self._mode, self._stiffness = "", -1.0
        self._modes = node.create_publisher(String, "mode", LATCHED)
        self._hints = node.create_publisher(Float64, "stiffness", LATCHED)
        self._service = node.create_service(SetBool, "~/hold", self._on_hold, qos_profile=SERVICE)
        if polled:
            node.take_over(self._service)

    def serve_hold(self) -> None:
        """Carry out what has been asked of `~/hold`, a bounded number at a time, and answer it."""
        for _ in range(HOLDS_AT_ONCE):
            wish, header = self._service.handle.service_take_request(SetBool.Request)
            if header is None:
                return
            self._service.send_response(self._service.callback(wish, SetBool.Response()), header)

    def publish(self, state: RetargetingState, commands: tuple[JointCommand, ...]) -> None:
        """Say what has changed."""
        if state.mode.value != self._mode:
            self._mode = state.mode.value
            self._modes.publish(String(data=self._mode))
        stiffness = commands[-1].stiffness if commands else self._stiffness
        if abs(stiffness - self._stiffness) >= STIFFNESS_STEP or (stiffness == 1.0 != self._stiffness):
            self._stiffness = stiffness
            self._hints.publish(Float64(data=stiffness))

    def _on_hold(self, wish: Any, answer: Any) -> Any:
        state = self._request(Request("hold" if wish.data else "release"))
        answer.success = state.held is bool(wish.data)
        answer.message = f"{'held' if state.held else 'released'}; {mode_reached(state)}"
        return answer


def mode_reached(state: RetargetingState) -> str:
    """What the robot does after an operator's request, for people."""
    if state.mode is Mode.WAITING:
        return "waiting: the robot has not said where it is, and no command is sent"
    if state.motion is None or state.motion.resting:
        return f"{state.mode.value}: the robot rests"
    return f"{state.mode.value}: the robot still moves and stops smoothly"

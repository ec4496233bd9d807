# SPDX-License-Identifier: Apache-2.0
"""Who may command the robot: one node, when its operator wants it to and nobody else does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from mild_core.retargeting.stage import Mode, Request, Retargeting, RetargetingState
from mild_core.signals import JointCommand, JointMeasurement
from mild_ros.controller_topics import ControllerTopics
from mild_ros.diagnostics import Diagnostics
from mild_ros.joint_naming import joint_naming
from mild_ros.messages.joint_state import joint_command_to_msg, joint_measurement_from_msg
from mild_ros.quality_of_service import COMMAND
from mild_ros.settings import RetargetingParameters

TOPIC = "joint_command"

ATTENTION = {
    Mode.WAITING: "waiting for joint_states: the robot has not said where it is",
    Mode.HOLDING: "holding: there is no motion to follow",
    Mode.HELD: "held: the operator stopped the robot; ~/hold releases it",
}
"""Modes that an operator should know the reason of."""


class Commanding:
    """The publisher of commands, and the reasons not to use it.

    Two publishers of commands would pull the robot to and fro. As soon as another one is seen, this one stops the
    robot smoothly and falls silent, says so, and goes on when the other is gone. DDS may need two seconds to see a
    new one and twenty to miss one that was killed.

    Args:
        node: Who commands.
        diagnostics: Where reasons are told.
        request: Hands an operator's request to the stages.
        parameters: Whether the operator wants commands from the start, in which forms, and the robot's joint names.
        stage: What makes the commands.

    Raises:
        SetupError: The names or the forms do not fit the robot.
    """

    def __init__(
        self,
        node: Node,
        diagnostics: Diagnostics,
        request: Callable[[Request], None],
        parameters: RetargetingParameters,
        stage: Retargeting,
    ) -> None:
        self._node, self._diagnostics, self._request, self._enabled = node, diagnostics, request, parameters.enabled
        self._contested = False
        self._naming = joint_naming(stage.robot.joint_names, parameters.robot_joint_names)
        self._controllers = ControllerTopics(node, parameters, stage, self._naming)
        self._publisher = node.create_publisher(JointState, TOPIC, COMMAND)
        node.create_service(SetBool, "~/enable", self._on_enable)
        node.create_service(Trigger, "~/reset", self._on_reset)

    def measured(self, message: Any) -> JointMeasurement:
        """Where the robot is, with our names of its joints.

        Raises:
            DataError: The message cannot be read.
        """
        return self._naming.understood(joint_measurement_from_msg(message))

    def send(self, commands: tuple[JointCommand, ...], state: RetargetingState) -> None:
        """Publish commands; `state` is the stage's after the last of them."""
        for command in commands:
            self._publisher.publish(joint_command_to_msg(self._naming.told(command)))
            self._diagnostics.flowed(TOPIC)
        if commands:
            self._controllers.send(commands[-1], state)

    def look_for_others(self) -> None:
        """Stop while there are other publishers; once a second is enough."""
        topics = (TOPIC, *self._controllers.topics)
        others, topic = max((self._node.count_publishers(topic) - 1, topic) for topic in topics)
        if (others > 0) != self._contested:
            self._contested = others > 0
            if self._contested:
                self._node.get_logger().error(f"{self._contest(others, topic)}: stopping")
            if self._enabled:
                self._request(Request("disable" if self._contested else "enable"))
        self._diagnostics.alarms.pop("contest", None)
        if self._contested:
            self._diagnostics.alarms["contest"] = (DiagnosticStatus.ERROR, self._contest(others, topic))

    def tell(self, state: RetargetingState) -> None:
        """Say what retargeting does and why."""
        alarms = self._diagnostics.alarms
        alarms.pop("mode", None)
        if state.displaced:
            alarms["mode"] = (DiagnosticStatus.WARN, "holding: the robot is not where it was told to be")
        elif state.silent:
            alarms["mode"] = (DiagnosticStatus.WARN, "holding: the robot has ceased to say where it is")
        elif state.mode in ATTENTION:
            alarms["mode"] = (DiagnosticStatus.WARN, ATTENTION[state.mode])
        alarms.pop("people", None)
        notices = state.notices(self._node.get_clock().now().nanoseconds)
        if notices:
            alarms["people"] = (DiagnosticStatus.WARN, "; ".join(notices))
            self._diagnostics.complain("; ".join(notices))
        self._diagnostics.facts["mode"] = state.mode.value
        self._diagnostics.summary = state.mode.value

    def _contest(self, others: int, topic: str) -> str:
        topic = self._node.resolve_topic_name(topic)
        return f"{others} other publisher{'s' if others > 1 else ''} on {topic}: this node sends no commands"

    def _on_enable(self, wish: Any, answer: Any) -> Any:
        self._enabled = bool(wish.data)
        answer.success = not (self._enabled and self._contested)
        answer.message = "enabled" if self._enabled else "disabled: stops smoothly, then sends nothing"
        if not answer.success:
            answer.message = "will go on when no other node publishes commands"
        elif not self._contested:
            self._request(Request("enable" if self._enabled else "disable"))
        return answer

    def _on_reset(self, _wish: Any, answer: Any) -> Any:
        self._request(Request("reset"))
        answer.success, answer.message = True, "forgot everything; stops smoothly and goes home"
        return answer

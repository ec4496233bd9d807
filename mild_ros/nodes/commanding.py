# SPDX-License-Identifier: Apache-2.0
"""Who may command the robot: one node, when its operator wants it to and no other node does."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from mild_core.retargeting.stage import Mode, Request, Retargeting, RetargetingState
from mild_core.signals import JointCommand, JointMeasurement
from mild_ros.assembly.settings import RetargetingParameters
from mild_ros.commands.controller_topics import ControllerTopics
from mild_ros.commands.joint_naming import joint_naming
from mild_ros.messages.joint_state import joint_command_to_msg, joint_measurement_from_msg
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.quality_of_service import COMMAND, SERVICE
from mild_ros.node_kit.threads import StageNode

TOPIC = "joint_command"

ATTENTION = {
    Mode.WAITING: "waiting for joint_states: the robot has not said where it is",
    Mode.HOLDING: "holding: there is no motion to follow",
    Mode.HELD: "held: the operator stopped the robot; ~/hold releases it",
}
"""Modes that an operator should know the reason of."""


SILENT = {
    "operator": "",
    "discovery": "waits until every other publisher of commands would have been seen",
    "contest": "",
    "end": "this node ends",
    "time": "/clock stands still: the robot was stopped, and goes on when time does",
}
"""Reasons to send no commands, and what is said of them; the operator's is said by the mode."""

DISCOVERY_S = 4.0
"""For so long after the start another publisher may be unseen: DDS announces five times at the start and then every
three seconds, and the five may be lost on a busy machine. Loading a model takes most of that time anyway ..."""

SETTLE_S = 1.0
"""... and for so long after this node has made its publishers, one that starts at the same time may not see them ..."""

LATE_S = 0.05
"""... where a gap between two looks counts as this at most: a machine that stalls control stalls discovery too."""


class Commanding:
    """The publisher of commands, and the reasons not to use it.

    Two publishers of commands would pull the robot to and fro. So before the first command discovery is awaited, and
    before each one the publishers on its topics are counted. As soon as there is another one, this node stops the
    robot smoothly and falls silent, says so, and goes on when the other is gone. Of two nodes of ours neither sends
    while both are there, regardless of order: which one the operator means is unknown. DDS may need twenty
    seconds to miss one that was killed.

    Args:
        node: Who commands.
        diagnostics: Where reasons are reported.
        request: Hands a request to retargeting; to be called by control alone.
        call: Does something in the thread of control, and returns what comes of it.
        on_reset: Resets the stages before retargeting.
        parameters: Whether the operator wants commands from the start, in which forms, and the robot's joint names.
        stage: What makes the commands.

    Raises:
        SetupError: The names or the forms do not fit the robot.
    """

    def __init__(
        self,
        node: StageNode,
        diagnostics: Diagnostics,
        request: Callable[[Request], object],
        call: Callable[[Callable[[], Any]], Any],
        on_reset: Callable[[], None],
        parameters: RetargetingParameters,
        stage: Retargeting,
    ) -> None:
        self._node, self._diagnostics, self._request, self._call = node, diagnostics, request, call
        self._on_reset_before, self._in_order = on_reset, node.is_in_order
        # In lock-step each message is waited for, and nothing moves but a replay.
        self._reasons = set() if self._in_order else {"discovery"}
        self._reasons |= set() if parameters.enabled else {"operator"}
        self._others: tuple[int, str] = (0, "")
        self._newest_s: float | None = None
        self._naming = joint_naming(stage.robot.joint_names, parameters.robot_joint_names)
        self._controllers = ControllerTopics(node, parameters, stage, self._naming)
        self._publisher = node.create_publisher(JointState, TOPIC, COMMAND)
        self._topics = [node.resolve_topic_name(topic) for topic in (TOPIC, *self._controllers.topics)]
        self._watched_s, self._settled_s = time.monotonic(), 0.0
        node.create_service(SetBool, "~/enable", self._on_enable, qos_profile=SERVICE)
        node.create_service(Trigger, "~/reset", self._on_reset, qos_profile=SERVICE)

    @property
    def silent(self) -> bool:
        """Whether no commands are to be sent."""
        return bool(self._reasons)

    def measured(self, message: Any) -> JointMeasurement:
        """Where the robot is, with our names of its joints.

        Raises:
            DataError: The message cannot be read.
        """
        return self._naming.understood(joint_measurement_from_msg(message))

    def send(self, commands: tuple[JointCommand, ...], state: RetargetingState) -> None:
        """Publish commands; `state` is the stage's after the last of them."""
        for command in commands:
            self._publisher.publish(joint_command_to_msg(self._naming.renamed(command)))
            self._diagnostics.flowed(TOPIC)
        if commands:
            self._controllers.send(commands[-1], state)
            now_s = time.monotonic()
            if self._newest_s is not None and state.commanded_ns is not None:
                self._diagnostics.took("gap of joint_command", round((now_s - self._newest_s) * 1e9))
            self._newest_s = now_s
        elif state.commanded_ns is None:
            self._newest_s = None

    def stop(self, reason: str) -> None:
        """Stop the robot smoothly and send nothing until `go_on`; by control alone, as all that follows."""
        was_silent = self.silent
        self._reasons.add(reason)
        if not was_silent:
            self._request(Request("disable"))

    def go_on(self, reason: str) -> None:
        """A reason to be silent has gone."""
        was_silent = self.silent
        self._reasons.discard(reason)
        if was_silent and not self.silent:
            self._request(Request("enable"))

    def watch(self) -> None:
        """See who else publishes commands: before each command, and in lock-step once a second; 5 µs for a topic."""
        others, topic = max((self._node.count_publishers(topic) - 1, topic) for topic in self._topics)
        if (others > 0) != ("contest" in self._reasons):
            self._others = (others, topic)
            if others > 0:
                self.stop("contest")
                self._node.get_logger().error(f"{self._contest()}: stopping")
            else:
                self.go_on("contest")
        if "discovery" in self._reasons:
            now_s = time.monotonic()
            self._settled_s += min(now_s - self._watched_s, LATE_S)
            self._watched_s, seconds = now_s, now_s - self._node.started_s
            if seconds < DISCOVERY_S or self._settled_s < SETTLE_S:
                return
            self.go_on("discovery")
            if "contest" not in self._reasons:
                self._node.get_logger().info(f"no other publisher of commands within {seconds:.1f} s: may command")

    def report(self, state: RetargetingState) -> None:
        """Say what retargeting does and why."""
        alarms = self._diagnostics.alarms
        alarms.pop("mode", None)
        if state.joints.disagree(state.joints.newest_ns):
            alarms["mode"] = (DiagnosticStatus.ERROR, f"holding: {self._contradiction()}")
        elif state.displaced:
            alarms["mode"] = (DiagnosticStatus.WARN, "holding: the robot is not where it was commanded to be")
        elif state.silent:
            alarms["mode"] = (DiagnosticStatus.WARN, "holding: the robot has ceased to say where it is")
        elif state.mode in ATTENTION:
            alarms["mode"] = (DiagnosticStatus.WARN, ATTENTION[state.mode])
        for reason, text in SILENT.items():
            alarms.pop(reason, None)
            if reason in self._reasons and reason != "operator":
                level = DiagnosticStatus.WARN if reason == "discovery" else DiagnosticStatus.ERROR
                alarms[reason] = (level, text or self._contest())
        alarms.pop("people", None)
        notices = state.notices(self._node.get_clock().now().nanoseconds)
        if notices:
            alarms["people"] = (DiagnosticStatus.WARN, "; ".join(notices))
            self._diagnostics.complain("; ".join(notices))
        self._diagnostics.facts["mode"] = state.mode.value
        self._diagnostics.summary = state.mode.value

    def _contest(self) -> str:
        others, topic = self._others
        who = f"{others} other publisher{'s' if others > 1 else ''} on {topic}"
        own = self._node.get_fully_qualified_name()
        names = [
            f"{found.node_namespace.rstrip('/')}/{found.node_name}"
            for found in self._node.get_publishers_info_by_topic(topic)
        ]
        if own in names:
            names.remove(own)
        return f"{who}: this node sends no commands while {', '.join(names) or 'it'} may ({own} is this node)"

    def _set_enabled(self, wanted: bool) -> None:
        if wanted:
            self.go_on("operator")
        else:
            self.stop("operator")

    def _contradiction(self) -> str:
        """Who says that the robot is in two places."""
        found = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name("joint_states"))
        names = ", ".join(sorted(f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in found))
        if len(found) > 1:
            count = {2: "two", 3: "three"}.get(len(found), str(len(found)))
            return f"{count} publishers of joint_states disagree: {names}"
        return f"joint_states contradict each other{names and f' (from {names})'}: a joint cannot move so fast"

    def _on_enable(self, wish: Any, answer: Any) -> Any:
        wanted = bool(wish.data)
        try:
            self._call(lambda: self._set_enabled(wanted))
        except TimeoutError as error:
            answer.success, answer.message = False, str(error)
            return answer
        answer.success = not (wanted and "contest" in self._reasons)
        answer.message = "enabled" if wanted else "disabled: stops smoothly, then sends nothing"
        if not answer.success:
            answer.message = "will go on when no other node publishes commands"
        return answer

    def _on_reset(self, _wish: Any, answer: Any) -> Any:
        try:
            self._on_reset_before()
            self._call(lambda: self._request(Request("reset")))
        except TimeoutError as error:
            answer.success, answer.message = False, str(error)
            return answer
        answer.success, answer.message = True, "forgot everything; stops smoothly and goes home"
        return answer

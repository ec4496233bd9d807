# SPDX-License-Identifier: Apache-2.0
"""The topics of the controllers that an operator asks for."""

from __future__ import annotations

from functools import partial

from rclpy.node import Node
from rclpy.publisher import Publisher

from mild_core.errors import SetupError, unknown_name
from mild_core.retargeting.foresight import foreseen
from mild_core.retargeting.stage import Retargeting
from mild_core.retargeting.state import RetargetingState
from mild_core.signals import JointCommand
from mild_ros.controller_settings import ControllerParameters
from mild_ros.controllers import OUTPUTS
from mild_ros.controllers.output import Outgoing
from mild_ros.joint_naming import JointNaming
from mild_ros.message_types import message_class
from mild_ros.quality_of_service import COMMAND

FORESIGHT_PERIOD_S = 0.02
"""Between points of a trajectory; in between a controller's own spline is within the robot's jerk of ours."""


class ControllerTopics:
    """Publishers for controllers.

    Args:
        node: Whose.
        parameters: Which, and how.
        stage: What makes the commands.
        naming: The robot's names of the joints.

    Attributes:
        topics: Their names.

    Raises:
        SetupError: An output is unknown, its package is not installed, or `position_order` is not the joints.
    """

    def __init__(self, node: Node, parameters: ControllerParameters, stage: Retargeting, naming: JointNaming) -> None:
        self._parameters, self._stage, self._naming = parameters, stage, naming
        self._order = parameters.position_order or naming.theirs
        if sorted(self._order) != sorted(naming.theirs):
            raise SetupError(
                "parameter position_order",
                f"is not the joints of {stage.robot.name}",
                f"order {', '.join(naming.theirs)}",
            )
        self._publishers: dict[str, tuple[Publisher, type]] = {}
        self._sent_ns: dict[str, int] = {}
        for name in parameters.outputs:
            if name not in OUTPUTS:
                raise unknown_name("parameter outputs", name, OUTPUTS)
            kind = message_class(OUTPUTS[name].type_name)
            if kind is None:
                package = OUTPUTS[name].type_name.split("/")[0]
                raise SetupError(f"output {name}", f"needs the package {package}", f"install {package} of ROS 2")
            self._publishers[name] = node.create_publisher(kind, name, COMMAND), kind
        self.topics = tuple(self._publishers)

    def send(self, command: JointCommand, state: RetargetingState) -> None:
        """Publish the newest command, after which the stage is in `state`, in every form that is due."""
        for name, (publisher, kind) in self._publishers.items():
            since_s = (command.stamp_ns - self._sent_ns.get(name, 0)) * 1e-9
            if 0.0 <= since_s < OUTPUTS[name].period_s:
                continue
            self._sent_ns[name] = command.stamp_ns
            ahead = partial(self._foreseen, state, command.stamp_ns)
            outgoing = Outgoing(self._naming.told(command), ahead, self._stage.robot, self._order)
            publisher.publish(OUTPUTS[name].message(kind, outgoing))

    def _foreseen(self, state: RetargetingState, now_ns: int) -> tuple[JointCommand, ...]:
        return foreseen(self._stage, state, now_ns, self._parameters.trajectory_s, FORESIGHT_PERIOD_S)

# SPDX-License-Identifier: Apache-2.0
"""The topics of the controllers that an operator asks for."""

from __future__ import annotations

from rclpy.node import Node

from mild_core.errors import SetupError
from mild_core.retargeting.stage import Retargeting
from mild_core.retargeting.state import RetargetingState
from mild_core.signals import JointCommand
from mild_ros.commands.controller_messages import ControllerMessages
from mild_ros.commands.controller_settings import ControllerParameters
from mild_ros.commands.joint_naming import JointNaming
from mild_ros.node_kit.quality_of_service import COMMAND


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
        self._messages = ControllerMessages(parameters, stage, naming)
        for name, type_name in self._messages.absent.items():
            package = type_name.split("/")[0]
            raise SetupError(f"output {name}", f"needs the package {package}", f"install {package} of ROS 2")
        self._publishers = {
            name: node.create_publisher(kind, name, COMMAND) for name, kind in self._messages.kinds.items()
        }
        self.topics = tuple(self._publishers)

    def send(self, command: JointCommand, state: RetargetingState) -> None:
        """Publish the newest command, after which the stage is in `state`, in every form that is due."""
        for due in self._messages.after((command,), state):
            self._publishers[due.topic].publish(due.message)

# SPDX-License-Identifier: Apache-2.0
"""What controllers are sent for each command: the same for live nodes and for a replay in process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mild_core.errors import SetupError, unknown_name
from mild_core.retargeting.stage import Retargeting
from mild_core.retargeting.state import RetargetingState
from mild_core.retargeting.trajectory_stream import TICK_S, execution_delay_s
from mild_core.signals import JointCommand
from mild_ros.commands.controller_settings import ControllerParameters
from mild_ros.commands.joint_naming import JointNaming
from mild_ros.controllers import OUTPUTS
from mild_ros.controllers.output import Outgoing
from mild_ros.messages.message_types import message_class

TOLERANCE = 0.75
"""Share of a period after which a message is due: ticks of a live clock come a little early or late."""


def delay_of(parameters: ControllerParameters, control_rate_hz: float) -> float:
    """Time [s] from a command to its execution by the controllers of these outputs.

    Raises:
        SetupError: An output is unknown, or commands come too seldom for it.
    """
    for name in parameters.outputs:
        if name not in OUTPUTS:
            raise unknown_name("parameter outputs", name, OUTPUTS)
    playing = [name for name in parameters.outputs if OUTPUTS[name].plays_trajectories]
    if not playing:
        return 0.0
    if control_rate_hz * TICK_S < 1.0 - 1e-9:
        raise SetupError(
            "parameter control_rate_hz",
            f"{control_rate_hz:g} Hz is too little for {', '.join(playing)}",
            f"give at least {1.0 / TICK_S:g}",
        )
    return execution_delay_s(parameters.max_expected_latency_s, parameters.trajectory_s)


@dataclass(frozen=True, eq=False)
class ControllerMessage:
    """A message for a controller, and where it goes."""

    topic: str
    message: Any


class ControllerMessages:
    """Makes the messages of the outputs that an operator asks for.

    Args:
        parameters: Which, and how.
        stage: What makes the commands.
        naming: The robot's names of the joints.

    Attributes:
        kinds: Classes of the messages by topic.
        absent: Topics of types that are not installed here, with the names of their types.

    Raises:
        SetupError: An output is unknown, or `position_order` is not the joints.
    """

    def __init__(self, parameters: ControllerParameters, stage: Retargeting, naming: JointNaming) -> None:
        self._naming, self._robot = naming, stage.robot
        self._order = parameters.position_order or naming.theirs
        if sorted(self._order) != sorted(naming.theirs):
            raise SetupError(
                "parameter position_order",
                f"is not the joints of {stage.robot.name}",
                f"order {', '.join(naming.theirs)}",
            )
        self.kinds: dict[str, type] = {}
        self.absent: dict[str, str] = {}
        for name in parameters.outputs:
            if name not in OUTPUTS:
                raise unknown_name("parameter outputs", name, OUTPUTS)
            kind = message_class(OUTPUTS[name].type_name)
            if kind is None:
                self.absent[name] = OUTPUTS[name].type_name
            else:
                self.kinds[name] = kind
        self._stream = stage.trajectory_stream()
        self._promised = self._stream.init()
        self._previous: dict[str, JointCommand] = {}

    def after(self, commands: tuple[JointCommand, ...], state: RetargetingState) -> list[ControllerMessage]:
        """What is due after these commands; `state` is the stage's after the last of them."""
        if not commands or not self.kinds:
            return []
        command, trajectory = commands[-1], None
        if state.motion is not None and any(OUTPUTS[name].plays_trajectories for name in self.kinds):
            self._promised, trajectory = self._stream.step(self._promised, state.motion, command.stamp_ns)
        made = []
        for name, kind in self.kinds.items():
            output, previous = OUTPUTS[name], self._previous.get(name)
            if output.plays_trajectories:
                if trajectory is None:
                    continue
            elif previous is not None:
                since_s = (command.stamp_ns - previous.stamp_ns) * 1e-9
                if 0.0 <= since_s < output.period_s - (1.0 - TOLERANCE) * TICK_S:
                    continue
            named = self._naming.renamed(command)
            self._previous[name] = named
            outgoing = Outgoing(named, self._robot, self._order, previous, trajectory)
            made.append(ControllerMessage(name, output.message(kind, outgoing)))
        return made

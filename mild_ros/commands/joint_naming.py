# SPDX-License-Identifier: Apache-2.0
"""Our names of a robot's joints and its driver's."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mild_core.errors import SetupError
from mild_core.signals import JointCommand, JointMeasurement


@dataclass(frozen=True)
class JointNaming:
    """Both names of each joint, in the robot's order.

    Attributes:
        ours: As in `ROBOTS`.
        theirs: As on the robot's topics.
    """

    ours: tuple[str, ...]
    theirs: tuple[str, ...]

    def renamed(self, command: JointCommand) -> JointCommand:
        """A command with their names."""
        return command if self.ours == self.theirs else replace(command, joint_names=self.theirs)

    def understood(self, measurement: JointMeasurement) -> JointMeasurement:
        """A measurement with our names; joints that we do not know keep theirs."""
        if self.ours == self.theirs:
            return measurement
        ours = dict(zip(self.theirs, self.ours, strict=True))
        return replace(measurement, joint_names=tuple(ours.get(name, name) for name in measurement.joint_names))


def joint_naming(ours: tuple[str, ...], given: tuple[str, ...]) -> JointNaming:
    """The naming that the parameter `robot_joint_names` asks for.

    Raises:
        SetupError: It has not one name for each joint.
    """
    theirs = given or ours
    if len(theirs) != len(ours) or len(set(theirs)) != len(theirs):
        names = f"{len(set(theirs))} different names"
        remedy = f"give one for each of {', '.join(ours)}, in this order"
        raise SetupError("parameter robot_joint_names", f"has {names}, the robot {len(ours)} joints", remedy)
    return JointNaming(ours, theirs)

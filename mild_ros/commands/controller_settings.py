# SPDX-License-Identifier: Apache-2.0
"""What may be set of the way in which a robot's controllers are commanded."""

from __future__ import annotations

from dataclasses import dataclass

from mild_core.parameters import parameter

ROBOT_JOINT_NAMES: tuple[str, ...] = parameter(
    (),
    "Joint names of the robot's driver, on commands and on `joint_states`, in our order; empty if equal to ours.",
)


@dataclass(frozen=True)
class ControllerParameters:
    """Of the nodes that command a robot."""

    outputs: tuple[str, ...] = parameter(
        (),
        "Commands beside `joint_command`: any of `joint_trajectory` (JointTrajectoryController), `position_command` "
        "(forward_command_controller) and `joint_angles` (naoqi_driver).",
    )
    robot_joint_names: tuple[str, ...] = ROBOT_JOINT_NAMES
    position_order: tuple[str, ...] = parameter(
        (), "Names of the joints in the order of `position_command`; empty for that of `joint_command`."
    )
    max_expected_latency_s: float = parameter(
        0.1,
        "Longest time from a command to the controller's taking a `joint_trajectory`; commands are made 0.06 s more "
        "than this ahead of their execution, so that late and dropped messages do no harm.",
        unit="s",
        minimum=0.0,
        maximum=0.5,
    )
    trajectory_s: float = parameter(
        0.16,
        "How far ahead `joint_trajectory` follows the motion before its smooth stop; at least "
        "`max_expected_latency_s` and 0.06 s. A longer time tolerates more dropped "
        "messages and delays the reaction.",
        unit="s",
        minimum=0.02,
        maximum=1.0,
    )

# SPDX-License-Identifier: Apache-2.0
"""What parameters name is judged here without loading a model: in a second, rather than after the set-up of a run."""

from __future__ import annotations

from mild_core.errors import unknown_name
from mild_core.retargeting.robot_file import find_robot
from mild_ros.assembly.perception import manifest_of, robot_from_camera, skeleton_source
from mild_ros.assembly.robot import check_fit
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.commands.joint_naming import joint_naming
from mild_ros.controllers import OUTPUTS


def check_parameters(parameters: PipelineParameters) -> None:
    """Make sure that model, interaction, robot, outputs and tracker exist and fit each other.

    Raises:
        SetupError: One of them does not; the message lists what would have worked.
    """
    manifest, robot = manifest_of(parameters.model), find_robot(parameters.robot)
    manifest.check_interaction(parameters.interaction)
    check_fit(parameters.model, manifest.controlled, robot)
    joint_naming(robot.joint_names, parameters.robot_joint_names)
    for name in parameters.outputs:
        if name not in OUTPUTS:
            raise unknown_name("parameter outputs", name, OUTPUTS)
    skeleton_source(parameters)
    robot_from_camera(parameters.robot_from_camera)

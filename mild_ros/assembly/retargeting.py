# SPDX-License-Identifier: Apache-2.0
"""Retargeting made from parameters, and run once."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from mild_core.inference.manifest import Manifest
from mild_core.parameters import chosen
from mild_core.printable import printable_lines
from mild_core.retargeting.human_track import AssumedPlacement
from mild_core.retargeting.robot_checks import arm_notes, check_reach
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.stage import Retargeting
from mild_core.signals import ARM_JOINTS, ROBOT_FRAME, BodySegments, JointMeasurement, MotionWindow, PersonPose
from mild_ros.assembly.robot import check_fit, make_robot
from mild_ros.assembly.settings import RetargetingParameters
from mild_ros.commands.controller_messages import delay_of

HANGING_M = ((0.0, 0.0, 0.0), (0.0, 0.0, -0.3), (0.0, 0.0, -0.6))
"""A partner's arm for a first mapping."""


def make_retargeting(
    parameters: RetargetingParameters, manifest: Manifest, camera_measured: bool | None = None
) -> Retargeting:
    """Retargeting of what a model moves to a robot.

    Args:
        parameters: Of retargeting.
        manifest: Of the model.
        camera_measured: Whether the camera's pose is known; None where another process knows.

    Raises:
        SetupError: There is no such robot or description, or the robot cannot do what the model moves.
    """
    robot = make_robot(parameters.robot, parameters.robot_description)
    check_fit(parameters.model, manifest.controlled, robot)
    check_reach(robot)
    moves_arm = manifest.controlled.kind == "human_arm"
    for note in arm_notes(robot, manifest.observed.side if moves_arm else ""):
        logging.getLogger(__name__).warning("%s", printable_lines(note))
    settings = chosen(
        RetargetingSettings, parameters, execution_delay_s=delay_of(parameters, parameters.control_rate_hz)
    )
    there = manifest.robot_from_human
    standing = AssumedPlacement(there.translation_m, there.yaw_rad, there.by_interaction, tuple(manifest.contact))
    _compile(robot, settings, standing, manifest.controlled.kind == "human_arm")
    return Retargeting(robot, settings, standing, camera_measured)


def _compile(robot: RobotModel, settings: RetargetingSettings, standing: AssumedPlacement, arms: bool) -> None:
    """Run once all that is compiled at its first call: a hand that is met at once, then a head that is given way to."""
    eager = replace(
        settings, allow_unmeasured_contact=True, start_watch_s=0.0, start_evidence=0.0, placement_uncertainty_m=0.0
    )
    stage = Retargeting(robot, eager, standing)
    touching = next(iter(standing.touching), "any")
    motion = _hanging(touching) if arms else _away(robot, touching)
    state, _ = stage.step(stage.init(), JointMeasurement(0, robot.joint_names, robot.home_rad), 0)
    state, _ = stage.step(state, None, 1)
    home_m = forward_kinematics(robot, robot.home_rad, robot.tool_link)[:3, 3]
    trunk_m = home_m + np.array([0.6, 0.0, 0.0])
    near_m = home_m + 0.1
    # A hand is carried on with its speed: one that has just come near must stay there to be met.
    met = [(now_s, near_m, trunk_m) for now_s in (0.25, 0.3, 0.35, 0.4)]
    for now_s, hand_m, head_m in ((0.01, trunk_m, trunk_m), *met, (0.45, near_m, near_m), (0.5, near_m, near_m)):
        now_ns = round(now_s * 1e9)
        ends = np.array([[head_m, head_m], [trunk_m, trunk_m], [trunk_m, hand_m]])
        body = BodySegments((0, 0, 0), ("head", "trunk", "right_forearm"), ends, 0.0 * ends, np.full(3, 0.05))
        pose = PersonPose(now_ns, ROBOT_FRAME, hand_m, head_m, np.stack([trunk_m, trunk_m]), body)
        state, _ = stage.step(state, pose, now_ns)
        state, _ = stage.step(state, replace(motion, stamp_ns=now_ns), now_ns + 1)
        state, _ = stage.step(state, None, now_ns + 5_000_000)


def _away(robot: RobotModel, interaction: str) -> MotionWindow:
    rows, covariance = (
        np.clip(robot.home_rad + 0.1, robot.lower_rad, robot.upper_rad)[None],
        np.eye(len(robot.home_rad)),
    )
    return MotionWindow(
        0, 0, 1, robot.joint_names, rows, covariance, interaction, 1.0, np.ones(1), phase=0.0, out_of_distribution=0.0
    )


def _hanging(interaction: str) -> MotionWindow:
    positions, belief = np.array([HANGING_M]), np.ones(1)
    return MotionWindow(
        0, 0, 1, ARM_JOINTS, positions, np.eye(9), interaction, 1.0, belief, phase=0.0, out_of_distribution=0.0
    )

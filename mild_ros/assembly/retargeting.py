# SPDX-License-Identifier: Apache-2.0
"""Retargeting made from parameters, and run once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mild_core.inference.manifest import Manifest
from mild_core.retargeting.person import Standing
from mild_core.retargeting.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.stage import Retargeting
from mild_core.signals import ARM_FRAME, ARM_JOINTS, JointMeasurement, MotionWindow, PersonPose
from mild_ros.assembly.robot import check_fit, make_robot
from mild_ros.controller_messages import delay_of
from mild_ros.settings import RetargetingParameters

HANGING_M = ((0.0, 0.0, 0.0), (0.0, 0.0, -0.3), (0.0, 0.0, -0.6))
"""A partner's arm for a first mapping."""


def make_retargeting(parameters: RetargetingParameters, manifest: Manifest) -> Retargeting:
    """Retargeting of what a model moves to a robot.

    Raises:
        SetupError: There is no such robot or description, or the robot cannot do what the model moves.
    """
    robot = make_robot(parameters.robot, parameters.robot_description)
    check_fit(parameters.model, manifest.controlled, robot)
    delay_s = delay_of(parameters, parameters.control_rate_hz)
    settings = RetargetingSettings(
        look_ahead_s=parameters.look_ahead_s + delay_s,
        execution_delay_s=delay_s,
        stale_after_s=parameters.stale_after_s,
        max_age_s=parameters.max_age_s,
        home_after_s=parameters.home_after_s,
        home_velocity_rad_s=parameters.home_velocity_rad_s,
        ramp_velocity_rad_s=parameters.ramp_velocity_rad_s,
        ik=parameters.ik,  # type: ignore[arg-type]
        keep_out_m=parameters.keep_out_m,
        near_speed_m_s=parameters.near_speed_m_s,
        interaction_s=parameters.interaction_s,
        start_enabled=parameters.enabled,
    )
    there = manifest.robot_from_human
    stage = Retargeting(robot, settings, Standing(there.translation_m, there.yaw_rad, there.by_interaction))
    state, _ = stage.step(stage.init(), JointMeasurement(0, stage.robot.joint_names, stage.robot.home_rad), 0)
    state, _ = stage.step(state, None, 1)
    # A hand is raised to where the robot's will meet it, so that all that is compiled is compiled now.
    touching = next(iter(there.by_interaction), "any")
    motion = _hanging(touching) if manifest.controlled.kind == "human_arm" else _away(robot, touching)
    for now_ns, hand_m in ((10_000_000, np.zeros(3)), (20_000_000, np.array([0.6, 0.0, -0.2]))):
        state, _ = stage.step(state, PersonPose(now_ns, ARM_FRAME, hand_m, hand_m, np.zeros((2, 3))), now_ns)
        state, _ = stage.step(state, replace(motion, stamp_ns=now_ns), now_ns + 1)
        state, _ = stage.step(state, None, now_ns + 5_000_000)
    return stage


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

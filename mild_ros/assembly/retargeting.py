# SPDX-License-Identifier: Apache-2.0
"""Retargeting made from parameters, and run once."""

from __future__ import annotations

import numpy as np

from mild_core.inference.manifest import Manifest
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.stage import Retargeting
from mild_core.signals import ARM_JOINTS, JointMeasurement, MotionWindow
from mild_ros.assembly.robot import check_fit, make_robot
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
    settings = RetargetingSettings(
        look_ahead_s=parameters.look_ahead_s,
        stale_after_s=parameters.stale_after_s,
        max_age_s=parameters.max_age_s,
        home_after_s=parameters.home_after_s,
        home_velocity_rad_s=parameters.home_velocity_rad_s,
        ramp_velocity_rad_s=parameters.ramp_velocity_rad_s,
        start_enabled=parameters.enabled,
    )
    stage = Retargeting(robot, settings)
    state, _ = stage.step(stage.init(), JointMeasurement(0, stage.robot.joint_names, stage.robot.home_rad), 0)
    for now_ns in (1, 10_000_000):
        state, _ = stage.step(state, None, now_ns)
    if manifest.controlled.kind == "human_arm":
        stage.step(state, _hanging(), 20_000_000)
    return stage


def _hanging() -> MotionWindow:
    positions, covariance, belief = np.array([HANGING_M]), np.eye(9), np.ones(1)
    return MotionWindow(0, 0, 1, ARM_JOINTS, positions, covariance, "any", 1.0, belief, 0.0, 0.0)

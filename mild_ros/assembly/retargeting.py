# SPDX-License-Identifier: Apache-2.0
"""Retargeting made from parameters, and run once."""

from __future__ import annotations

from mild_core.retargeting.robots import ROBOTS
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.stage import Retargeting
from mild_core.signals import JointMeasurement
from mild_ros.settings import RetargetingParameters


def make_retargeting(parameters: RetargetingParameters) -> Retargeting:
    """Retargeting to a robot."""
    settings = RetargetingSettings(
        look_ahead_s=parameters.look_ahead_s,
        stale_after_s=parameters.stale_after_s,
        max_age_s=parameters.max_age_s,
        home_after_s=parameters.home_after_s,
        home_velocity_rad_s=parameters.home_velocity_rad_s,
        ramp_velocity_rad_s=parameters.ramp_velocity_rad_s,
        start_enabled=parameters.enabled,
    )
    stage = Retargeting(ROBOTS[parameters.robot], settings)
    state, _ = stage.step(stage.init(), JointMeasurement(0, stage.robot.joint_names, stage.robot.home_rad), 0)
    for now_ns in (1, 10_000_000):
        state, _ = stage.step(state, None, now_ns)
    return stage

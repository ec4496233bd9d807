# SPDX-License-Identifier: Apache-2.0
"""Inference made from parameters and a model, and run once, so that the first window is as fast as any."""

from __future__ import annotations

import numpy as np

from mild_core.inference.model import MildModel
from mild_core.inference.stage import Inference
from mild_core.resources import load_model
from mild_core.retargeting.robots import ROBOTS
from mild_core.signals import FeatureWindow
from mild_ros.assembly.settings import InferenceParameters


def load(model: str) -> MildModel:
    """The model of a name or a path.

    Raises:
        SetupError: There is none, or it cannot be trusted.
    """
    return load_model(model)


def make_inference(parameters: InferenceParameters, model: MildModel) -> Inference:
    """Inference by a model, compiled.

    Raises:
        SetupError: The model knows no such interaction.
    """
    manifest = model.manifest
    robot = ROBOTS.get(manifest.controlled.robot)
    ours = robot is not None and robot.joint_names == manifest.controlled.joint_names
    limits_rad_s = tuple(robot.velocity_rad_s.tolist()) if robot is not None and ours else ()
    stage = Inference(model, parameters.interaction, limits_rad_s, parameters.cautious)
    values, names = 3 if manifest.features == "positions" else 6, manifest.observed.joint_names
    still = FeatureWindow(0, "", names, np.zeros((manifest.window, values * len(names))))
    stage.step(stage.init(), still, 0)
    return stage

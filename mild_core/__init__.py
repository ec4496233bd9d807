# SPDX-License-Identifier: Apache-2.0
"""The method without ROS: perception, inference and retargeting as pure stages, and how models are learned.

The names below are the public API. Each is imported when it is first used, so that a program pays for no more than it
needs: `load_model`, `Perception` and `Inference` do without inverse kinematics, and nothing here needs torch or ROS.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mild_core.errors import DataError, MildError, ModelError, SetupError
    from mild_core.inference.motion_model import MildModel
    from mild_core.inference.priors import PRIORS
    from mild_core.inference.stage import Inference
    from mild_core.perception.settings import PerceptionSettings
    from mild_core.perception.skeletons import SOURCES, SkeletonSource
    from mild_core.perception.stage import Perception
    from mild_core.pipeline import Pipeline, PipelineOutput, PipelineState
    from mild_core.resources import load_model, perception_settings
    from mild_core.retargeting.robots import ROBOTS
    from mild_core.retargeting.stage import Retargeting, RetargetingSettings
    from mild_core.signals import (
        FeatureWindow,
        JointCommand,
        JointMeasurement,
        MotionWindow,
        PersonPose,
        SkeletonFrame,
    )

_PLACES = {
    "errors": ("DataError", "MildError", "ModelError", "SetupError"),
    "inference.motion_model": ("MildModel",),
    "inference.priors": ("PRIORS",),
    "inference.stage": ("Inference",),
    "perception.settings": ("PerceptionSettings",),
    "perception.skeletons": ("SOURCES", "SkeletonSource"),
    "perception.stage": ("Perception",),
    "pipeline": ("Pipeline", "PipelineOutput", "PipelineState"),
    "resources": ("load_model", "perception_settings"),
    "retargeting.robots": ("ROBOTS",),
    "retargeting.stage": ("Retargeting", "RetargetingSettings"),
    "signals": ("FeatureWindow", "JointCommand", "JointMeasurement", "MotionWindow", "PersonPose", "SkeletonFrame"),
}

__all__ = [
    "PRIORS",
    "ROBOTS",
    "SOURCES",
    "DataError",
    "FeatureWindow",
    "Inference",
    "JointCommand",
    "JointMeasurement",
    "MildError",
    "MildModel",
    "ModelError",
    "MotionWindow",
    "Perception",
    "PerceptionSettings",
    "PersonPose",
    "Pipeline",
    "PipelineOutput",
    "PipelineState",
    "Retargeting",
    "RetargetingSettings",
    "SetupError",
    "SkeletonFrame",
    "SkeletonSource",
    "load_model",
    "perception_settings",
]


def __getattr__(name: str) -> object:
    """Import a public name from its module."""
    for module, names in _PLACES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    """All public names."""
    return sorted({*globals(), *__all__})

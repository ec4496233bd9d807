# SPDX-License-Identifier: Apache-2.0
"""All three stages made to fit each other."""

from __future__ import annotations

from mild_core.inference.model import MildModel
from mild_core.pipeline import Pipeline
from mild_ros.assembly.inference import make_inference
from mild_ros.assembly.perception import make_perception
from mild_ros.assembly.retargeting import make_retargeting
from mild_ros.assembly.settings import PipelineParameters


def make_pipeline(parameters: PipelineParameters, model: MildModel) -> Pipeline:
    """Perception, inference and retargeting.

    Raises:
        SetupError: One of them cannot be made, or the model moves other joints than the robot has.
    """
    perception = make_perception(parameters, model.manifest)
    retargeting = make_retargeting(parameters, model.manifest, bool(parameters.robot_from_camera))
    return Pipeline(perception, make_inference(parameters, model), retargeting)

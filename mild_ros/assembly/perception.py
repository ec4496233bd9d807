# SPDX-License-Identifier: Apache-2.0
"""Perception made from parameters and what a model observes."""

from __future__ import annotations

from mild_core.errors import SetupError
from mild_core.inference.manifest import Manifest
from mild_core.inference.manifest_reading import read_manifest
from mild_core.perception.settings import PerceptionSettings
from mild_core.perception.skeletons import SOURCES, SkeletonSource
from mild_core.perception.stage import Perception
from mild_ros.settings import PerceptionParameters
from mild_ros.share import model_folder


def manifest_of(model: str) -> Manifest:
    """What the model of a name or a path was trained with, without loading it.

    Raises:
        SetupError: There is none, or its manifest cannot be read.
    """
    return read_manifest(model_folder(model))


def skeleton_source(parameters: PerceptionParameters) -> SkeletonSource:
    """The tracker convention that parameters name.

    Raises:
        SetupError: Joint names are missing, or given for a source that numbers its joints.
    """
    source = SOURCES[parameters.source]
    if not source.joint_ids:
        return source.with_joints(parameters.joint_names, parameters.source_axes)  # type: ignore[arg-type]
    if parameters.joint_names:
        problem = f"{parameters.source} numbers its joints, so their order cannot be given"
        raise SetupError("parameter joint_names", problem, "leave it out or set source to pose_array")
    return source


def make_perception(parameters: PerceptionParameters, manifest: Manifest) -> Perception:
    """Perception of what a model observes, by one tracker.

    Raises:
        SetupError: The tracker does not see a joint that the model observes, or a parameter cannot work.
    """
    source, observed = skeleton_source(parameters), manifest.observed
    settings = PerceptionSettings(
        joint_names=observed.joint_names,
        bone_lengths_m=observed.bone_lengths_m,
        rate_hz=manifest.rate_hz,
        window=manifest.window,
        features=manifest.features,  # type: ignore[arg-type]
        side=parameters.side,  # type: ignore[arg-type]
        axes=parameters.axes,  # type: ignore[arg-type]
        source_axes=source.axes,
        frame_id=parameters.frame_id,
        calibration_s=parameters.calibration_s,
        max_gap_s=parameters.max_gap_s,
        min_confidence=parameters.min_confidence,
        reacquire_distance_m=parameters.reacquire_distance_m,
        forget_s=parameters.forget_s,
    )
    unseen = sorted(set(settings.sided_names) - set(source.joint_ids.values()))
    if unseen:
        problem = f"the model {parameters.model} observes {', '.join(unseen)}, which the tracker does not give"
        raise SetupError(f"source {parameters.source}", problem, "name it in joint_names or take another source")
    return Perception(settings)

# SPDX-License-Identifier: Apache-2.0
"""Perception made from parameters and what a model observes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mild_core.errors import SetupError
from mild_core.inference.manifest import Manifest
from mild_core.inference.manifest_reading import read_manifest
from mild_core.parameters import chosen
from mild_core.perception.bodies import compile_kernels
from mild_core.perception.joint_validity import places_of
from mild_core.perception.settings import TrackingSettings
from mild_core.perception.skeletons import SkeletonSource
from mild_core.perception.skeletons.source import Axes
from mild_core.perception.stage import Perception
from mild_core.resources import model_folder, perception_settings
from mild_core.retargeting.robot_model.urdf import rotation_from_rpy
from mild_core.shapes import FloatArray
from mild_ros.assembly.calibration_file import CalibrationFile
from mild_ros.assembly.settings import PerceptionParameters

MOST_RAD, FARTHEST_M = 2.0 * np.pi + 0.01, 50.0
"""Angles beyond the first are degrees, and places beyond the second millimetres: no tracker sees people from there."""


def manifest_of(model: str) -> Manifest:
    """What the model of a name or a path was trained with, without loading it.

    Raises:
        SetupError: There is none, or its manifest cannot be read.
    """
    return read_manifest(model_folder(model))


def skeleton_source(parameters: PerceptionParameters) -> SkeletonSource:
    """The tracker convention that parameters name.

    Raises:
        SetupError: As `named_source`.
    """
    axes: Axes = parameters.source_axes  # type: ignore[assignment] # one of its choices
    source = parameters.named_source(axes)
    return replace(source, root=parameters.frame_id, axes=axes if source.axes == "unknown" else source.axes)


def robot_from_camera(text: str) -> FloatArray | None:
    """(4, 4) pose of the tracker's frame in the robot's base frame; None when not measured.

    Raises:
        SetupError: The text does not hold six finite numbers.
    """
    if not text.strip():
        return None
    try:
        x, y, z, roll, pitch, yaw = (float(word) for word in text.split())
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_rpy(roll, pitch, yaw)
        pose[:3, 3] = x, y, z
        if max(abs(roll), abs(pitch), abs(yaw)) > MOST_RAD:
            raise ValueError("in degrees")
        if not np.isfinite(pose).all():
            raise ValueError("it is infinitely far away")
    except ValueError as error:
        said = f"is '{text}'"
        if "in degrees" in str(error):
            said += ", whose angles are more than a turn: they look like degrees"
        raise SetupError("parameter robot_from_camera", said, "give x y z roll pitch yaw [m, rad]") from error
    if np.linalg.norm(pose[:3, 3]) > FARTHEST_M:
        said = f"is '{text}', which is {np.linalg.norm(pose[:3, 3]):.0f} m from the robot: it looks like millimetres"
        raise SetupError("parameter robot_from_camera", said, "give x y z roll pitch yaw [m, rad]")
    return pose


def make_perception(parameters: PerceptionParameters, manifest: Manifest) -> Perception:
    """Perception of what a model observes, by one tracker.

    Raises:
        SetupError: The tracker does not see a joint that the model observes, or a parameter cannot work.
    """
    source = skeleton_source(parameters)
    settings = perception_settings(
        manifest,
        source_axes=source.axes,
        frame_id=parameters.frame_id,
        robot_from_source=robot_from_camera(parameters.robot_from_camera),
        calibration=CalibrationFile(parameters.calibration_file).read(),
        **vars(chosen(TrackingSettings, parameters)),
    )
    unseen = sorted(set(settings.sided_names) - places_of(tuple(source.joint_ids.values())).keys())
    if unseen:
        problem = f"the model {parameters.model} observes {', '.join(unseen)}, which the tracker does not give"
        raise SetupError(f"source {parameters.source}", problem, "name it in joint_names or take another source")
    compile_kernels()
    return Perception(settings)

# SPDX-License-Identifier: Apache-2.0
"""What may be set of each node. What a model was trained with comes from its folder and is none of these."""

from __future__ import annotations

from dataclasses import dataclass

from mild_core.inference.settings import InferenceSettings
from mild_core.parameters import parameter
from mild_core.perception.settings import TrackingSettings
from mild_core.retargeting.settings import RetargetingSettings
from mild_ros.assembly.marker_settings import MarkersParameters
from mild_ros.assembly.tracker_settings import TrackerParameters
from mild_ros.commands.controller_settings import ROBOT_JOINT_NAMES, ControllerParameters

_MODEL = parameter("yumi_buetepage_ahead", "Model: a name of `mild models`, or the path of a folder.")
_ROBOT_DESCRIPTION = parameter(
    "", "URDF in place of the robot's own: a path, or `topic:robot_description`; empty for its own."
)
_REPORT_HANDLED = parameter(False, "Publish the outcome of every input on `handled`, for a replay in lock-step.")


@dataclass(frozen=True, kw_only=True)
class PerceptionParameters(TrackingSettings, TrackerParameters):
    """Of the perception node."""

    model: str = _MODEL
    source_axes: str = parameter(
        "unknown", "Axes of a source that has no fixed ones.", choices=("optical", "rep103", "unknown")
    )
    frame_id: str = parameter(
        "", "The only tf frame to accept, and the reference of tf sources; empty accepts the first that comes."
    )
    robot_from_camera: str = parameter(
        "",
        "Pose of the tracker's frame in the frame of the robot's base link, as `x y z roll pitch yaw` [m, rad]; when "
        "empty, people are assumed to stand where they stood in the model's recordings.",
    )
    calibration_file: str = parameter(
        "", "File that keeps the calibration for the next start; `~/reset` makes a new one. Empty keeps none."
    )
    report_handled: bool = _REPORT_HANDLED


@dataclass(frozen=True, kw_only=True)
class InferenceParameters(InferenceSettings):
    """Of the inference node."""

    model: str = _MODEL
    robot_joint_names: tuple[str, ...] = ROBOT_JOINT_NAMES
    report_handled: bool = _REPORT_HANDLED


@dataclass(frozen=True, kw_only=True)
class RetargetingParameters(RetargetingSettings, ControllerParameters):
    """Of the retargeting node."""

    model: str = _MODEL
    robot: str = parameter("yumi", "Robot to command: `yumi`, `pepper`, or the path of a robot file (.toml).")
    robot_description: str = _ROBOT_DESCRIPTION
    control_rate_hz: float = parameter(
        100.0, "Commands per second; a new motion triggers one more at once.", unit="Hz", minimum=10.0, maximum=500.0
    )
    report_handled: bool = _REPORT_HANDLED


@dataclass(frozen=True, kw_only=True)
class PipelineParameters(RetargetingParameters, InferenceParameters, PerceptionParameters):
    """Of the pipeline node: those of the three stages, and what it shows of its inside."""

    publish_intermediate: bool = parameter(True, "Publish the values between the stages: window and motion.")


@dataclass(frozen=True, kw_only=True)
class SimulationParameters:
    """Of the simulation node."""

    robot: str = parameter("yumi", "Robot to simulate: `yumi`, `pepper`, or the path of a robot file (.toml).")
    robot_description: str = _ROBOT_DESCRIPTION
    gui: bool = parameter(False, "Open a window with the robot.")
    rate_hz: float = parameter(100.0, "Messages on `joint_states` per second.", unit="Hz", minimum=10.0, maximum=240.0)
    camera_rate_hz: float = parameter(
        0.0, "Pictures on `camera/image_raw` per second; each pauses the simulation for about 20 ms.", unit="Hz",
        minimum=0.0, maximum=15.0,
    )  # fmt: skip


NODES = {
    "perception": PerceptionParameters,
    "inference": InferenceParameters,
    "retargeting": RetargetingParameters,
    "pipeline": PipelineParameters,
    "simulation": SimulationParameters,
    "markers": MarkersParameters,
}
"""Parameters by node."""

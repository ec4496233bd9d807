# SPDX-License-Identifier: Apache-2.0
"""What may be set of each node. What a model was trained with comes from its folder and is none of these."""

from __future__ import annotations

from dataclasses import dataclass

from mild_core.perception.settings import PerceptionSettings
from mild_core.retargeting.settings import MIXES, RetargetingSettings
from mild_ros.assembly.marker_settings import MarkersParameters
from mild_ros.assembly.tracker_settings import TrackerParameters
from mild_ros.commands.controller_settings import ROBOT_JOINT_NAMES, ControllerParameters
from mild_ros.node_kit.parameters import parameter

_MODEL = parameter("yumi_buetepage_ahead", "Model: a name of `mild models`, or the path of a folder.")
_ROBOT_DESCRIPTION = parameter(
    "", "URDF in place of the robot's own: a path, or `topic:robot_description`; empty for its own."
)
_REPORT_HANDLED = parameter(False, "Publish the outcome of every input on `handled`, for a replay in lock-step.")


@dataclass(frozen=True)
class PerceptionParameters(TrackerParameters):
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
    side: str = parameter(PerceptionSettings.side, "The person's arm to track.", choices=("right", "left"))
    axes: str = parameter(
        PerceptionSettings.axes,
        "Take the person's axes from the torso at calibration, or as given: x forward, y left, z up.",
        choices=("torso", "given"),
    )
    calibration_s: float = parameter(
        PerceptionSettings.calibration_s,
        "Time of standing still for the calibration.",
        unit="s",
        minimum=0.1,
        maximum=10.0,
    )
    calibration_file: str = parameter(
        "", "File that keeps the calibration for the next start; `~/reset` makes a new one. Empty keeps none."
    )
    max_gap_s: float = parameter(
        PerceptionSettings.max_gap_s, "Longest gap bridged by interpolation.", unit="s", minimum=0.01, maximum=2.0
    )
    min_confidence: float = parameter(
        PerceptionSettings.min_confidence, "Joints with a lower confidence are not used.", minimum=0.0, maximum=1.0
    )
    reacquire_distance_m: float = parameter(
        PerceptionSettings.reacquire_distance_m,
        "Largest distance from the last position at which a detection is the same person.",
        unit="m",
        minimum=0.05,
        maximum=5.0,
    )
    forget_s: float = parameter(
        PerceptionSettings.forget_s, "How long to wait for a lost person.", unit="s", minimum=0.5, maximum=3600.0
    )
    frozen_after_s: float = parameter(
        PerceptionSettings.frozen_after_s,
        "A body that repeats bit for bit for longer is no measurement and is not tracked.",
        unit="s",
        minimum=0.1,
        maximum=10.0,
    )
    keep_body_s: float = parameter(
        PerceptionSettings.keep_body_s,
        "How long a body that is missing from the tracker's messages stays an obstacle, with a growing radius.",
        unit="s",
        minimum=0.1,
        maximum=60.0,
    )
    report_handled: bool = _REPORT_HANDLED


@dataclass(frozen=True)
class InferenceParameters:
    """Of the inference node."""

    model: str = _MODEL
    interaction: str = parameter("auto", "An interaction of the model, or `auto` to recognise it.")
    cautious: bool = parameter(
        False, "Start by the name of an interaction alone, and on more evidence: fewer false starts, later ones."
    )
    robot_joint_names: tuple[str, ...] = ROBOT_JOINT_NAMES
    report_handled: bool = _REPORT_HANDLED


@dataclass(frozen=True)
class RetargetingParameters(ControllerParameters):
    """Of the retargeting node."""

    model: str = _MODEL
    robot: str = parameter("yumi", "Robot to command: `yumi`, `pepper`, or the path of a robot file (.toml).")
    robot_description: str = _ROBOT_DESCRIPTION
    enabled: bool = parameter(RetargetingSettings.start_enabled, "Follow from the start, without a call of `~/enable`.")
    control_rate_hz: float = parameter(
        100.0, "Commands per second; a new motion triggers one more at once.", unit="Hz", minimum=10.0, maximum=500.0
    )
    look_ahead_s: float = parameter(
        RetargetingSettings.look_ahead_s,
        "Look-ahead into the motion that compensates the lag of the limits.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
    )
    stale_after_s: float = parameter(
        RetargetingSettings.stale_after_s,
        "Hold when no motion arrived for longer.",
        unit="s",
        minimum=0.05,
        maximum=10.0,
    )
    max_age_s: float = parameter(
        RetargetingSettings.max_age_s,
        "Hold when the stamp of the newest motion is older.",
        unit="s",
        minimum=0.05,
        maximum=10.0,
    )
    home_after_s: float = parameter(
        RetargetingSettings.home_after_s, "Go home after holding for this long.", unit="s", minimum=0.0, maximum=3600.0
    )
    home_velocity_rad_s: float = parameter(
        RetargetingSettings.home_velocity_rad_s,
        "Largest speed of a joint on the way home.",
        unit="rad/s",
        minimum=0.01,
        maximum=3.0,
    )
    ramp_velocity_rad_s: float = parameter(
        RetargetingSettings.ramp_velocity_rad_s,
        "Largest speed that the ramp-in from the robot's pose onto a motion adds.",
        unit="rad/s",
        minimum=0.01,
        maximum=10.0,
    )
    ik: str = parameter(
        RetargetingSettings.ik,
        "Inverse kinematics: `blend` brings the hands together where they are meant to touch, `off` follows the "
        "learned motion alone, `only` reaches for the person's hand without it.",
        choices=MIXES,
    )
    keep_out_m: float = parameter(
        RetargetingSettings.keep_out_m,
        "Distance kept from everyone in view, except the hand and forearm that are offered.",
        unit="m",
        minimum=0.0,
        maximum=1.0,
    )
    near_speed_m_s: float = parameter(
        RetargetingSettings.near_speed_m_s,
        "Largest speed of any part of the arm within 0.3 m of a person; towards a person, minus their approach.",
        unit="m/s",
        minimum=0.05,
        maximum=2.0,
    )
    allow_unmeasured_contact: bool = parameter(
        RetargetingSettings.allow_unmeasured_contact,
        "Let hands touch although the place of people is only assumed (`robot_from_camera` is empty).",
    )
    placement_uncertainty_m: float = parameter(
        RetargetingSettings.placement_uncertainty_m,
        "Uncertainty of the assumed place of people, added to distances without a measured camera.",
        unit="m",
        minimum=0.0,
        maximum=1.0,
    )
    start_facing_deg: float = parameter(
        RetargetingSettings.start_facing_deg,
        "A motion starts only for a person who faces the robot within this angle, if their place is measured.",
        unit="deg",
        minimum=5.0,
        maximum=180.0,
    )
    start_hand_m: float = parameter(
        RetargetingSettings.start_hand_m,
        "A motion starts only for a hand within this distance of the robot's shoulder, if its place is measured.",
        unit="m",
        minimum=0.1,
        maximum=10.0,
    )
    start_trunk_m: float = parameter(
        RetargetingSettings.start_trunk_m,
        "A motion starts only for a trunk within this distance of the robot's shoulder, if its place is measured.",
        unit="m",
        minimum=0.1,
        maximum=10.0,
    )
    start_watch_s: float = parameter(
        RetargetingSettings.start_watch_s,
        "A motion starts only for a hand raised for this long, neither to the person's own head nor aside.",
        unit="s",
        minimum=0.0,
        maximum=2.0,
    )
    start_reach_m: float = parameter(
        RetargetingSettings.start_reach_m,
        "A hand that went there must be held out this far before it counts again.",
        unit="m",
        minimum=0.05,
        maximum=1.0,
    )
    start_evidence: float = parameter(
        RetargetingSettings.start_evidence,
        "A motion starts only at this mean probability of a recognised interaction over `start_evidence_s`.",
        minimum=0.0,
        maximum=1.0,
    )
    start_evidence_s: float = parameter(
        RetargetingSettings.start_evidence_s,
        "Averaging time of `start_evidence`.",
        unit="s",
        minimum=0.0,
        maximum=2.0,
    )
    interaction_s: float = parameter(
        RetargetingSettings.interaction_s,
        "Longest interaction; then the robot goes home.",
        unit="s",
        minimum=1.0,
        maximum=3600.0,
    )
    report_handled: bool = _REPORT_HANDLED


@dataclass(frozen=True)
class PipelineParameters(RetargetingParameters, InferenceParameters, PerceptionParameters):
    """Of the pipeline node: those of the three stages, and what it shows of its inside."""

    publish_intermediate: bool = parameter(True, "Publish the values between the stages: window and motion.")


@dataclass(frozen=True)
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

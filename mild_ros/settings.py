# SPDX-License-Identifier: Apache-2.0
"""What may be set of each node. What a model was trained with comes from its folder and is none of these."""

from __future__ import annotations

from dataclasses import dataclass

from mild_core.perception.settings import PerceptionSettings
from mild_core.retargeting.settings import MIXES, RetargetingSettings
from mild_ros.controller_settings import ROBOT_JOINT_NAMES, ControllerParameters
from mild_ros.marker_settings import MarkersParameters
from mild_ros.parameters import parameter
from mild_ros.tracker_settings import TrackerParameters

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
        "unknown", "For a source that may point anywhere: where its axes do.", choices=("optical", "rep103", "unknown")
    )
    frame_id: str = parameter(
        "", "The only tf frame to accept, and that tf frames are seen in; empty accepts the first that comes."
    )
    robot_from_camera: str = parameter(
        "",
        "Pose of the tracker's frame in the frame of the robot's base link, as `x y z roll pitch yaw` [m, rad]; when "
        "empty, people are taken to stand where they stood before the robot in the model's recordings.",
    )
    side: str = parameter(PerceptionSettings.side, "The person's arm to watch.", choices=("right", "left"))
    axes: str = parameter(
        PerceptionSettings.axes,
        "Take the person's axes from the torso at calibration, or as given: x forward, y left, z up.",
        choices=("torso", "given"),
    )
    calibration_s: float = parameter(
        PerceptionSettings.calibration_s, "How long to stand still at first.", unit="s", minimum=0.1, maximum=10.0
    )
    calibration_file: str = parameter(
        "", "File that keeps the calibration for the next start; `~/reset` makes a new one. Empty keeps none."
    )
    max_gap_s: float = parameter(
        PerceptionSettings.max_gap_s, "Longest gap bridged by interpolation.", unit="s", minimum=0.01, maximum=2.0
    )
    min_confidence: float = parameter(
        PerceptionSettings.min_confidence, "Least confidence of a joint that is used.", minimum=0.0, maximum=1.0
    )
    reacquire_distance_m: float = parameter(
        PerceptionSettings.reacquire_distance_m,
        "How near to where the person was last seen a body is taken for the same person.",
        unit="m",
        minimum=0.05,
        maximum=5.0,
    )
    forget_s: float = parameter(
        PerceptionSettings.forget_s, "How long to wait for a lost person.", unit="s", minimum=0.5, maximum=3600.0
    )
    frozen_after_s: float = parameter(
        PerceptionSettings.frozen_after_s,
        "A body that is equal to the bit for longer is not measured any more: it is not followed.",
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
    enabled: bool = parameter(RetargetingSettings.start_enabled, "Follow from the start, before `~/enable` is called.")
    control_rate_hz: float = parameter(
        100.0, "Commands per second; a new motion causes one more at once.", unit="Hz", minimum=10.0, maximum=500.0
    )
    look_ahead_s: float = parameter(
        RetargetingSettings.look_ahead_s,
        "How far ahead a motion is read, to make up for the lag of the limits.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
    )
    stale_after_s: float = parameter(
        RetargetingSettings.stale_after_s,
        "Hold when the newest motion came longer ago.",
        unit="s",
        minimum=0.05,
        maximum=10.0,
    )
    max_age_s: float = parameter(
        RetargetingSettings.max_age_s,
        "Hold when the newest motion's stamp is older.",
        unit="s",
        minimum=0.05,
        maximum=10.0,
    )
    home_after_s: float = parameter(
        RetargetingSettings.home_after_s, "Go home after holding for so long.", unit="s", minimum=0.0, maximum=3600.0
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
        "Largest speed that getting from the robot's pose onto a motion may add.",
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
        "Distance kept from everyone in view, but for the hand and forearm that are offered to be touched.",
        unit="m",
        minimum=0.0,
        maximum=1.0,
    )
    near_speed_m_s: float = parameter(
        RetargetingSettings.near_speed_m_s,
        "Largest speed of any part of the arm while it is within 0.3 m of anyone; towards them less their approach.",
        unit="m/s",
        minimum=0.05,
        maximum=2.0,
    )
    allow_unmeasured_contact: bool = parameter(
        RetargetingSettings.allow_unmeasured_contact,
        "Let hands touch also where people are only assumed to stand, as `robot_from_camera` is empty.",
    )
    placement_uncertainty_m: float = parameter(
        RetargetingSettings.placement_uncertainty_m,
        "How far people may be from where they are assumed to stand: added to the distances without a measured camera.",
        unit="m",
        minimum=0.0,
        maximum=1.0,
    )
    start_facing_deg: float = parameter(
        RetargetingSettings.start_facing_deg,
        "The first motion needs a person who faces the robot within this angle, if their place is measured.",
        unit="deg",
        minimum=5.0,
        maximum=180.0,
    )
    start_hand_m: float = parameter(
        RetargetingSettings.start_hand_m,
        "It needs a hand within this distance of the robot's shoulder, if its place is measured.",
        unit="m",
        minimum=0.1,
        maximum=10.0,
    )
    start_trunk_m: float = parameter(
        RetargetingSettings.start_trunk_m,
        "It needs a trunk within this distance of the robot's shoulder, if its place is measured.",
        unit="m",
        minimum=0.1,
        maximum=10.0,
    )
    start_watch_s: float = parameter(
        RetargetingSettings.start_watch_s,
        "It needs a hand raised for so long that went neither to the person's own head nor aside.",
        unit="s",
        minimum=0.0,
        maximum=2.0,
    )
    start_reach_m: float = parameter(
        RetargetingSettings.start_reach_m,
        "A hand that did either must be held out this far before it counts again.",
        unit="m",
        minimum=0.05,
        maximum=1.0,
    )
    start_evidence: float = parameter(
        RetargetingSettings.start_evidence,
        "It needs this probability of a recognised interaction, as a mean over `start_evidence_s`.",
        minimum=0.0,
        maximum=1.0,
    )
    start_evidence_s: float = parameter(
        RetargetingSettings.start_evidence_s,
        "Time over which that probability is averaged.",
        unit="s",
        minimum=0.0,
        maximum=2.0,
    )
    interaction_s: float = parameter(
        RetargetingSettings.interaction_s, "Longest interaction; then home.", unit="s", minimum=1.0, maximum=3600.0
    )
    report_handled: bool = _REPORT_HANDLED


@dataclass(frozen=True)
class PipelineParameters(RetargetingParameters, InferenceParameters, PerceptionParameters):
    """Of the pipeline node: those of the three stages, and what it shows of its inside."""

    publish_intermediate: bool = parameter(True, "Publish what passes between the stages: window and motion.")


@dataclass(frozen=True)
class SimulationParameters:
    """Of the simulation node."""

    robot: str = parameter("yumi", "Robot to simulate: `yumi`, `pepper`, or the path of a robot file (.toml).")
    robot_description: str = _ROBOT_DESCRIPTION
    gui: bool = parameter(False, "Open a window with the robot.")
    rate_hz: float = parameter(100.0, "Messages on `joint_states` per second.", unit="Hz", minimum=10.0, maximum=240.0)
    camera_rate_hz: float = parameter(
        0.0, "Pictures on `camera/image_raw` per second; each stops the robot's time for about 20 ms.", unit="Hz",
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

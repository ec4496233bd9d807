# SPDX-License-Identifier: Apache-2.0
"""A kinematic human: from the recorded track of one arm to a whole standing adult, as a depth camera would see them.

Recordings hold three joints of a right arm in the arm frame (origin at the shoulder of the first frame, x forward,
y left, z up). Here they become people of 32 joints, so that a recording enters the system the way a person does: as
messages of a tracker, through the whole of perception. The person is synthetic but for the arm's directions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from mild_core.perception.skeletons import SOURCES
from mild_core.shapes import FloatArray, read_only, require_shape
from mild_core.signals import SkeletonFrame

BODY_JOINTS: tuple[str, ...] = tuple(SOURCES["azure_kinect"].joint_ids.values())
"""The 32 joints of a body, in the order of the tracker's numbers."""

SHOULDER_HEIGHT_M = 1.42
"""The floor lies this far below the origin of the arm frame."""

_SHOULDER = np.array([0.0, -0.185, SHOULDER_HEIGHT_M])

# An adult of 1.75 m who stands, facing x, the floor between the feet being the origin [m]; the left arm hangs and the
# right one is put on. Pelvis and shoulders lie in one plane, so that the trunk is upright exactly.
_STANDING: dict[str, tuple[float, float, float]] = {
    "pelvis": (0.0, 0.0, 0.96),
    "spine": (-0.015, 0.0, 1.12),
    "chest": (-0.02, 0.0, 1.26),
    "neck": (-0.01, 0.0, 1.47),
    "head": (0.015, 0.0, 1.57),
    "nose": (0.13, 0.0, 1.59),
    "left_eye": (0.085, 0.03, 1.635),
    "right_eye": (0.085, -0.03, 1.635),
    "left_ear": (0.01, 0.072, 1.61),
    "right_ear": (0.01, -0.072, 1.61),
    "left_clavicle": (-0.005, 0.045, 1.44),
    "right_clavicle": (-0.005, -0.045, 1.44),
    "left_shoulder": (0.0, 0.185, SHOULDER_HEIGHT_M),
    "left_elbow": (-0.025, 0.235, 1.136),
    "left_wrist": (0.035, 0.255, 0.896),
    "left_hand": (0.055, 0.25, 0.815),
    "left_hand_tip": (0.065, 0.24, 0.725),
    "left_thumb": (0.085, 0.22, 0.81),
    "left_hip": (0.0, 0.095, 0.93),
    "left_knee": (0.015, 0.115, 0.51),
    "left_ankle": (-0.03, 0.125, 0.09),
    "left_foot": (0.125, 0.155, 0.025),
    "right_hip": (0.0, -0.095, 0.93),
    "right_knee": (0.015, -0.115, 0.51),
    "right_ankle": (-0.03, -0.125, 0.09),
    "right_foot": (0.125, -0.155, 0.025),
}

KNEELING_M: dict[str, tuple[float, float, float]] = {
    "left_elbow": (-0.02, 0.27, 0.185),
    "left_wrist": (0.22, 0.19, 0.245),
    "left_hand": (0.30, 0.175, 0.26),
    "left_hand_tip": (0.385, 0.17, 0.245),
    "left_thumb": (0.29, 0.145, 0.275),
    "left_knee": (0.35, 0.13, 0.20),
    "left_ankle": (0.30, 0.13, -0.235),
    "left_foot": (0.455, 0.155, -0.30),
    "right_knee": (0.345, -0.13, -0.26),
    "right_ankle": (-0.07, -0.13, -0.235),
    "right_foot": (0.085, -0.13, -0.30),
}
"""Seen from the pelvis: the same adult on the right knee, sitting on that heel, the left hand on the other knee; the
shoulders are 0.785 m above the floor then, as those of a small robot are [m]."""

# How much of the right shoulder's way the rest of the trunk follows; what is not named here stays.
_FOLLOWS = {
    **{
        "right_clavicle": 0.7,
        "left_clavicle": 0.5,
        "neck": 0.5,
        "head": 0.5,
        "nose": 0.5,
        "chest": 0.35,
        "spine": 0.15,
    },
    **dict.fromkeys(("left_eye", "right_eye", "left_ear", "right_ear"), 0.5),
    **dict.fromkeys((f"left_{part}" for part in ("shoulder", "elbow", "wrist", "hand", "hand_tip", "thumb")), 0.3),
}

SWAY_M, SWAY_HZ = 0.0005, 0.25
"""How far the shoulders of a standing person sway; less than an adult's, so that it disturbs nothing."""

FIST = 0.3
"""How far beyond the middle of the hand a fist ends, as a share of how far an open hand does."""

_WRIST = 0.75
"""Where the wrist is on the way from elbow to hand."""


@dataclass(frozen=True)
class ArmLengths:
    """Bones of the right arm [m].

    Attributes:
        upper_m: Shoulder to elbow.
        fore_m: Elbow to the middle of the hand.

    Source: the defaults are an adult's (0.29 and 0.25 + 0.085); recordings have a smaller rig's, 0.18 and 0.234.
    """

    upper_m: float = 0.29
    fore_m: float = 0.335


ADULT = ArmLengths()


def bodies(arm_m: FloatArray, lengths: ArmLengths = ADULT) -> FloatArray:
    """Whole people around an arm.

    Args:
        arm_m: (T, 3, 3) shoulder, elbow, hand in the arm frame [m]. Directions of the bones and the way of the
            shoulder are kept, lengths are not.
        lengths: Of the arm that they get.

    Returns:
        (T, 32, 3) positions of `BODY_JOINTS` in the arm frame [m]: z up, the floor at -`SHOULDER_HEIGHT_M`.
    """
    require_shape("arm_m", arm_m, (None, 3, 3))
    shoulder = arm_m[:, 0]
    upper, fore = _directions(arm_m[:, 1] - shoulder), _directions(arm_m[:, 2] - arm_m[:, 1])
    elbow = shoulder + lengths.upper_m * upper
    hand = elbow + lengths.fore_m * fore
    # The thumb points up when the forearm is bent forward; a straight arm bends nowhere, so its elbow axis is y.
    across = _directions(np.cross(fore, np.cross(fore, upper) + np.array([0.0, 1e-9, 0.0])))
    placed = {
        "right_shoulder": shoulder,
        "right_elbow": elbow,
        "right_wrist": elbow + _WRIST * lengths.fore_m * fore,
        "right_hand": hand,
        "right_hand_tip": hand + 0.09 * fore,
        "right_thumb": hand + 0.02 * fore - 0.045 * across,
    }
    for name, place in _STANDING.items():
        placed[name] = np.array(place) - _SHOULDER + _FOLLOWS.get(name, 0.0) * shoulder
    return np.stack([placed[name] for name in BODY_JOINTS], axis=1)


def kneeling(body_m: FloatArray) -> FloatArray:
    """The same people (T, 32, 3) of the arm frame, on one knee; head, trunk and right arm stay."""
    knelt = body_m.copy()
    for name, place in KNEELING_M.items():
        knelt[:, BODY_JOINTS.index(name)] = body_m[:, BODY_JOINTS.index("pelvis")] + place
    return knelt


def with_fist(body_m: FloatArray) -> FloatArray:
    """The same people (T, 32, 3) with the right hand closed: the fingers' tip is at the knuckles."""
    closed = body_m.copy()
    hand, tip = (BODY_JOINTS.index(f"right_{part}") for part in ("hand", "hand_tip"))
    closed[:, tip] = body_m[:, hand] + FIST * (body_m[:, tip] - body_m[:, hand])
    return closed


def with_neutral_second(track: FloatArray, rate_hz: float, seconds: float = 1.0) -> FloatArray:
    """A track (T, ...) whose first frame is held for a while before it, as calibration needs it."""
    return np.concatenate([np.repeat(track[:1], round(rate_hz * seconds), axis=0), track])


@dataclass(frozen=True, eq=False)
class Camera:
    """A depth camera and where it stands.

    Attributes:
        frame_id: Of its optical frame: x right, y down, z away from it.
        arm_from_camera: (4, 4) the camera's pose in the arm frame.
    """

    frame_id: str = "depth_camera_link"
    arm_from_camera: FloatArray = field(default_factory=lambda: looking_at((2.2, 0.7, 0.15), (0.0, 0.2, -0.4)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "arm_from_camera", read_only(self.arm_from_camera))
        require_shape("arm_from_camera", self.arm_from_camera, (4, 4))

    def sees(self, positions_m: FloatArray) -> FloatArray:
        """Positions (..., 3) of the arm frame in the camera's optical frame [m]."""
        seen: FloatArray = (positions_m - self.arm_from_camera[:3, 3]) @ self.arm_from_camera[:3, :3]
        return seen


def looking_at(camera_m: tuple[float, float, float], target_m: tuple[float, float, float]) -> FloatArray:
    """(4, 4) pose of an upright camera's optical frame at one place that looks at another, both z up [m].

    Source: REP-103, suffix frames.
    """
    away = _directions(np.subtract(target_m, camera_m))
    right = _directions(np.cross(away, [0.0, 0.0, 1.0]))
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(away, right), away], axis=1)
    pose[:3, 3] = camera_m
    return pose


def swaying(body_m: FloatArray, times_s: FloatArray, reach_m: float = SWAY_M) -> FloatArray:
    """The same people (T, J, 3) at times (T,), swaying about their feet: no living person stands still to the bit."""
    way = reach_m * np.sin(2.0 * np.pi * SWAY_HZ * times_s)
    height = 1.0 + body_m[:, :, 2] / SHOULDER_HEIGHT_M  # 0 at the floor, so that hips and shoulders differ
    moved: FloatArray = body_m + (way[:, None] * height)[..., None] * np.array([0.6, 0.8, 0.1])
    return moved


def skeleton_frames(
    body_m: FloatArray,
    rate_hz: float,
    start_ns: int,
    camera: Camera | None = None,
    person_id: int = 1,
    sway_m: float = SWAY_M,
) -> Iterator[SkeletonFrame]:
    """People as a tracker reports them.

    Args:
        body_m: (T, 32, 3) as `bodies` makes them.
        rate_hz: Of the tracker.
        start_ns: Stamp of the first frame.
        camera: Where they are seen from.
        person_id: The tracker's number for the person.
        sway_m: How far the shoulders sway; 0 for people who stand still to the bit.

    Yields:
        T frames in the camera's optical frame, all joints seen.
    """
    camera = camera or Camera()
    body_m = swaying(body_m, np.arange(len(body_m)) / rate_hz, sway_m)
    confidence = read_only(np.ones(len(BODY_JOINTS)))
    for index, positions in enumerate(camera.sees(body_m)):
        stamp_ns = start_ns + round(index * 1e9 / rate_hz)
        yield SkeletonFrame(stamp_ns, camera.frame_id, person_id, BODY_JOINTS, positions, confidence)


def _directions(vectors: FloatArray) -> FloatArray:
    """Unit vectors along the last axis; a zero vector stays zero."""
    unit: FloatArray = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
    return unit

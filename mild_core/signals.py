# SPDX-License-Identifier: Apache-2.0
"""The values that travel from a person's skeleton to a robot's command.

    SkeletonFrame -> FeatureWindow -> MotionWindow -> JointCommand
                  -> PersonPose ---------------------^

Each is immutable, its arrays are read-only float64, its stamp is in nanoseconds of the clock that stamped the
skeleton, and its frame is named. Letters of shapes are in `shapes.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mild_core.errors import DataError
from mild_core.shapes import FloatArray, read_only, require_shape

ARM_FRAME = "arm"
"""Name of the arm frame: origin at the calibrated shoulder, x forward, y left, z up of the person."""

ARM_JOINTS = ("shoulder", "elbow", "hand")
"""Of the partner's arm that a model of two people moves."""

ROBOT_FRAME = "robot"
"""Name of the frame of the robot's base link, for positions of a camera that is calibrated to the robot."""


@dataclass(frozen=True, eq=False)
class SkeletonFrame:
    """One person as one tracker message shows them.

    Attributes:
        stamp_ns: When the camera saw it.
        frame_id: The tf frame of the positions (REP-103 axes or the source's own; the source table says which).
        person_id: The tracker's number for the person.
        joint_names: J names of `perception.skeletons.JOINTS`.
        positions_m: (J, 3) metres in `frame_id`; not checked for NaN here.
        confidence: (J,) from 0 (guessed) to 1 (seen); 1 where the tracker gives none.
    """

    stamp_ns: int
    frame_id: str
    person_id: int
    joint_names: tuple[str, ...]
    positions_m: FloatArray
    confidence: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "positions_m", read_only(self.positions_m))
        object.__setattr__(self, "confidence", read_only(self.confidence))
        require_shape("positions_m", self.positions_m, (len(self.joint_names), 3))
        require_shape("confidence", self.confidence, (len(self.joint_names),))


BODY_PARTS = (
    "head",
    "trunk",
    "shoulders",
    "left_upper_arm",
    "left_forearm",
    "right_upper_arm",
    "right_forearm",
    "left_thigh",
    "left_shin",
    "right_thigh",
    "right_shin",
)
"""Segments of a body. A head is a short capsule or a ball, a forearm reaches to the finger tips, a shin to the foot."""

WATCHED_PERSON = 0
"""Number of the watched person among `BodySegments.people`; bystanders have larger ones."""


@dataclass(frozen=True, eq=False)
class BodySegments:
    """Capsules around every body in view: what a robot must keep away from.

    What is hidden is inferred from what is seen, or stays where it was last seen, with a larger radius. A segment that
    cannot be inferred at all is left out, so every number here is finite.

    Attributes:
        people: N numbers: `WATCHED_PERSON`, or a bystander's own, which stays theirs while they are in view.
        parts: N names of `BODY_PARTS`.
        ends_m: (N, 2, 3) ends of the axis of each capsule, the one nearer to the trunk's middle first.
        velocities_m_s: (N, 2, 3) of these ends; zero where unknown.
        radii_m: (N,) with what is not known of the place and of the size.
    """

    people: tuple[int, ...]
    parts: tuple[str, ...]
    ends_m: FloatArray
    velocities_m_s: FloatArray
    radii_m: FloatArray

    def __post_init__(self) -> None:
        count = len(self.people)
        if len(self.parts) != count:
            raise ValueError(f"{len(self.parts)} parts of {count} segments")
        for name, shape in (("ends_m", (count, 2, 3)), ("velocities_m_s", (count, 2, 3)), ("radii_m", (count,))):
            object.__setattr__(self, name, read_only(getattr(self, name)))
            require_shape(name, getattr(self, name), shape)


NO_SEGMENTS = BodySegments((), (), np.zeros((0, 2, 3)), np.zeros((0, 2, 3)), np.zeros(0))
"""No person is in view."""

UNKNOWN_DIRECTION = read_only(np.full(3, np.nan))


@dataclass(frozen=True, eq=False)
class FeatureWindow:
    """The observed agent's last W frames at the model's rate.

    Attributes:
        stamp_ns: Time of the newest row; at most one model period older than the newest skeleton.
        frame_id: The arm frame: origin at the calibration shoulder, x forward, y left, z up.
        joint_names: J names of the model's observed joints.
        features: (W, D), oldest row first. D = 3 J: positions [m], joint by joint; D = 6 J: then velocities [m/s].
    """

    stamp_ns: int
    frame_id: str
    joint_names: tuple[str, ...]
    features: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "features", read_only(self.features))
        joints = len(self.joint_names)
        if self.features.ndim != 2 or self.features.shape[1] not in (3 * joints, 6 * joints):
            raise ValueError(f"features has shape {self.features.shape}, expected (W, {3 * joints} or {6 * joints})")


@dataclass(frozen=True, eq=False)
class PersonPose:
    """Where the watched person is: what a robot may touch, and what it must keep away from.

    Attributes:
        stamp_ns: Of the skeleton it was seen in.
        frame_id: `ROBOT_FRAME`, or `ARM_FRAME` when the camera's pose is unknown: retargeting then takes
            the person to stand where people stood before the robot in the model's recordings.
        hand_m: (3,) middle of the watched hand, as it is: with the person's own bones, a left one not mirrored.
        head_m: (3,) middle of the head.
        trunk_m: (2, 3) middle of the shoulders and of the hips.
            NaN stands in all of these for what was not seen.
        segments: Everyone in view, bystanders too, in the same frame.
        facing: (3,) unit vector to where the watched person's chest points; NaN when it is not known.
        watched: Whether the watched person is in view and calibrated; otherwise only `segments` means something.
    """

    stamp_ns: int
    frame_id: str
    hand_m: FloatArray
    head_m: FloatArray
    trunk_m: FloatArray
    segments: BodySegments = NO_SEGMENTS
    facing: FloatArray = field(default_factory=lambda: UNKNOWN_DIRECTION)
    watched: bool = True

    def __post_init__(self) -> None:
        for name, shape in (("hand_m", (3,)), ("head_m", (3,)), ("trunk_m", (2, 3)), ("facing", (3,))):
            object.__setattr__(self, name, read_only(getattr(self, name)))
            require_shape(name, getattr(self, name), shape)


RESTING, OFFERED, NONE, NAMED = "resting", "offered", "none", "named"
RECOGNITION_STATES = (RESTING, OFFERED, NONE, NAMED)
"""What is known of what the person does: the hand rests; something is being done, not yet known what; nothing that the
model knows; the interaction that is named."""


@dataclass(frozen=True, eq=False)
class MotionWindow:
    """The controlled agent's next window of motion and how sure the model is of it.

    Attributes:
        stamp_ns: Stamp of the feature window it answers.
        lead_ns: Time of row 0 less `stamp_ns`: positive when the model predicts ahead, negative when it predicts
            the window that the human has just shown.
        period_ns: Time between rows.
        joint_names: J names of the controlled joints.
        positions: (W, J) joint angles [rad], or (W, J, 3) the partner's arm [m] for a model of two people.
        covariance: (J, J) of the joint angles averaged over the window [rad^2], or (3 J, 3 J) [m^2].
        interaction: The recognised (or given) interaction; "" when unknown.
        probability: Of that interaction, 0 to 1.
        belief: (K,) over the components of that interaction's prior; sums to one.
        phase: Expected progress through the interaction, 0 at its start to 1 at its end.
        out_of_distribution: Distance of the human's motion from all that the model knows, in units of the largest
            distance it should see: above 1 is unknown.
        state: One of `RECOGNITION_STATES`.
        radii: Mahalanobis distances in `covariance` within which half and nine tenths of the true values lie, in people
            whom the model has not learned from; NaN where that is not known.
        may_start: Whether what the person does may be taken for a known interaction, be it named or not yet. An offered
            hand of which this is not so is not met, and a given interaction is followed slowly.
    """

    stamp_ns: int
    lead_ns: int
    period_ns: int
    joint_names: tuple[str, ...]
    positions: FloatArray
    covariance: FloatArray
    interaction: str
    probability: float
    belief: FloatArray
    phase: float
    out_of_distribution: float
    state: str = NAMED
    radii: tuple[float, float] = (float("nan"), float("nan"))
    may_start: bool = True

    def __post_init__(self) -> None:
        for name in ("positions", "covariance", "belief"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        tail = self.positions.shape[1:]
        if tail not in ((len(self.joint_names),), (len(self.joint_names), 3)):
            raise ValueError(f"positions has shape {self.positions.shape}, expected (W, J) or (W, J, 3)")
        size = self.positions[0].size
        require_shape("covariance", self.covariance, (size, size))
        require_shape("belief", self.belief, (None,))


@dataclass(frozen=True, eq=False)
class JointMeasurement:
    """Where the robot says it is.

    Attributes:
        stamp_ns: When it was measured.
        joint_names: J names.
        positions_rad: (J,).
    """

    stamp_ns: int
    joint_names: tuple[str, ...]
    positions_rad: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "positions_rad", read_only(self.positions_rad))
        require_shape("positions_rad", self.positions_rad, (len(self.joint_names),))

    def of(self, joint_names: tuple[str, ...]) -> FloatArray:
        """(J,) positions of these joints [rad], in this order; it may hold others too.

        Raises:
            DataError: One is missing, or not finite.
        """
        places = {name: place for place, name in enumerate(self.joint_names)}
        missing = [name for name in joint_names if name not in places]
        if missing:
            raise DataError("joints_missing", f"it lacks {', '.join(missing)}")
        positions = self.positions_rad[[places[name] for name in joint_names]]
        if not np.isfinite(positions).all():
            raise DataError("not_finite", "a joint's position is NaN or infinite")
        return read_only(positions)


@dataclass(frozen=True, eq=False)
class JointCommand:
    """What the robot shall do now: inside every limit, continuous with the command before.

    Attributes:
        stamp_ns: When it is sent.
        joint_names: J names, the robot's own order.
        positions_rad: (J,).
        velocities_rad_s: (J,).
        mode: What retargeting was doing (`following`, `holding`, ...).
        motion_stamp_ns: Stamp of the motion window behind it, 0 when there is none.
        stiffness: How hard to hold these positions, from 0 (give way) to 1: a hint for compliant robots.
    """

    stamp_ns: int
    joint_names: tuple[str, ...]
    positions_rad: FloatArray
    velocities_rad_s: FloatArray
    mode: str = field(default="")
    motion_stamp_ns: int = field(default=0)
    stiffness: float = field(default=1.0)

    def __post_init__(self) -> None:
        for name in ("positions_rad", "velocities_rad_s"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
            require_shape(name, getattr(self, name), (len(self.joint_names),))

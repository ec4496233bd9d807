# SPDX-License-Identifier: Apache-2.0
"""Whole people to judge a robot by: bones and thicknesses by stature, poses over time, capsules around all of it.

Nothing here is shared with perception or retargeting: sizes come from anthropometric tables, not from the package.
All positions are true ones, in the robot's base frame: x forward, y left, z up [m].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Direction = tuple[float, float, float]
Arm = tuple[Direction, Direction]
"""Directions of upper arm and forearm: x forward, y left, z up of the person; of any length."""

HANGING: Arm = ((-0.08, -0.08, -1.0), (0.02, -0.06, -1.0))
"""A right arm at rest."""

KINECT_JOINTS = (
    *("pelvis", "spine", "chest", "neck"),
    *("left_clavicle", "left_shoulder", "left_elbow", "left_wrist", "left_hand", "left_hand_tip", "left_thumb"),
    *("right_clavicle", "right_shoulder", "right_elbow", "right_wrist", "right_hand", "right_hand_tip", "right_thumb"),
    *("left_hip", "left_knee", "left_ankle", "left_foot"),
    *("right_hip", "right_knee", "right_ankle", "right_foot"),
    *("head", "nose", "left_eye", "left_ear", "right_eye", "right_ear"),
)
"""Source: `k4abt_joint_id_t` of the Azure Kinect Body Tracking SDK."""

HEAD_JOINTS = ("head", "nose", "left_eye", "left_ear", "right_eye", "right_ear")
LOWER_JOINTS = (
    *("pelvis", "spine", "left_hip", "right_hip", "left_knee", "right_knee"),
    *("left_ankle", "right_ankle", "left_foot", "right_foot"),
)

GROUPS = ("head", "trunk", "left_arm", "right_arm", "legs")
"""What distances are judged to; a forearm with its hand is distinguished from the upper arm by `Capsule.outer`."""


def mirrored(arm: Arm) -> Arm:
    """The left arm that does what this right one does."""
    (ux, uy, uz), (fx, fy, fz) = arm
    return (ux, -uy, uz), (fx, -fy, fz)


def minimum_jerk(share: Array) -> Array:
    """Share of a way for a share of its time. Source: Flash and Hogan 1985, eq. 4."""
    share = np.clip(share, 0.0, 1.0)
    way: Array = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return way


@dataclass(frozen=True)
class Path:
    """Values over time: rest at each key, minimum jerk from one to the next, or straight lines.

    Attributes:
        keys: (time [s], values), ascending; before the first and after the last the value stays.
        straight: Constant speed between keys instead.
    """

    keys: tuple[tuple[float, tuple[float, ...]], ...]
    straight: bool = False

    def at(self, times_s: Array) -> Array:
        """(T, N) values."""
        starts = np.array([key[0] for key in self.keys])
        values = np.array([key[1] for key in self.keys], dtype=np.float64)
        if len(starts) == 1:
            return np.repeat(values, len(times_s), axis=0)
        index = np.clip(np.searchsorted(starts, times_s, side="right") - 1, 0, len(starts) - 2)
        share = (times_s - starts[index]) / np.maximum(np.diff(starts)[index], 1e-9)
        way = np.clip(share, 0.0, 1.0) if self.straight else minimum_jerk(share)
        moved: Array = values[index] + way[:, None] * (values[index + 1] - values[index])
        return moved


def path(*keys: tuple[float, Sequence[float]], straight: bool = False) -> Path:
    """A path through keys."""
    return Path(tuple((time_s, tuple(float(value) for value in values)) for time_s, values in keys), straight)


def arm_path(*keys: tuple[float, Arm]) -> Path:
    """A path of an arm: six numbers, the two directions."""
    return path(*[(time_s, (*_unit(upper), *_unit(fore))) for time_s, (upper, fore) in keys])


@dataclass(frozen=True)
class Sizes:
    """Lengths and radii of a person [m].

    Source: segment lengths as shares of stature, Drillis and Contini 1966 (in D. Winter, Biomechanics and Motor
    Control of Human Movement, fig. 4.1); thicknesses from DIN 33402-2 (50th percentiles: chest depth 0.22, breadth
    0.33, upper arm 0.095, forearm 0.08, thigh 0.15, calf 0.11 m at 1.75 m), scaled with stature; a child's head is as
    much larger in proportion as in the tables of Snyder et al. 1977.
    """

    stature_m: float
    girth: float = 1.0

    def length(self, share: float) -> float:
        """A share of the stature."""
        return share * self.stature_m

    def radius(self, share: float) -> float:
        """A share of the stature, times how thick the person is."""
        return share * self.stature_m * self.girth

    @property
    def head_height_m(self) -> float:
        """From chin to top."""
        return 0.144 + 0.0462 * self.stature_m

    @property
    def arm_m(self) -> tuple[float, float]:
        """Shoulder to elbow, elbow to the middle of the hand."""
        return self.length(0.175), self.length(0.191)


@dataclass(frozen=True)
class Capsule:
    """One body to measure distances to.

    Attributes:
        group: Of `GROUPS`.
        outer: Whether it is a forearm or a hand.
        start: Name of the point at one end of the axis.
        end: At the other.
        radius_m: Its radius.
    """

    group: str
    outer: bool
    start: str
    end: str
    radius_m: float


def capsules_of(sizes: Sizes) -> tuple[Capsule, ...]:
    """All bodies of a person."""
    head = 0.4 * sizes.head_height_m
    made = [
        Capsule("head", False, "head_low", "head_high", head),
        Capsule("head", False, "neck", "head", sizes.radius(0.031)),
        Capsule("trunk", False, "column_low_left", "column_high_left", sizes.radius(0.06)),
        Capsule("trunk", False, "column_low_right", "column_high_right", sizes.radius(0.06)),
        Capsule("trunk", False, "left_hip", "right_hip", sizes.radius(0.055)),
        Capsule("trunk", False, "left_shoulder", "right_shoulder", sizes.radius(0.033)),
    ]
    for side in ("left", "right"):
        made += [
            Capsule(f"{side}_arm", False, f"{side}_shoulder", f"{side}_elbow", sizes.radius(0.027)),
            Capsule(f"{side}_arm", True, f"{side}_elbow", f"{side}_wrist", sizes.radius(0.023)),
            Capsule(f"{side}_arm", True, f"{side}_wrist", f"{side}_hand_tip", sizes.radius(0.017)),
            Capsule("legs", False, f"{side}_hip", f"{side}_knee", sizes.radius(0.043)),
            Capsule("legs", False, f"{side}_knee", f"{side}_ankle", sizes.radius(0.031)),
            Capsule("legs", False, f"{side}_ankle", f"{side}_foot", sizes.radius(0.022)),
        ]
    return tuple(made)


@dataclass(frozen=True, eq=False)
class Person:
    """A person who moves.

    Attributes:
        sizes: Of the body.
        root: Where they stand: x, y [m] and the direction they face [rad], 0 along the robot's x.
        right: The right arm: an `arm_path`, ...
        left: ... and the left one.
        lean: How far the trunk is bent forward [rad]; path of one number.
        seated: On a chair.
        floor_m: Height of what they stand on.
        offers: The side whose forearm and hand may be touched; "" for neither.
        confidence: Of each joint at a time: (time [s], joint name) -> 0 to 1.
        hidden_m: Standard deviation of the places of joints whose confidence is below 0.5.
        seen: Whether the tracker sees them at a time.
        number: The tracker's number at a time.
        reach: Where a hand is brought, in place of its path: (side, path of x, y, z in the robot's frame and of the
            share from 0, as the path says, to 1).
    """

    sizes: Sizes
    root: Path
    right: Path = field(default_factory=lambda: arm_path((0.0, HANGING)))
    left: Path = field(default_factory=lambda: arm_path((0.0, mirrored(HANGING))))
    lean: Path = field(default_factory=lambda: path((0.0, (0.0,))))
    seated: bool = False
    floor_m: float = -0.7
    offers: str = ""
    confidence: Callable[[float, str], float] | None = None
    hidden_m: float = 0.03
    seen: Callable[[float], bool] = lambda _: True
    number: Callable[[float], int] = lambda _: 1
    reach: tuple[tuple[str, Path], ...] = ()

    def points(self, times_s: Array) -> dict[str, Array]:
        """(T, 3) places of every joint and end of a capsule, by name."""
        size, root = self.sizes, self.root.at(times_s)
        cosine, sine = np.cos(root[:, 2]), np.sin(root[:, 2])

        def placed(local: Array) -> Array:
            x = root[:, 0] + cosine * local[:, 0] - sine * local[:, 1]
            y = root[:, 1] + sine * local[:, 0] + cosine * local[:, 1]
            return np.stack([x, y, self.floor_m + local[:, 2]], axis=1)

        hip_z = size.length(0.29 if self.seated else 0.53)
        lean = self.lean.at(times_s)[:, 0]
        up, forth = np.cos(lean), np.sin(lean)

        def upper(forward: float, left: float, above: float) -> Array:
            """Of the trunk: forward, left, and above the hips, before it leans."""
            x = forward * up + above * forth
            z = hip_z + above * up - forward * forth
            return np.stack([x, np.full_like(x, left), z], axis=1)

        long, head = size.length, size.head_height_m
        torso, head_z = long(0.288), long(0.47) - head / 2.0
        held: dict[str, Array] = {
            "pelvis": upper(0.0, 0.0, long(0.01)),
            "spine": upper(-0.01, 0.0, long(0.1)),
            "chest": upper(-0.01, 0.0, long(0.19)),
            "neck": upper(-0.01, 0.0, long(0.31)),
            "head": upper(0.015, 0.0, head_z),
            "head_low": upper(0.015, 0.0, head_z - 0.1 * head),
            "head_high": upper(0.015, 0.0, head_z + 0.1 * head),
            "nose": upper(0.115, 0.0, head_z + 0.01),
            "column_low_left": upper(0.0, long(0.03), long(0.03)),
            "column_low_right": upper(0.0, -long(0.03), long(0.03)),
            "column_high_left": upper(0.0, long(0.035), torso - long(0.03)),
            "column_high_right": upper(0.0, -long(0.035), torso - long(0.03)),
        }
        for side, sign in (("left", 1.0), ("right", -1.0)):
            held[f"{side}_eye"] = upper(0.08, sign * 0.03, head_z + 0.03)
            held[f"{side}_ear"] = upper(0.01, sign * 0.07, head_z + 0.01)
            held[f"{side}_clavicle"] = upper(0.0, sign * long(0.025), long(0.295))
            held[f"{side}_shoulder"] = upper(0.0, sign * long(0.1055), torso)
            held[f"{side}_hip"] = upper(0.0, sign * long(0.05), 0.0)
            straight = np.ones(len(times_s))
            if self.seated:
                legs = ((long(0.24), 0.055, 0.285), (long(0.25), 0.055, 0.039), (long(0.35), 0.06, 0.015))
            else:
                legs = ((0.015, 0.055, 0.285), (-0.03, 0.06, 0.039), (long(0.09), 0.065, 0.015))
            for joint, (forward, width, height) in zip(("knee", "ankle", "foot"), legs, strict=True):
                local = np.stack([forward * straight, sign * long(width) * straight, long(height) * straight], axis=1)
                held[f"{side}_{joint}"] = local
        placed_all = {name: placed(local) for name, local in held.items()}
        for side, arm in (("left", self.left), ("right", self.right)):
            self._add_arm(placed_all, side, arm.at(times_s), times_s, (cosine, sine))
        return placed_all

    def _add_arm(
        self, points: dict[str, Array], side: str, arm: Array, times_s: Array, facing: tuple[Array, Array]
    ) -> None:
        cosine, sine = facing

        def turned(local: Array) -> Array:
            x, y, z = _units(local).T
            return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)

        upper, fore = turned(arm[:, :3]), turned(arm[:, 3:])
        shoulder, (upper_m, fore_m) = points[f"{side}_shoulder"], self.sizes.arm_m
        for reaching, way in self.reach:
            if reaching == side:
                keys = way.at(times_s)
                aimed_upper, aimed_fore = bent(shoulder, keys[:, :3], upper_m, fore_m, facing, side)
                share = keys[:, 3:]
                upper = _units((1.0 - share) * upper + share * aimed_upper)
                fore = _units((1.0 - share) * fore + share * aimed_fore)
        elbow = shoulder + upper_m * upper
        length = self.sizes.length
        across = _units(np.cross(fore, np.array([0.0, 0.0, 1.0]) + 1e-6 * fore[:, ::-1]))
        points[f"{side}_elbow"] = elbow
        points[f"{side}_wrist"] = elbow + length(0.146) * fore
        points[f"{side}_hand"] = elbow + fore_m * fore
        points[f"{side}_hand_tip"] = elbow + length(0.24) * fore
        points[f"{side}_thumb"] = elbow + fore_m * fore + (0.045 if side == "right" else -0.045) * across


def bent(
    shoulder: Array, target: Array, upper_m: float, fore_m: float, facing: tuple[Array, Array], side: str
) -> tuple[Array, Array]:
    """(T, 3) directions of upper arm and forearm that bring a hand to a target, as near as the arm is long.

    The elbow hangs down and a little outwards. Source: the law of cosines.
    """
    way = target - shoulder
    far = np.linalg.norm(way, axis=1, keepdims=True)
    along = way / np.maximum(far, 1e-9)
    far = np.clip(far, abs(upper_m - fore_m) + 0.02, upper_m + fore_m - 0.005)
    cosine, sine = facing
    out = -0.35 if side == "right" else 0.35
    down = np.stack([-out * sine, out * cosine, np.full_like(sine, -1.0)], axis=1)
    aside = _units(down - (down * along).sum(axis=1, keepdims=True) * along)
    angle = np.arccos(np.clip((upper_m**2 + far**2 - fore_m**2) / (2.0 * upper_m * far), -1.0, 1.0))
    upper = np.cos(angle) * along + np.sin(angle) * aside
    fore = _units(far * along - upper_m * upper)
    return upper, fore


def _unit(direction: Sequence[float]) -> tuple[float, ...]:
    vector = np.asarray(direction, dtype=np.float64)
    return tuple((vector / np.linalg.norm(vector)).tolist())


def _units(vectors: Array) -> Array:
    unit: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
    return unit

# SPDX-License-Identifier: Apache-2.0
"""What has to be known of a tracker to read it: numbers, names, axes. Constants only; messages are read elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from mild_core.errors import SetupError, unknown_name

_SIDES = ("left", "right")
_PAIRED = (
    *("clavicle", "shoulder", "elbow", "wrist", "hand", "hand_tip", "thumb"),
    *("hip", "knee", "ankle", "foot", "eye", "ear"),
)

JOINTS: tuple[str, ...] = (
    *("pelvis", "spine", "chest", "neck", "head", "nose"),
    *(f"{side}_{part}" for side in _SIDES for part in _PAIRED),
)
"""Every joint that a `SkeletonFrame` may name; left and right are the person's own."""

Axes = Literal["optical", "rep103", "unknown"]
AXES: tuple[Axes, ...] = ("optical", "rep103", "unknown")
"""Where a source's axes point: optical is x right, y down, z away from the camera; rep103 has z up (REP-103)."""

PERSON = "{}"
"""In a place of `SkeletonSource.places`: stands for the tracker's name of the person."""


@dataclass(frozen=True, kw_only=True)
class SkeletonSource:
    """How one kind of tracker numbers and measures people, and what its user should know.

    Attributes:
        name: As the parameter `source` names it.
        message: The kind of message, a key of the table of adapters (`marker_array`, `pose_array`, ...).
        driver: Who publishes it.
        start: What starts it, or how to make it publish what is read here.
        confidence: Where the confidence of a joint comes from.
        tested: On what it has been tried.
        joint_ids: Number or index in the message to name of the joint; empty until given by parameter.
        axes: Of the positions; "unknown" when a parameter has to say, which turns off the check of the up axis.
        formats: Several `joint_ids`, for messages that say by number which of them they follow.
        other_ids: Numbers that belong to a message but to no joint that is used: lines, labels, toes.
        ids_per_person: The person's number is the message's id divided by this; 0 when a message holds one person
            and gives no person numbers, or numbers people by itself.
        confidence_of_colour: Confidence by (red, green, blue), for drivers that paint it; a person all in one
            colour says nothing, as drivers also paint each person in a colour.
        places: Joint to its own topics or tf frames, for trackers with one each; the first of a joint's that is there
            counts, and `PERSON` in it stands for whose it is.
        root: The tf frame that positions of tf frames are wanted in; empty takes the root of the tree.
    """

    name: str
    message: str
    driver: str
    start: str
    confidence: str = "none: all count as seen"
    tested: str
    joint_ids: Mapping[int, str] = field(default_factory=dict)
    axes: Axes = "unknown"
    formats: tuple[Mapping[int, str], ...] = ()
    other_ids: frozenset[int] = frozenset()
    ids_per_person: int = 0
    confidence_of_colour: tuple[tuple[tuple[float, float, float], float], ...] = ()
    places: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    root: str = ""

    def with_joints(
        self, joint_names: tuple[str, ...], axes: Axes = "unknown", places: tuple[str, ...] = ()
    ) -> SkeletonSource:
        """This source with its joints in the order given, for messages that do not number them.

        Args:
            joint_names: A name of `JOINTS` for each place of the message; "" for a place to pass over.
            axes: Where the positions' axes point; some drivers can be configured to turn them.
            places: Topic or tf frame of each of `joint_names`, for trackers with one each; empty for their own names.

        Raises:
            SetupError: A name is unknown or comes twice, none is given, or there are more or fewer places.
        """
        named = [name for name in joint_names if name]
        for name in named:
            if name not in JOINTS:
                raise unknown_name("joint_names", name, JOINTS)
        if not named or len(set(named)) != len(named):
            raise SetupError("joint_names", f"{list(joint_names)} has no joints or one twice", "name each joint once")
        if places and len(places) != len(joint_names):
            problem = f"has {len(places)} names for {len(joint_names)} joints"
            raise SetupError("joint_places", problem, "give one for each of joint_names, in the same order")
        return replace(
            self,
            joint_ids={place: name for place, name in enumerate(joint_names) if name},
            axes=axes,
            places={name: (place,) for name, place in zip(joint_names, places or joint_names, strict=True) if name},
        )

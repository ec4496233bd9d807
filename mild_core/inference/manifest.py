# SPDX-License-Identifier: Apache-2.0
"""What a model is and was trained with: `manifest.json` as a value. Nothing of it can be overridden by a parameter."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from mild_core.errors import unknown_name
from mild_core.inference.networks import LayerSpec

FORMAT_VERSION = 1
AUTO = "auto"
"""In place of an interaction's name: it is recognised."""

PROTOCOLS = ("same", "ahead", "next")
FEATURES = ("positions", "positions_velocities")
OBSERVED_KINDS = ("human_arm",)
CONTROLLED_KINDS = {"robot_joints": "rad", "human_arm": "m"}
"""What a model can move, and in which unit it says so."""

NETWORKS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "context": (("window", "label"),),
    "encoder": (("context", "window"), ("window",)),
    "residual": (("context", "window", "label"),),
    "decoder": (("controlled", "label"), ("controlled",)),
    "recogniser": (("window",),),
}
"""The networks that a member can have, and what each takes in; of two, the second is the paper's."""

REQUIRED_NETWORKS = ("encoder", "decoder")


@dataclass(frozen=True)
class ObservedAgent:
    """The person as the model sees them.

    Attributes:
        kind: One of `OBSERVED_KINDS`.
        joint_names: J joints without side: shoulder, elbow, hand.
        unit: m.
        bone_lengths_m: Upper arm and forearm that every person is scaled to.
        side: "right" or "left": whose motion it learned.
    """

    kind: str
    joint_names: tuple[str, ...]
    unit: str
    bone_lengths_m: tuple[float, float]
    side: str


@dataclass(frozen=True)
class ControlledAgent:
    """Whom the model moves.

    Attributes:
        kind: A key of `CONTROLLED_KINDS`.
        robot: A name of the table of robots; "human" for a partner's arm.
        joint_names: J, in the order of the model's outputs.
        unit: rad, or m.
    """

    kind: str
    robot: str
    joint_names: tuple[str, ...]
    unit: str

    @property
    def values(self) -> int:
        """Numbers of one frame: an angle per joint, or three coordinates."""
        return len(self.joint_names) * (1 if self.unit == "rad" else 3)


@dataclass(frozen=True)
class PriorSpec:
    """Kind and sizes of the priors; see `priors/prior.py`.

    Attributes:
        kind: A key of `PRIORS`.
        components: K.
        max_duration: D, in steps of the chain: `stride` frames each.
    """

    kind: str
    components: int
    max_duration: int


@dataclass(frozen=True)
class NetworkSpec:
    """One network of a member.

    Attributes:
        inputs: What it takes in, one of the ways in `NETWORKS`, concatenated in this order.
        layers: In order.
    """

    inputs: tuple[str, ...]
    layers: tuple[LayerSpec, ...]


@dataclass(frozen=True)
class HumanPlacement:
    """Where the person's calibration shoulder stands in the robot's base frame during an interaction.

    Attributes:
        translation_m: x forward, y left, z up.
        yaw_rad: Of the person's forward axis.
        by_interaction: Own places for interactions whose hands touch: x, y, z by name.
        arm_lengths_m: Upper arm and forearm of the person for whom these places hold; None: the observed agent's.
        contact_distance_m: Mean distance of hand and tool while they touch, by name of the interaction.
    """

    translation_m: tuple[float, float, float]
    yaw_rad: float
    by_interaction: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    arm_lengths_m: tuple[float, float] | None = None
    contact_distance_m: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Manifest:
    """All of `manifest.json`.

    Attributes:
        name: Of the model.
        protocol: One of `PROTOCOLS`: what its errors may be compared with.
        observed: The person.
        controlled: The robot, or the partner.
        rate_hz: Of its windows' rows.
        window: W.
        lead_frames: Row 0 of a prediction less the newest observed frame, in frames.
        features: One of `FEATURES`.
        latent_size: Of each agent: Q.
        stride: S copies of everything that remembers take turns, so that each sees every S-th window.
        interactions: P names, in the order of all arrays.
        rest_s: How long people rested before their motion in the recordings, see `resting`; 0: unknown [s].
        prior: Kind and sizes.
        members: Networks by name, one mapping per member of the ensemble.
        robot_from_human: See `HumanPlacement`.
        contact: Interactions in which hands touch: from which to which share of the motion they do.
        training: Data, licence, split, seeds, revision: for people.
        licence: Of all that was learned from, the recogniser's people included, as an SPDX expression: `NOASSERTION`
            where a source states none; "" in folders written before it was kept.
        errors: Measured ones by protocol: for people.
        sha256: Of every other file in the folder.
    """

    name: str
    protocol: str
    observed: ObservedAgent
    controlled: ControlledAgent
    rate_hz: float
    window: int
    lead_frames: int
    features: str
    latent_size: int
    interactions: tuple[str, ...]
    prior: PriorSpec
    members: tuple[Mapping[str, NetworkSpec], ...]
    robot_from_human: HumanPlacement
    contact: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    stride: int = 1
    rest_s: float = 0.0
    training: Mapping[str, Any] = field(default_factory=dict)
    licence: str = ""
    errors: Mapping[str, Any] = field(default_factory=dict)
    sha256: Mapping[str, str] = field(default_factory=dict)
    format_version: int = FORMAT_VERSION

    @property
    def frame_values(self) -> int:
        """D: numbers of one observed frame."""
        return len(self.observed.joint_names) * (3 if self.features == "positions" else 6)

    def check_interaction(self, name: str) -> None:
        """Make sure that the model knows an interaction, or is to recognise it.

        Raises:
            SetupError: It does not; those that it knows are listed.
        """
        if name not in (AUTO, *self.interactions):
            raise unknown_name(f"interaction of model {self.name}", name, (AUTO, *self.interactions))

    def source_sizes(self) -> dict[str, int]:
        """How many numbers each input of `NETWORKS` has, but for the context, whose network says so."""
        return {
            "window": self.window * self.frame_values,
            "label": len(self.interactions),
            "controlled": self.latent_size,
        }

    def to_json(self) -> str:
        """The text of `manifest.json`."""
        return json.dumps(asdict(self), indent=1) + "\n"

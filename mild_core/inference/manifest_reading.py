# SPDX-License-Identifier: Apache-2.0
"""From the text of a `manifest.json`, which may say anything, to a `Manifest` whose every value has been checked."""

from __future__ import annotations

from pathlib import Path

from mild_core.budgets import SETTINGS_BYTES, parse_json, read_file
from mild_core.errors import ModelError
from mild_core.fields import Fields
from mild_core.inference.manifest import (
    CONTROLLED_KINDS,
    FEATURES,
    FORMAT_VERSION,
    NETWORKS,
    OBSERVED_KINDS,
    PROTOCOLS,
    REQUIRED_NETWORKS,
    ControlledAgent,
    HumanPlacement,
    Manifest,
    NetworkSpec,
    ObservedAgent,
    PriorSpec,
)
from mild_core.inference.networks import LayerSpec
from mild_core.inference.priors import PRIORS

WHOLE = (0.0, 1.0)
"""Of a motion, where it is not known when hands touch in it."""


def read_manifest(folder: Path) -> Manifest:
    """Read and check `manifest.json` of a model folder, and nothing else of it.

    Raises:
        ModelError: When there is none, or a key is missing, unknown or out of its bounds; the key is named.
    """
    path = folder / "manifest.json"
    if not path.exists():
        raise ModelError(str(folder), "is no model folder: it has no manifest.json", "give the folder of a model")
    content = read_file(path, SETTINGS_BYTES, "this is no manifest", ModelError)
    try:
        data = parse_json(content)
    except ValueError as error:
        raise ModelError(str(path), f"is no JSON ({error})", "take the folder as it was trained") from None
    if not isinstance(data, dict):
        raise ModelError(str(path), "holds no JSON object", "take the folder as it was trained")
    return parse_manifest(Fields(str(path), "", data))


def parse_manifest(fields: Fields) -> Manifest:
    """The manifest from the fields of its file.

    Raises:
        ModelError: Naming the key at fault.
    """
    version = fields.integer("format_version", 0, 1_000_000)
    if version != FORMAT_VERSION:
        raise fields.wrong("format_version", f"is {version}", f"this program reads version {FORMAT_VERSION}")
    fields.only(Manifest.__dataclass_fields__)
    protocol, window = fields.text("protocol", PROTOCOLS), fields.integer("window", 1, 1000)
    lead_frames = fields.integer("lead_frames", -1000, 1000)
    if lead_frames != (1 - window if protocol == "same" else 1):
        raise fields.wrong("lead_frames", f"is {lead_frames}, which is not protocol '{protocol}' at window {window}")
    interactions = fields.names("interactions", 64)
    placement = read_placement(fields.object("robot_from_human"), interactions)
    return Manifest(
        name=fields.text("name"),
        protocol=protocol,
        observed=read_observed(fields.object("observed")),
        controlled=read_controlled(fields.object("controlled")),
        rate_hz=fields.number("rate_hz", 0.1, 1000.0),
        window=window,
        lead_frames=lead_frames,
        features=fields.text("features", FEATURES),
        latent_size=fields.integer("latent_size", 1, 64),
        stride=fields.integer("stride", 1, 64) if "stride" in fields.values else 1,
        rest_s=fields.number("rest_s", 0.0, 100.0) if "rest_s" in fields.values else 0.0,
        interactions=interactions,
        prior=_prior(fields.object("prior")),
        members=tuple(_member(member) for member in fields.objects("members", 16)),
        robot_from_human=placement,
        contact=_contact(fields, placement, interactions),
        training=fields.object("training").values,
        licence=fields.text("licence") if fields.values.get("licence") else "",
        errors=fields.object("errors").values,
        sha256=_digests(fields.object("sha256")),
    )


def read_observed(fields: Fields) -> ObservedAgent:
    """The observed agent, as described in a manifest.

    Raises:
        SetupError: A key is missing, unknown or out of its bounds; of the kind that `fields` raises.
    """
    fields.only(ObservedAgent.__dataclass_fields__)
    upper, fore = fields.numbers("bone_lengths_m", 2, 0.01, 2.0)
    return ObservedAgent(
        fields.text("kind", OBSERVED_KINDS),
        fields.names("joint_names", 64),
        fields.text("unit", ("m",)),
        (upper, fore),
        fields.text("side", ("right", "left")),
    )


def read_controlled(fields: Fields) -> ControlledAgent:
    """The controlled agent, as described in a manifest.

    Raises:
        SetupError: A key is missing, unknown or out of its bounds; of the kind that `fields` raises.
    """
    fields.only(ControlledAgent.__dataclass_fields__)
    kind = fields.text("kind", CONTROLLED_KINDS)
    unit = fields.text("unit", (CONTROLLED_KINDS[kind],))
    return ControlledAgent(kind, fields.text("robot"), fields.names("joint_names", 64), unit)


def _prior(fields: Fields) -> PriorSpec:
    fields.only(PriorSpec.__dataclass_fields__)
    return PriorSpec(
        fields.text("kind", PRIORS),
        fields.integer("components", 1, 100),
        fields.integer("max_duration", 1, 5000),
    )


def read_placement(fields: Fields, interactions: tuple[str, ...]) -> HumanPlacement:
    """Where the person stood, as described in a manifest.

    Raises:
        SetupError: A key is missing, unknown or out of its bounds; of the kind that `fields` raises.
    """
    fields.only(HumanPlacement.__dataclass_fields__)
    x, y, z = fields.numbers("translation_m", 3, -10.0, 10.0)
    lengths = fields.numbers("arm_lengths_m", 2, 0.01, 2.0) if fields.values.get("arm_lengths_m") is not None else None
    places, distances = _optional(fields, "by_interaction"), _optional(fields, "contact_distance_m")
    for part in (places, distances):
        part.only(interactions)
    own: dict[str, tuple[float, float, float]] = {}
    for name in places.values:
        own_x, own_y, own_z = places.numbers(name, 3, -10.0, 10.0)
        own[name] = (own_x, own_y, own_z)
    return HumanPlacement(
        translation_m=(x, y, z),
        yaw_rad=fields.number("yaw_rad", -6.3, 6.3),
        by_interaction=own,
        arm_lengths_m=(lengths[0], lengths[1]) if lengths else None,
        contact_distance_m={name: distances.number(name, 0.0, 10.0) for name in distances.values},
    )


def _contact(
    fields: Fields, placement: HumanPlacement, interactions: tuple[str, ...]
) -> dict[str, tuple[float, float]]:
    """Where hands touch; folders written before it was kept name a place for each interaction in which they do."""
    if "contact" not in fields.values:
        return dict.fromkeys(placement.by_interaction, WHOLE)
    contact, found = fields.object("contact"), dict[str, tuple[float, float]]()
    contact.only(interactions)
    for name in contact.values:
        first, last = contact.numbers(name, 2, 0.0, 1.0)
        if first > last:
            raise contact.wrong(name, f"goes from {first:g} to {last:g}", "give the smaller share first")
        found[name] = (first, last)
    return found


def _optional(fields: Fields, key: str) -> Fields:
    return fields.object(key) if key in fields.values else fields.below(key, {})


def _digests(fields: Fields) -> dict[str, str]:
    digests = {name: fields.text(name) for name in fields.values}
    for name, digest in digests.items():
        if len(digest) != 64 or not set(digest) <= set("0123456789abcdef"):
            raise fields.wrong(name[:40], "is no SHA-256 in hexadecimal")
    return digests


def _member(fields: Fields) -> dict[str, NetworkSpec]:
    fields.only(NETWORKS)
    for name in REQUIRED_NETWORKS:
        fields.take(name)
    return {name: _network(fields.object(name), NETWORKS[name]) for name in fields.values}


def _network(fields: Fields, ways: tuple[tuple[str, ...], ...]) -> NetworkSpec:
    fields.only(NetworkSpec.__dataclass_fields__)
    inputs = fields.names("inputs", 3)
    if inputs not in ways:
        known = " or ".join(" + ".join(way) for way in ways)
        raise fields.wrong("inputs", f"is {' + '.join(inputs)}", f"use {known}")
    return NetworkSpec(inputs, tuple(_layer(layer) for layer in fields.objects("layers", 32)))


def _layer(fields: Fields) -> LayerSpec:
    fields.only(LayerSpec.__dataclass_fields__)
    activation = fields.text("activation") if "activation" in fields.values else "identity"
    name = fields.text("name")
    if not name.replace("_", "").isalnum():
        raise fields.wrong("name", "may only have letters, digits and underscores")
    try:
        return LayerSpec(
            fields.text("kind"), name, fields.integer("inputs", 1, 8192), fields.integer("outputs", 1, 8192), activation
        )
    except ValueError as error:
        raise fields.wrong("kind", f"cannot be: {error}") from None

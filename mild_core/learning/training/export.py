# SPDX-License-Identifier: Apache-2.0
"""From what torch has learned to what the run time reads: layers as data, arrays by name, one manifest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mild_core.inference.manifest import (
    ControlledAgent,
    HumanPlacement,
    Manifest,
    NetworkSpec,
    ObservedAgent,
    PriorSpec,
)
from mild_core.inference.motion_model import gaussian_radii
from mild_core.inference.networks import LayerSpec
from mild_core.learning.data.coordinates import Coordinates
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import onset_frame
from mild_core.learning.training.contact_phases import contact_phases
from mild_core.learning.training.corpus import corpus_of
from mild_core.learning.training.novelty import bone_lengths_m, latent_radius, territory_of
from mild_core.learning.training.settings import TrainingSettings
from mild_core.learning.training.trained import TrainedMember, TrainedModel
from mild_core.learning.training.vae import RUNNING, LayerStack
from mild_core.shapes import FloatArray

Arrays = dict[str, NDArray[Any]]

MORE_REST_S = 0.25
"""What an onset is seen later by who takes the first frame, not the mean of the first ten, for the place of rest."""

ORIGIN = HumanPlacement((1.0, 0.0, 0.7), np.pi)
"""Default place of a person: an arm's length before the robot, facing it."""


@dataclass(frozen=True)
class ModelFacts:
    """What a manifest says and training does not know.

    Attributes:
        name: Of the model.
        robot: Name in `retargeting.robots.ROBOTS`; of no account where a partner's arm is controlled.
        side: Arm of the person.
        placement: Where the person stands.
        training: For people: data set, licence, split, trials, seeds, revision.
        licence: Of all that was learned from, see `Manifest.licence`.
        errors: Measured ones, for people.
    """

    name: str
    robot: str = "yumi"
    side: str = "right"
    placement: HumanPlacement = ORIGIN
    training: Mapping[str, Any] = field(default_factory=dict)
    licence: str = ""
    errors: Mapping[str, Any] = field(default_factory=dict)


def export(
    trained: TrainedModel,
    demonstrations: Sequence[Demonstration],
    residual_covariance: FloatArray,
    facts: ModelFacts,
    covariance_scale: Mapping[str, float] = MappingProxyType({}),
    radii: Mapping[str, Sequence[float]] = MappingProxyType({}),
) -> tuple[Manifest, Arrays]:
    """Put a trained model into the form that `inference.model.save_model` and `build_model` take.

    Args:
        trained: The model.
        demonstrations: It was trained on; only radii and bone lengths are measured on them, nothing of them is kept.
        residual_covariance: (J, J) of the error by cross-validation [rad^2].
        facts: All else.
        covariance_scale: What the published covariance is multiplied with, by interaction; 1 where nothing is said.
        radii: Of its two regions, by interaction, see `Calibration`; those of a Gaussian where nothing is said.
    """
    corpus = corpus_of(demonstrations, trained.protocol, trained.interactions)
    territory = territory_of(demonstrations, trained.protocol, trained.interactions, trained.seed)
    members, arrays = [], {"residual_covariance": np.asarray(residual_covariance, dtype=np.float64)}
    arrays["covariance_scale"] = np.array([covariance_scale.get(name, 1.0) for name in trained.interactions])
    gaussian = gaussian_radii(residual_covariance.shape[0])
    arrays["radii"] = np.array([radii.get(name, gaussian) for name in trained.interactions])
    arrays |= territory.to_arrays()
    if trained.reservoir is not None:
        arrays |= {name: array.astype(np.float32) for name, array in trained.reservoir.to_arrays().items()}
    if trained.start_pose is not None:
        arrays |= trained.start_pose.to_arrays()
    for index, member in enumerate(trained.members):
        specs, found = _member(member)
        members.append(specs)
        found["latent_radius"] = latent_radius(member, corpus, trained.settings.stride, trained.seed)
        for name, prior in zip(trained.interactions, member.prior.priors, strict=True):
            found |= {f"prior.{name}.{key}": np.asarray(value) for key, value in prior.to_arrays().items()}
        arrays |= {f"member_{index}.{name}": array for name, array in found.items()}
    if trained.settings.recogniser is not None or trained.reservoir is not None:
        rate_hz = demonstrations[0].rate_hz / trained.protocol.keep_every
        arrays["recognition"] = recognition_rates(rate_hz, trained.settings)
    longest = max(p.chain.longest for member in trained.members for p in member.prior.priors)
    return _manifest(trained, demonstrations, facts, tuple(members), longest), arrays


def recognition_rates(rate_hz: float, settings: TrainingSettings) -> FloatArray:
    """Temper and forgetting (2,) of a model whose recognisers see `rate_hz` windows a second.

    Successive windows are far from independent: they count by time.
    """
    return np.array([min(1.0, settings.evidence_per_s / rate_hz), settings.evidence_kept_per_s ** (1.0 / rate_hz)])


def rest_s(demonstrations: Sequence[Demonstration]) -> float:
    """The longest rest before the motion in any trial, and a little more [s]."""
    return round(max(onset_frame(trial) / trial.rate_hz for trial in demonstrations) + MORE_REST_S, 2)


def _manifest(
    trained: TrainedModel,
    demonstrations: Sequence[Demonstration],
    facts: ModelFacts,
    members: tuple[Mapping[str, NetworkSpec], ...],
    longest: int,
) -> Manifest:
    protocol, settings, first = trained.protocol, trained.settings, demonstrations[0]
    lengths = bone_lengths_m([d.observed_m for d in demonstrations])
    return Manifest(
        name=facts.name,
        protocol=protocol.name,
        observed=ObservedAgent("human_arm", first.observed_names, "m", lengths, facts.side),
        controlled=ControlledAgent("human_arm", "human", first.controlled_names, "m")
        if first.partner
        else ControlledAgent("robot_joints", facts.robot, first.controlled_names, "rad"),
        rate_hz=first.rate_hz / protocol.keep_every,
        window=protocol.window,
        lead_frames=protocol.lead_frames,
        features=protocol.features,
        latent_size=settings.architecture.latent,
        stride=settings.stride,
        rest_s=rest_s(demonstrations),
        interactions=trained.interactions,
        prior=PriorSpec(settings.prior.kind, settings.prior.components, longest),
        members=members,
        robot_from_human=facts.placement,
        contact=contact_phases(demonstrations, facts.placement),
        training=facts.training,
        licence=facts.licence,
        errors=facts.errors,
    )


def _member(member: TrainedMember) -> tuple[dict[str, NetworkSpec], Arrays]:
    """Networks of one member, and their arrays without the member's prefix."""
    networks, architecture = member.networks, member.networks.architecture
    sizes = {"label": len(member.prior.priors), "context": architecture.memory}
    specs: dict[str, NetworkSpec] = {}
    arrays: Arrays = {}
    for name in RUNNING:
        chain: LayerStack | None = getattr(networks, name)
        if chain is None:
            continue
        inputs: tuple[str, ...] = getattr(architecture, name)
        layers, found = list(chain.specs), Arrays(chain.arrays())
        if "window" in inputs and member.question.directions is not None:
            layers, found = _fronted(layers, found, _front({"window": member.question}, inputs, sizes))
        if name == "decoder" and member.answer.directions is not None:
            back, found["window.weight"], found["window.bias"] = _back(member.answer)
            layers.append(back)
        specs[name] = NetworkSpec(inputs, tuple(layers))
        arrays |= {f"{name}.{key}": array for key, array in found.items()}
    if member.recogniser is not None:
        inputs = ("window",)
        front = _front({"window": member.recogniser.question}, inputs, sizes)
        layers, found = _fronted(list(member.recogniser.network.specs), member.recogniser.network.arrays(), front)
        specs["recogniser"] = NetworkSpec(inputs, tuple(layers))
        arrays |= {f"recogniser.{key}": array for key, array in found.items()}
    return specs, arrays


def _fronted(
    layers: list[LayerSpec], arrays: Arrays, front: tuple[LayerSpec, FloatArray, FloatArray]
) -> tuple[list[LayerSpec], Arrays]:
    """Put a linear layer before others: as a layer, or multiplied into the first one where that is less work."""
    spec, weight, bias = front
    first = layers[0]
    if spec.inputs * first.outputs >= spec.inputs * spec.outputs + first.inputs * first.outputs:
        return [spec, *layers], {**arrays, "coordinates.weight": weight, "coordinates.bias": bias}
    after = arrays[f"{first.name}.weight"].astype(np.float64)
    product = {
        f"{first.name}.weight": weight @ after,
        f"{first.name}.bias": bias @ after + arrays[f"{first.name}.bias"],
    }
    return [replace(first, inputs=spec.inputs), *layers[1:]], {**arrays, **product}


def _front(
    coordinates: Mapping[str, Coordinates], inputs: Sequence[str], sizes: Mapping[str, int]
) -> tuple[LayerSpec, FloatArray, FloatArray]:
    """A layer that turns some of a network's inputs into coordinates and passes all else."""
    weights, biases = [], []
    for name in inputs:
        if name in coordinates:
            own = coordinates[name]
            assert own.directions is not None
            weights.append((own.directions / own.scale).double().numpy())
            biases.append(-own.mean.double().numpy() @ weights[-1])
        else:
            weights.append(np.eye(sizes[name]))
            biases.append(np.zeros(sizes[name]))
    rows, columns = sum(len(w) for w in weights), sum(w.shape[1] for w in weights)
    weight, row, column = np.zeros((rows, columns)), 0, 0
    for block in weights:
        weight[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return LayerSpec("dense", "coordinates", rows, columns), weight, np.concatenate(biases)


def _back(answer: Coordinates) -> tuple[LayerSpec, FloatArray, FloatArray]:
    """A layer that turns coordinates into the robot's window."""
    assert answer.directions is not None
    weight = (answer.directions * answer.scale).T.double().numpy()
    return LayerSpec("dense", "window", *weight.shape), weight, answer.mean.double().numpy()

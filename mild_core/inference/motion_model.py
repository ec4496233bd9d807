# SPDX-License-Identifier: Apache-2.0
"""A trained model as a value: its manifest and all its arrays, put together and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mild_core.errors import ModelError
from mild_core.inference.gesture_recogniser import GestureRecogniser, gesture_classes, take_gestures
from mild_core.inference.manifest import NETWORKS, Manifest, NetworkSpec
from mild_core.inference.member import Member, covariance_operators
from mild_core.inference.networks import Network, build_network
from mild_core.inference.novelty_detector import NoveltyDetector, take_novelty_detector
from mild_core.inference.priors import PRIORS
from mild_core.inference.priors.prior import Prior
from mild_core.inference.reservoir import Reservoir, take_reservoir
from mild_core.inference.start_pose import StartPose, take_start_pose
from mild_core.shapes import FloatArray, read_only

Arrays = Mapping[str, NDArray[Any]]

TEMPER, FORGETTING = 0.1, 0.97
"""Defaults of recognition: frames of a motion are far from independent, so each counts little and not for ever."""


@dataclass(frozen=True, eq=False)
class MildModel:
    """What `Inference` runs.

    Attributes:
        manifest: What it is and was trained with.
        members: Their decoded windows are averaged.
        residual_covariance: (N, N) of a frame's error by cross-validation, averaged over the window [rad^2 or m^2].
        temper: Power of each frame's likelihood in recognition.
        forgetting: Share of the evidence that is kept from one frame to the next.
        covariance_scale: (P,) what the published covariance is multiplied with while an interaction goes on, so that
            its 90 % region holds nine true values of ten; by cross-validation, see `learning.uncertainty_calibration`.
        radii: (P, 2) Mahalanobis distances in the published covariance within which half and nine tenths of the true
            values lie, likewise.
        reservoir: What answers beside the members; None: they answer alone.
        start_pose: Correction by the robot's pose at the start; None: none.
        territory: Where the known interactions' windows lie; None: novelty is judged by the members alone.
        gestures: Recognises interactions of people who were never recorded; None: only what is the model's own does.
    """

    manifest: Manifest
    members: tuple[Member, ...]
    residual_covariance: FloatArray
    temper: float
    forgetting: float
    covariance_scale: FloatArray
    radii: FloatArray
    territory: NoveltyDetector | None = None
    reservoir: Reservoir | None = None
    start_pose: StartPose | None = None
    gestures: GestureRecogniser | None = None

    @cached_property
    def gesture_classes(self) -> NDArray[np.int64]:
        """(P,) the recogniser's class of each interaction.

        Raises:
            ValueError: An interaction is none of its classes.
        """
        return gesture_classes(self.manifest.interactions)

    @property
    def recognises(self) -> bool:
        """Whether members have networks that classify the interaction; else the reservoir does, or their priors do."""
        return "recogniser" in self.members[0].networks


def build_model(manifest: Manifest, arrays: Arrays) -> MildModel:
    """Put a manifest and its arrays together.

    Args:
        manifest: Says which arrays there are.
        arrays: `member_<i>.<network>.<layer>.<array>`, `member_<i>.prior.<interaction>.<array>`,
            `member_<i>.latent_radius`; `residual_covariance`; and, optional, `covariance_scale`, `radii`,
            `recognition` (temper, forgetting), `territory.<array>`, `reservoir.<array>`, `start_pose.<array>`,
            `gestures.<array>`.

    Raises:
        ModelError: An array is missing, of another shape, not finite or not what the manifest says; it is named.
    """
    taken = _Taken(arrays)
    try:
        members = tuple(
            _build_member(f"member_{i}", specs, manifest, taken) for i, specs in enumerate(manifest.members)
        )
        size = manifest.controlled.values
        residual = taken.array("residual_covariance", (size, size))
        interactions = len(manifest.interactions)
        recognition = taken.array("recognition", (2,), np.array([TEMPER, FORGETTING]))
        if not (0.0 < recognition[0] <= 1.0 and 0.0 < recognition[1] <= 1.0):
            raise ValueError(f"array recognition is {recognition.tolist()}, not two shares of one")
        scale = taken.array("covariance_scale", (interactions,), np.ones(interactions))
        if not (scale > 0.0).all():
            raise ValueError(f"array covariance_scale is {scale.tolist()}, not above zero")
        radii = taken.array("radii", (interactions, 2), np.tile(gaussian_radii(size), (interactions, 1)))
        if not ((radii > 0.0).all() and (radii[:, 0] <= radii[:, 1]).all()):
            raise ValueError(f"array radii is {radii.tolist()}, not a smaller and a larger one above zero")
        territory = None
        if any(name.startswith("territory.") for name in arrays):
            territory = take_novelty_detector(taken.array, manifest.window * manifest.frame_values, interactions)
        reservoir = None
        if any(name.startswith("reservoir.") for name in arrays):
            positions = 3 * len(manifest.observed.joint_names)
            reservoir = take_reservoir(taken.array, positions, manifest.window * size, interactions)
        start_pose = None
        if any(name.startswith("start_pose.") for name in arrays):
            start_pose = take_start_pose(taken.array, interactions, size)
        gestures = None
        if any(name.startswith("gestures.") for name in arrays):
            gesture_classes(manifest.interactions)
            gestures = take_gestures(taken.array)
        unknown = sorted(set(arrays) - taken.names)
        if unknown:
            raise ValueError(f"array {unknown[0][:80]} belongs to nothing in the manifest")
    except ValueError as error:
        remedy = "take the folder as it was trained, or retrain it"
        raise ModelError(f"model {manifest.name}", str(error), remedy) from None
    rates = float(recognition[0]), float(recognition[1])
    return MildModel(manifest, members, residual, *rates, scale, radii, territory, reservoir, start_pose, gestures)


def gaussian_radii(values: int) -> tuple[float, float]:
    """Mahalanobis distances within which half and nine tenths of a Gaussian of so many values lie.

    Source: E. Wilson, M. Hilferty, "The Distribution of Chi-square", PNAS 1931; right to half a per cent.
    """
    share = 2.0 / (9.0 * values)
    half, most = (float((values * (1.0 - share + z * share**0.5) ** 3) ** 0.5) for z in (0.0, 1.2815516))
    return half, most


class _Taken:
    """Arrays from outside, and which of them have been asked for."""

    def __init__(self, arrays: Arrays) -> None:
        self.arrays = arrays
        self.names: set[str] = set()

    def array(self, name: str, shape: tuple[int | None, ...], otherwise: FloatArray | None = None) -> FloatArray:
        """A finite float64 array of a shape; None is any length. Where there is none, `otherwise` if that is given."""
        self.names.add(name)
        if name not in self.arrays:
            if otherwise is not None:
                return read_only(otherwise)
            raise ValueError(f"array {name} is missing")
        array = self.arrays[name]
        fits = array.ndim == len(shape) and all(n is None or n == m for n, m in zip(shape, array.shape, strict=True))
        if not fits:
            wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
            raise ValueError(f"array {name} has shape {array.shape}, expected {wanted}")
        if array.dtype.kind != "f" or not np.isfinite(array).all():
            raise ValueError(f"array {name} holds values that are no finite numbers")
        return read_only(array)


def _build_member(prefix: str, specs: Mapping[str, NetworkSpec], manifest: Manifest, taken: _Taken) -> Member:
    sizes = manifest.source_sizes()
    if "context" in specs:
        sizes["context"] = specs["context"].layers[-1].outputs
    latent = manifest.latent_size
    outputs = {
        "encoder": latent + latent * (latent + 1) // 2,
        "residual": latent,
        "decoder": manifest.window * manifest.controlled.values,
        "recogniser": len(manifest.interactions),
    }
    networks = {name: _build(f"{prefix}.{name}", spec, sizes, outputs.get(name), taken) for name, spec in specs.items()}
    for name, network in networks.items():
        if network.memory_size and name != "context":
            raise ValueError(f"{prefix}.{name} has a gru layer: only the context remembers")
    priors = tuple(_build_prior(f"{prefix}.prior.{name}", manifest, taken) for name in manifest.interactions)
    radius = taken.array(f"{prefix}.latent_radius", (len(priors),))
    if not (radius > 0.0).all():
        raise ValueError(f"array {prefix}.latent_radius holds a radius that is not above zero")
    return Member(networks, priors, radius, covariance_operators(networks["decoder"], priors, manifest.window))


def _build(prefix: str, spec: NetworkSpec, sizes: Mapping[str, int], outputs: int | None, taken: _Taken) -> Network:
    taken.names |= {f"{prefix}.{layer.name}.{array}" for layer in spec.layers for array in layer.shapes()}
    way = " + ".join(spec.inputs)
    if spec.inputs not in NETWORKS[prefix.split(".")[-1]]:
        raise ValueError(f"{prefix} takes in {way}, which no network of its kind does")
    for name in spec.inputs:
        if name not in sizes:
            raise ValueError(f"{prefix} takes in '{name}', and there is no such network")
    network = build_network(spec.layers, taken.arrays, prefix)
    wanted = sum(sizes[name] for name in spec.inputs)
    if network.inputs != wanted:
        raise ValueError(f"{prefix} takes {network.inputs} values, but {' + '.join(spec.inputs)} has {wanted}")
    if outputs is not None and network.outputs != outputs:
        raise ValueError(f"{prefix} gives {network.outputs} values, expected {outputs}")
    return network


def _build_prior(prefix: str, manifest: Manifest, taken: _Taken) -> Prior:
    components, joint = manifest.prior.components, 2 * manifest.latent_size
    shapes: dict[str, tuple[int | None, ...]] = {
        "means": (components, joint),
        "covariances": (components, joint, joint),
        "initial": (components,),
        "transitions": (components, components),
        "durations": (components, None),
        "phases": (components,),
    }
    arrays = {name: taken.array(f"{prefix}.{name}", shape) for name, shape in shapes.items()}
    longest, most = arrays["durations"].shape[1], manifest.prior.max_duration
    if longest > most:
        raise ValueError(f"array {prefix}.durations is for {longest} steps, but prior.max_duration is {most}")
    try:
        np.linalg.cholesky(arrays["covariances"])
        return PRIORS[manifest.prior.kind].from_arrays(arrays, manifest.latent_size)
    except np.linalg.LinAlgError:
        raise ValueError(f"array {prefix}.covariances holds one that is not positive definite") from None
    except ValueError as error:
        raise ValueError(f"{prefix}: {error}") from None

# SPDX-License-Identifier: Apache-2.0
"""Models with random weights: everything but trained."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from mild_core.inference.manifest import (
    ControlledAgent,
    HumanPlacement,
    Manifest,
    NetworkSpec,
    ObservedAgent,
    PriorSpec,
)
from mild_core.inference.networks import LayerSpec
from mild_core.inference.priors import PRIORS

INTERACTIONS = ("hand_wave", "hand_shake", "rocket", "parachute")
YUMI_JOINTS = tuple(f"yumi_joint_{axis}_r" for axis in (1, 2, 7, 3, 4, 5, 6))


def dense(sizes: tuple[int, ...], prefix: str = "hidden") -> tuple[LayerSpec, ...]:
    """Dense layers of these sizes, leaky but for the last one."""
    last = len(sizes) - 2
    return tuple(
        LayerSpec("dense", f"{prefix}_{i}", a, b, "identity" if i == last else "leaky_relu")
        for i, (a, b) in enumerate(itertools.pairwise(sizes))
    )


def paper_member(
    window: int = 40, latent: int = 5, hidden: tuple[int, ...] = (250, 150), values: int = 7
) -> dict[str, NetworkSpec]:
    """Networks of the paper's shape for three joints and seven angles, or as many `values` of a frame."""
    size = 9 * window
    encoder = (
        LayerSpec("normalise", "input", size, size),
        *dense((size, *hidden, latent + latent * (latent + 1) // 2)),
    )
    decoder = (
        *dense((latent, *reversed(hidden), values * window)),
        LayerSpec("denormalise", "output", values * window, values * window),
    )
    return {"encoder": NetworkSpec(("window",), encoder), "decoder": NetworkSpec(("controlled",), decoder)}


def recurrent_member(window: int = 40, latent: int = 5) -> dict[str, NetworkSpec]:
    """Every kind of network at once: a recurrent context, a residual and a recogniser."""
    size, labels = 9 * window, len(INTERACTIONS)
    context = (
        LayerSpec("normalise", "input", size + labels, size + labels),
        *dense((size + labels, 24, 32)),
        LayerSpec("gru", "memory", 32, 16),
    )
    encoder = dense((16 + size, 24, latent + latent * (latent + 1) // 2))
    return {
        "context": NetworkSpec(("window", "label"), context),
        "encoder": NetworkSpec(("context", "window"), encoder),
        "residual": NetworkSpec(("context", "window", "label"), dense((16 + size + labels, 12, latent))),
        "decoder": NetworkSpec(("controlled", "label"), dense((latent + labels, 20, 7 * window))),
        "recogniser": NetworkSpec(("window",), dense((size, 8, labels))),
    }


def manifest(
    members: tuple[Mapping[str, NetworkSpec], ...],
    window: int = 40,
    components: int = 10,
    stride: int = 1,
    **changes: Any,
) -> Manifest:
    """A manifest as the YuMi models have it."""
    values: dict[str, Any] = {
        "name": "random",
        "protocol": "ahead",
        "observed": ObservedAgent("human_arm", ("shoulder", "elbow", "hand"), "m", (0.18, 0.234), "right"),
        "controlled": ControlledAgent("robot_joints", "yumi", YUMI_JOINTS, "rad"),
        "rate_hz": 40.0,
        "window": window,
        "lead_frames": 1,
        "features": "positions",
        "latent_size": 5,
        "interactions": INTERACTIONS,
        "prior": PriorSpec("hsmm", components, 200),
        "members": members,
        "robot_from_human": HumanPlacement((0.9, 0.1, 0.7), 3.14),
        "stride": stride,
    }
    return Manifest(**(values | changes))


def random_arrays(of: Manifest, seed: int = 0) -> dict[str, np.ndarray]:
    """Arrays for a manifest: networks that keep the scale of what they take in, priors fitted to random walks."""
    rng = np.random.default_rng(seed)
    arrays: dict[str, np.ndarray] = {"residual_covariance": 0.01 * np.eye(of.controlled.values)}
    for i, member in enumerate(of.members):
        for name, network in member.items():
            for layer in network.layers:
                for array, shape in layer.shapes().items():
                    values = rng.normal(size=shape) / np.sqrt(shape[0])
                    scale = array == "scale"
                    arrays[f"member_{i}.{name}.{layer.name}.{array}"] = abs(values) + 0.2 if scale else 0.7 * values
        arrays[f"member_{i}.latent_radius"] = np.full(len(of.interactions), 5.0)
        for interaction in of.interactions:
            latents = [np.cumsum(rng.normal(0.0, 0.2, (120, 2 * of.latent_size)), axis=0) for _ in range(4)]
            prior = PRIORS[of.prior.kind].from_demonstrations(latents, of.prior.components, of.latent_size)
            arrays |= {f"member_{i}.prior.{interaction}.{name}": a for name, a in prior.to_arrays().items()}
    return arrays

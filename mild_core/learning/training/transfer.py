# SPDX-License-Identifier: Apache-2.0
"""Hidden layers carried over from a trained model: from one recording to the next, from a person to a robot."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.numpy import load_file

from mild_core.inference.model import WEIGHTS, load_model
from mild_core.learning.training.configuration import Configuration
from mild_core.learning.training.vae import DENSE_ARRAYS, GRU_ARRAYS, RUNNING, MemberNetworks

FIRST_MEMBER = "member_0."


def hidden_layers(folder: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a model's first member by name, as `network.layer.array`.

    Args:
        folder: The model; it is checked as before every use.

    Raises:
        ModelError: It cannot be trusted.
    """
    load_model(folder)
    arrays = load_file(folder / WEIGHTS)
    return {name.removeprefix(FIRST_MEMBER): array for name, array in arrays.items() if name.startswith(FIRST_MEMBER)}


def start_of(configuration: Configuration) -> dict[str, NDArray[Any]]:
    """The layers that a configuration starts from; none where it names no model.

    Raises:
        ModelError: The model cannot be trusted.
    """
    return hidden_layers(Path(configuration.start_from)) if configuration.start_from else {}


def transfer_layers(networks: MemberNetworks, arrays: Mapping[str, NDArray[Any]]) -> tuple[str, ...]:
    """Start from another model's layers wherever both have a hidden one of the same name and size.

    The last layer of a network is left alone: what it gives means something else in another model.

    Args:
        networks: To start; changed in place.
        arrays: As `hidden_layers` gives them.

    Returns:
        The layers that were taken over, as `network.layer`.

    Source: the MILD paper, section IV: robots start from the hidden layers learned from people, a second data set
    from those of the first.
    """
    taken = []
    for network in RUNNING:
        chain = getattr(networks, network)
        if chain is None:
            continue
        shapes = {name: array.shape for name, array in chain.arrays().items()}
        for spec, layer in zip(chain.specs, chain.stack, strict=True):
            names = GRU_ARRAYS if spec.kind == "gru" else DENSE_ARRAYS
            found = {name: arrays.get(f"{network}.{spec.name}.{name}") for name in names}
            sized = all(a is not None and a.shape == shapes[f"{spec.name}.{name}"] for name, a in found.items())
            if not sized or (spec is chain.specs[-1] and spec.kind != "gru"):
                continue
            with torch.no_grad():
                for name, array in found.items():
                    getattr(layer, names[name]).copy_(torch.from_numpy(np.array(array, dtype=np.float32).T))
            taken.append(f"{network}.{spec.name}")
    return tuple(taken)

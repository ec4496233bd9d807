# SPDX-License-Identifier: Apache-2.0
"""The networks of one member as torch trains them: the same lists of layers that `inference.networks` runs."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from mild_core.inference.networks import LayerSpec
from mild_core.learning.training.settings import Architecture

LEAST_DEVIATION = 1e-4
"""Added to the diagonal of L, so that a posterior never becomes a point."""


RUNNING = ("context", "encoder", "residual", "decoder")
"""The networks that run on the robot, in order; a model may do without some."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """q(z | x) = N(mean, factor factor^T).

    Attributes:
        mean: (..., Q).
        factor: (..., Q, Q) lower triangular with a positive diagonal.
    """

    mean: Tensor
    factor: Tensor

    @cached_property
    def covariance(self) -> Tensor:
        """(..., Q, Q)."""
        return self.factor @ self.factor.transpose(-1, -2)

    def samples(self, count: int) -> Tensor:
        """(count, ..., Q) draws that gradients pass through."""
        noise = torch.randn(count, *self.mean.shape)
        return self.mean + (self.factor @ noise[..., None])[..., 0]


def posterior_of(outputs: Tensor, latent: int) -> Posterior:
    """Read an encoder's Q + Q (Q + 1) / 2 outputs: the mean, then the rows of the lower triangle.

    Source: the MILD paper: q = N(mu, L L^T), L with diagonal 2 |l|, plus a little.
    """
    rows, columns = torch.tril_indices(latent, latent)
    factor = outputs.new_zeros(*outputs.shape[:-1], latent, latent)
    factor[..., rows, columns] = outputs[..., latent:]
    diagonal = torch.diagonal(factor, dim1=-2, dim2=-1)
    factor = factor.tril(-1) + torch.diag_embed(2.0 * diagonal.abs() + LEAST_DEVIATION)
    return Posterior(outputs[..., :latent], factor)


def drop(values: Tensor, share: float) -> Tensor:
    """Drop a share of the values and scale up the others, as `functional.dropout` does, six times as fast.

    numpy draws the mask, seeded by torch's global generator: torch draws one number after the other here.
    """
    if not share:
        return values
    seed = int(torch.randint(2**62, ()))
    drawn = np.random.SFC64(seed).random_raw(-(-values.numel() // 8)).view(np.uint8)[: values.numel()]
    threshold = round(256 * share)
    kept = (drawn >= threshold).astype(np.float32) * np.float32(256 / (256 - threshold))
    return values * torch.from_numpy(kept.reshape(values.shape))


class LayerStack(nn.Module):
    """A list of dense and GRU layers over (B, N, inputs).

    In training a share of the values is dropped after each hidden layer; with a GRU, after the GRU alone.
    """

    def __init__(self, layers: Sequence[LayerSpec], dropout: float = 0.0) -> None:
        super().__init__()
        self.specs = tuple(layers)
        self.dropout = dropout
        self.recurrent = any(layer.kind == "gru" for layer in layers)
        self.stack = nn.ModuleList(
            nn.GRU(layer.inputs, layer.outputs, batch_first=True)
            if layer.kind == "gru"
            else nn.Linear(layer.inputs, layer.outputs)
            for layer in layers
        )

    def forward(self, values: Tensor) -> Tensor:
        """(..., inputs) -> (..., outputs); with a GRU (B, N, inputs), N steps from an empty memory."""
        for spec, layer in zip(self.specs, self.stack, strict=True):
            values = layer(values)[0] if spec.kind == "gru" else layer(values)
            if spec.activation == "leaky_relu":
                values = functional.leaky_relu(values, 0.01)
            if self.training and (spec.kind == "gru" if self.recurrent else spec is not self.specs[-1]):
                values = drop(values, self.dropout)
        return values

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """Its parameters as `inference.networks` names and shapes them."""
        found = {}
        for spec, layer in zip(self.specs, self.stack, strict=True):
            names = GRU_ARRAYS if spec.kind == "gru" else DENSE_ARRAYS
            for name, attribute in names.items():
                array = getattr(layer, attribute).detach().numpy()
                found[f"{spec.name}.{name}"] = np.ascontiguousarray(array.T, dtype=np.float32)
        return found


DENSE_ARRAYS = {"weight": "weight", "bias": "bias"}
GRU_ARRAYS = {
    "weight_input": "weight_ih_l0",
    "weight_hidden": "weight_hh_l0",
    "bias_input": "bias_ih_l0",
    "bias_hidden": "bias_hh_l0",
}


def perceptron(inputs: int, hidden: Sequence[int], outputs: int, dropout: float = 0.0) -> LayerStack:
    """Dense layers with leaky rectifiers between them."""
    sizes = [inputs, *hidden]
    layers = [
        LayerSpec("dense", f"hidden_{i + 1}", a, b, "leaky_relu") for i, (a, b) in enumerate(itertools.pairwise(sizes))
    ]
    return LayerStack([*layers, LayerSpec("dense", "output", sizes[-1], outputs)], dropout)


def memory(inputs: int, hidden: int, size: int, dropout: float) -> LayerStack:
    """A dense layer and a GRU."""
    layers = [
        LayerSpec("dense", "hidden_1", inputs, hidden, "leaky_relu"),
        LayerSpec("gru", "memory", hidden, size),
    ]
    return LayerStack(layers, dropout)


class MemberNetworks(nn.Module):
    """The networks of one member. Windows come and go in coordinates (see `coordinates`).

    Those of `RUNNING` run on the robot; `counterpart_encoder` (of the robot's window) and `counterpart_decoder` (of the
    human's) make the two VAEs whole and are needed for training alone.
    """

    def __init__(self, architecture: Architecture, question: int, answer: int, labels: int, dropout: float) -> None:
        super().__init__()
        self.architecture = architecture
        self.dropout = dropout
        latent = architecture.latent
        outputs = latent + latent * (latent + 1) // 2
        sizes = {"window": question, "label": labels, "context": architecture.memory, "controlled": latent}
        width = {name: sum(sizes[source] for source in getattr(architecture, name)) for name in RUNNING}
        self.context = (
            memory(width["context"], architecture.context_hidden, architecture.memory, dropout)
            if architecture.context
            else None
        )
        self.encoder = perceptron(width["encoder"], architecture.encoder_hidden, outputs, dropout)
        self.residual = (
            perceptron(width["residual"], architecture.residual_hidden, latent, dropout)
            if architecture.residual
            else None
        )
        self.decoder = perceptron(width["decoder"], architecture.decoder_hidden, answer)
        self.counterpart_encoder = perceptron(answer, architecture.counterpart_hidden, outputs)
        self.counterpart_decoder = perceptron(latent, architecture.counterpart_hidden[::-1], question)

    def sources(self, window: Tensor, label: Tensor) -> dict[str, Tensor]:
        """What is known at each window before any latent is.

        Args:
            window: (B, N, question) coordinates of the human's windows.
            label: (B, N, labels) probabilities of the interactions.
        """
        known = {"window": window, "label": label}
        if self.context is not None:
            seen = {**known, "window": drop(window, self.dropout) if self.training else window}
            known["context"] = self.context(gather(seen, self.architecture.context))
        return known

    def observe(self, known: Mapping[str, Tensor]) -> Posterior:
        """Posterior of the human's latent."""
        return posterior_of(self.encoder(gather(known, self.architecture.encoder)), self.architecture.latent)

    def counterpart(self, window: Tensor) -> Posterior:
        """Posterior of the robot's latent, from its own window."""
        return posterior_of(self.counterpart_encoder(window), self.architecture.latent)

    def condition(self, known: Mapping[str, Tensor], belief: Tensor, expected: Tensor) -> Tensor:
        """(..., C) what the components expect (..., K, C), weighed by the belief (..., K)."""
        return (belief[..., None] * expected).sum(-2)

    def correct(self, known: Mapping[str, Tensor], conditioned: Tensor) -> Tensor:
        """The conditioned latent, and what memory adds to it."""
        if self.residual is None:
            return conditioned
        correction: Tensor = self.residual(gather(known, self.architecture.residual))
        return conditioned + correction

    def answer(self, known: Mapping[str, Tensor], controlled: Tensor) -> Tensor:
        """Coordinates of the robot's window from its latent (..., Q), whose leading axes `known` is spread over."""
        spread = {
            name: value.expand(*controlled.shape[:-1], value.shape[-1])
            for name, value in known.items()
            if name in self.architecture.decoder
        }
        answered: Tensor = self.decoder(gather({**spread, "controlled": controlled}, self.architecture.decoder))
        return answered

    def start_controlled_from_observed(self) -> None:
        """Copy the human's hidden layers to the robot's networks where they have equal sizes.

        Source: the MILD paper: robot agents start from the human VAE's hidden layers, as their demonstrations are few.
        """
        for source, target in ((self.encoder, self.counterpart_encoder), (self.counterpart_decoder, self.decoder)):
            for one, other in zip(list(source.stack)[:-1], list(target.stack)[:-1], strict=True):
                if one.weight.shape == other.weight.shape:
                    other.load_state_dict(one.state_dict())


def gather(known: Mapping[str, Tensor], names: Sequence[str]) -> Tensor:
    """The named values side by side."""
    return torch.cat([known[name] for name in names], dim=-1) if len(names) > 1 else known[names[0]]

# SPDX-License-Identifier: Apache-2.0
"""Experts: a recurrent encoder of the human chooses between a few Gaussians over the robot's motion."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from mild_core.learning.baselines.recurrent import HIDDEN, RecurrentNetwork
from mild_core.learning.data.coordinates import principal_coordinates

EXPERTS = 3
COORDINATES = 10
"""Principal components of the answers, in which the experts' Gaussians are diagonal."""

LEAST_DEVIATION = 0.1
"""Of a Gaussian in whitened coordinates: with less, the trials at hand would be learned by heart."""


class MixtureDensity(RecurrentNetwork):
    """Gate, means and deviations of the experts from one GRU, trained by likelihood; the answer is the mixture's mean.

    Source: V. Prasad et al., "MoVEInt: Mixture of Variational Experts for Learning Human-Robot Interactions from
    Demonstrations", RA-L 2024. Their experts lie in the latent space of a variational autoencoder of the robot, these
    in its linear counterpart.
    """

    def __init__(self, inputs: int, answers: Tensor) -> None:
        super().__init__()
        self.coordinates = principal_coordinates(answers, min(COORDINATES, answers.shape[1]), 1.0)
        self.recurrent = nn.GRU(inputs, HIDDEN, batch_first=True)
        self.read_out = nn.Linear(HIDDEN, EXPERTS * (1 + 2 * self.coordinates.size))

    def _experts(self, frames: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Logits (B, T, K), means and deviations (B, T, K, C)."""
        outputs = self.read_out(self.recurrent(frames)[0])
        gate, values = outputs[..., :EXPERTS], outputs[..., EXPERTS:]
        means, spread = values.unflatten(-1, (2, EXPERTS, self.coordinates.size)).unbind(-3)
        return gate, means, functional.softplus(spread) + LEAST_DEVIATION

    def loss(self, frames: Tensor, wanted: Tensor) -> Tensor:
        """Negative log-likelihood per coordinate [nats] (see `RecurrentNetwork`)."""
        gate, means, deviations = self._experts(frames)
        distance = (self.coordinates.project(wanted)[..., None, :] - means) / deviations
        density = -0.5 * (distance**2).sum(-1) - torch.log(deviations).sum(-1)
        mixture = torch.logsumexp(torch.log_softmax(gate, dim=-1) + density, dim=-1)
        return 0.5 * math.log(2 * math.pi) - mixture / self.coordinates.size

    def answer(self, frames: Tensor) -> Tensor:
        """See `RecurrentNetwork`."""
        gate, means, _ = self._experts(frames)
        return self.coordinates.restore((torch.softmax(gate, dim=-1)[..., None] * means).sum(-2))

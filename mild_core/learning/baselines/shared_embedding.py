# SPDX-License-Identifier: Apache-2.0
"""Two agents in one embedding and a recurrent model of how the second one moves on, run on its own predictions."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from mild_core.learning.baselines.recurrent import HIDDEN, RecurrentNetwork

EMBEDDING = 10
RECONSTRUCTION = 0.3
"""Weight of both agents' motions through the embedding, beside the predicted one's."""


def _perceptron(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, HIDDEN), nn.LeakyReLU(0.01), nn.Linear(HIDDEN, outputs))


def _error(shown: Tensor, wanted: Tensor) -> Tensor:
    """Squared error, averaged over the last axis."""
    return ((shown - wanted) ** 2).mean(dim=-1)


class SharedEmbedding(RecurrentNetwork):
    """Both agents are embedded by networks of their own in one space; a GRU moves the robot on in it.

    The GRU takes in where the human is in the embedding and where it believes the robot to be: its own prediction of
    the step before, never the truth, in training as well.

    Source: J. Bütepage et al., "Imitating by Generating: Deep Generative Models for Imitation of Interactive Tasks",
    Frontiers in Robotics and AI 2020. Theirs was first trained on two people.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.observe, self.show_human = _perceptron(inputs, EMBEDDING), _perceptron(EMBEDDING, inputs)
        self.embed, self.show_robot = _perceptron(outputs, EMBEDDING), _perceptron(EMBEDDING, outputs)
        self.dynamics, self.move = nn.GRUCell(2 * EMBEDDING, HIDDEN), nn.Linear(HIDDEN, EMBEDDING)
        self.start = nn.Parameter(torch.zeros(EMBEDDING))

    def _path(self, human: Tensor) -> Tensor:
        """Where the robot goes in the embedding, (B, T, E), given where the human goes."""
        memory = human.new_zeros(len(human), HIDDEN)
        robot, path = self.start.expand(len(human), -1), []
        for seen in human.unbind(1):
            memory = self.dynamics(torch.cat([seen, robot], dim=1), memory)
            robot = robot + self.move(memory)
            path.append(robot)
        return torch.stack(path, dim=1)

    def answer(self, frames: Tensor) -> Tensor:
        """See `RecurrentNetwork`."""
        answer: Tensor = self.show_robot(self._path(self.observe(frames)))
        return answer

    def loss(self, frames: Tensor, wanted: Tensor) -> Tensor:
        """Of the prediction, and of both agents' motions through the embedding (see `RecurrentNetwork`)."""
        human = self.observe(frames)
        prediction = _error(self.show_robot(self._path(human)), wanted)
        through = _error(self.show_human(human), frames) + _error(self.show_robot(self.embed(wanted)), wanted)
        return prediction + RECONSTRUCTION * through

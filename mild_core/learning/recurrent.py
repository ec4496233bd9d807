# SPDX-License-Identifier: Apache-2.0
"""A plain recurrent network from the human's frames and the interaction's name to the robot's window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from mild_core.learning.demonstration import Demonstration
from mild_core.learning.windows import Protocol, cut, features_of, thin
from mild_core.shapes import FloatArray

HIDDEN = 64
EPOCHS = 200
LEARNING_RATE = 3e-3
WEIGHT_DECAY = 1e-2
SEEN_HZ = 10.0
"""Rate of the frames that the network sees: with more, one step would hardly differ from the next."""

NOISE = 0.1
"""Standard deviation of noise on the standardised features: with 24 trials the network would learn them by heart."""


class _Network(nn.Module):
    """One GRU layer and a linear read-out at each frame."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.recurrent = nn.GRU(inputs, HIDDEN, batch_first=True)
        self.read_out = nn.Linear(HIDDEN, outputs)

    def forward(self, frames: Tensor) -> Tensor:
        """(B, T, inputs) -> (B, T, outputs)."""
        hidden, _ = self.recurrent(frames)
        answer: Tensor = self.read_out(hidden)
        return answer


@dataclass(frozen=True, eq=False)
class Recurrent:
    """The network with the standardisation it was trained under."""

    protocol: Protocol
    interactions: tuple[str, ...]
    features: tuple[FloatArray, FloatArray]
    answers: tuple[FloatArray, float]
    stride: int
    network: _Network

    def frames(self, demonstration: Demonstration) -> Tensor:
        """(T, D + number of interactions) standardised features and the interaction, one-hot."""
        features = features_of(thin(demonstration, self.protocol), self.protocol.features)
        known = np.array([name == demonstration.interaction for name in self.interactions], dtype=float)
        known = np.broadcast_to(known, (len(features), len(known)))
        mean, scale = self.features
        return torch.tensor(np.concatenate([(features - mean) / scale, known], axis=1), dtype=torch.float32)

    def predict(self, demonstration: Demonstration) -> FloatArray:
        """Every `stride`-th frame is seen, up to the newest of each window (see `Predictor`)."""
        true = cut(demonstration, self.protocol).controlled
        frames, (mean, scale) = self.frames(demonstration), self.answers
        answers = np.empty((len(frames), len(mean)))
        with torch.no_grad():
            for phase in range(self.stride):
                answers[phase :: self.stride] = self.network(frames[None, phase :: self.stride])[0].double().numpy()
        first = self.protocol.window - 1
        answer: FloatArray = (answers[first : first + len(true)] * scale + mean).reshape(true.shape)
        return answer


def fit_recurrent(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> Recurrent:
    """Learn all interactions with one network (see `Fit`)."""
    features = np.concatenate([features_of(thin(d, protocol), protocol.features) for d in demonstrations])
    answers = [cut(d, protocol).controlled.reshape(len(cut(d, protocol).controlled), -1) for d in demonstrations]
    mean, scale = np.concatenate(answers).mean(axis=0), float(np.concatenate(answers).std())
    interactions = tuple(dict.fromkeys(d.interaction for d in demonstrations))
    # The floor keeps a joint that hardly moves (the shoulder) from being blown up to the size of the hand's motion.
    standard = (features.mean(axis=0), features.std(axis=0) + 0.1 * features.std())
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = _Network(features.shape[1] + len(interactions), len(mean))
        stride = max(1, round(demonstrations[0].rate_hz / protocol.keep_every / SEEN_HZ))
        learned = Recurrent(protocol, interactions, standard, (mean, scale), stride, network)
        _train(learned, [learned.frames(d) for d in demonstrations], [(a - mean) / scale for a in answers])
    return learned


def _train(learned: Recurrent, tracks: Sequence[Tensor], answers: Sequence[FloatArray]) -> None:
    """Squared error at every frame that has an answer; the whole set is one batch."""
    network, stride, window = learned.network, learned.stride, learned.protocol.window
    frames = nn.utils.rnn.pad_sequence(list(tracks), batch_first=True)
    wanted = torch.zeros(len(tracks), frames.shape[1], answers[0].shape[1])
    counts = torch.zeros(len(tracks), frames.shape[1], 1)
    for row, answer in enumerate(answers):
        span = slice(window - 1, window - 1 + len(answer))
        wanted[row, span], counts[row, span] = torch.tensor(answer, dtype=torch.float32), 1.0
    noise_scale = torch.full((frames.shape[2],), NOISE)
    optimiser = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, EPOCHS)
    for _ in range(EPOCHS):
        optimiser.zero_grad()
        seen = slice(int(torch.randint(stride, ())), None, stride)
        answered = network(frames[:, seen] + noise_scale * torch.randn_like(frames[:, seen]))
        error = ((answered - wanted[:, seen]) ** 2 * counts[:, seen]).sum()
        loss = error / (counts[:, seen].sum() * wanted.shape[2])
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        schedule.step()

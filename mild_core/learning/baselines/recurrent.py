# SPDX-License-Identifier: Apache-2.0
"""Recurrent networks from the human's frames to the controlled agent's window: the plain one, and what all share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol, cut, features_of, thin
from mild_core.shapes import FloatArray

HIDDEN = 64
EPOCHS = 200
LEARNING_RATE = 3e-3
WEIGHT_DECAY = 1e-2
SEEN_HZ = 10.0
"""Rate of the frames that the network sees: with more, one step would hardly differ from the next."""

NOISE = 0.1
"""Standard deviation of noise on the standardised features: with 24 trials the network would learn them by heart."""


@dataclass(frozen=True, eq=False)
class InputLayout:
    """The human as a recurrent network sees them.

    Attributes:
        protocol: By which trials are cut.
        interactions: Given as one-hot input; empty: the network gets no label.
        mean: (D,) of the features.
        scale: (D,).
        stride: Every how many frames one is seen.
    """

    protocol: Protocol
    interactions: tuple[str, ...]
    mean: FloatArray
    scale: FloatArray
    stride: int

    @property
    def size(self) -> int:
        """Numbers of one frame."""
        return len(self.mean) + len(self.interactions)

    def frames(self, demonstration: Demonstration) -> Tensor:
        """(T, D + number of interactions) standardised features and the interaction."""
        features = features_of(thin(demonstration, self.protocol), self.protocol.features)
        known = np.array([name == demonstration.interaction for name in self.interactions], dtype=float)
        known = np.broadcast_to(known, (len(features), len(known)))
        return torch.tensor(np.concatenate([(features - self.mean) / self.scale, known], axis=1), dtype=torch.float32)


def input_layout_of(demonstrations: Sequence[Demonstration], protocol: Protocol, given: bool) -> InputLayout:
    """Input layout for trials like these; `given`: with their interaction."""
    features = np.concatenate([features_of(thin(d, protocol), protocol.features) for d in demonstrations])
    interactions = tuple(dict.fromkeys(d.interaction for d in demonstrations)) if given else ()
    # The floor keeps a joint that hardly moves (the shoulder) from being blown up to the size of the hand's motion.
    scale = features.std(axis=0) + 0.1 * features.std()
    stride = max(1, round(demonstrations[0].rate_hz / protocol.keep_every / SEEN_HZ))
    return InputLayout(protocol, interactions, features.mean(axis=0), scale, stride)


class RecurrentNetwork(nn.Module, ABC):
    """From the human's frames so far to the standardised answer (F values) at each of them."""

    @abstractmethod
    def loss(self, frames: Tensor, wanted: Tensor) -> Tensor:
        """Frames (B, T, inputs) and answers (B, T, F) -> (B, T)."""

    @abstractmethod
    def answer(self, frames: Tensor) -> Tensor:
        """(B, T, inputs) -> (B, T, F)."""


class PlainGru(RecurrentNetwork):
    """One GRU layer and a linear read-out; squared error."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.recurrent = nn.GRU(inputs, HIDDEN, batch_first=True)
        self.read_out = nn.Linear(HIDDEN, outputs)

    def answer(self, frames: Tensor) -> Tensor:
        """See `RecurrentNetwork`."""
        hidden, _ = self.recurrent(frames)
        answer: Tensor = self.read_out(hidden)
        return answer

    def loss(self, frames: Tensor, wanted: Tensor) -> Tensor:
        """See `RecurrentNetwork`."""
        return ((self.answer(frames) - wanted) ** 2).mean(dim=-1)


@dataclass(frozen=True, eq=False)
class Recurrent:
    """A network with the standardisation it was trained under."""

    view: InputLayout
    answers: tuple[FloatArray, float]
    network: RecurrentNetwork

    def predict(self, demonstration: Demonstration) -> FloatArray:
        """Every `stride`-th frame is seen, up to the newest of each window (see `Predictor`)."""
        true, stride = cut(demonstration, self.view.protocol).controlled, self.view.stride
        frames, (mean, scale) = self.view.frames(demonstration), self.answers
        answers = np.empty((len(frames), len(mean)))
        with torch.no_grad():
            for phase in range(min(stride, len(frames))):
                answers[phase::stride] = self.network.answer(frames[None, phase::stride])[0].double().numpy()
        first = self.view.protocol.window - 1
        answer: FloatArray = (answers[first : first + len(true)] * scale + mean).reshape(true.shape)
        return answer


def fit_recurrent(
    demonstrations: Sequence[Demonstration],
    protocol: Protocol,
    seed: int,
    network_of: Callable[[InputLayout, Tensor], RecurrentNetwork] = lambda view, answers: PlainGru(
        view.size, answers.shape[1]
    ),
    given: bool = True,
) -> Recurrent:
    """Learn all interactions with one network (see `Fit`).

    Args:
        demonstrations: To learn from.
        protocol: How windows are cut.
        seed: Of all draws.
        network_of: Makes the network for that layout from all standardised answers (N, F); a plain GRU.
        given: Whether the network gets the interaction as an input.
    """
    windows = [cut(d, protocol).controlled for d in demonstrations]
    answers = [part.reshape(len(part), int(np.prod(part.shape[1:]))) for part in windows]
    mean, scale = np.concatenate(answers).mean(axis=0), float(np.concatenate(answers).std())
    standard = [torch.tensor((answer - mean) / scale, dtype=torch.float32) for answer in answers]
    view = input_layout_of(demonstrations, protocol, given)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        learned = Recurrent(view, (mean, scale), network_of(view, torch.cat(standard)))
        _train(learned, [view.frames(d) for d in demonstrations], standard)
    return learned


def _train(learned: Recurrent, tracks: Sequence[Tensor], answers: Sequence[Tensor]) -> None:
    """The loss at every frame that has an answer; the whole set is one batch."""
    network, stride, window = learned.network, learned.view.stride, learned.view.protocol.window
    frames = nn.utils.rnn.pad_sequence(list(tracks), batch_first=True)
    wanted = torch.zeros(len(tracks), frames.shape[1], answers[0].shape[1])
    counts = torch.zeros(len(tracks), frames.shape[1])
    for row, answer in enumerate(answers):
        span = slice(window - 1, window - 1 + len(answer))
        wanted[row, span], counts[row, span] = answer, 1.0
    optimiser = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, EPOCHS)
    for _ in range(EPOCHS):
        optimiser.zero_grad()
        seen = slice(int(torch.randint(stride, ())), None, stride)
        losses = network.loss(frames[:, seen] + NOISE * torch.randn_like(frames[:, seen]), wanted[:, seen])
        loss = (losses * counts[:, seen]).sum() / counts[:, seen].sum()
        loss.backward()  # type: ignore[no-untyped-call]  # torch does not type it
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        schedule.step()

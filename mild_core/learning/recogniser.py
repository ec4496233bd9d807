# SPDX-License-Identifier: Apache-2.0
"""A small network that tells interactions apart by what the person does: what each prior predicts does not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from mild_core.learning.coordinates import Coordinates, principal_coordinates
from mild_core.learning.corpus import Corpus, bend, cut_tracks
from mild_core.learning.settings import Augmentation, RecogniserSettings
from mild_core.learning.vae import Chain, perceptron

STARTED_M = 0.05
"""A hand this far from where it was at first has begun something; before, nobody can know what."""

STRIDE = 4
"""Windows between two that are learned from: neighbours are almost equal."""

LEAST_RATE = 0.003
"""Share of the learning rate that the last epochs still have."""


@dataclass(frozen=True, eq=False)
class Recogniser:
    """Logits of the interactions from one window and from where the arm has been.

    Attributes:
        network: From coordinates to (P,), in evaluation mode.
        question: Coordinates of the human's windows.
        past: Coordinates of the fading means; of none where there are no time constants.
    """

    network: Chain
    question: Coordinates
    past: Coordinates

    def logits(self, windows: Tensor, pasts: Tensor) -> Tensor:
        """(..., P) of windows (..., W D) and the past at each (..., C 3 J); see `faded`."""
        found: Tensor = self.network(torch.cat([self.question.project(windows), self.past.project(pasts)], dim=-1))
        return found


def train_recogniser(
    corpus: Corpus,
    settings: RecogniserSettings,
    augmentation: Augmentation,
    past_s: Sequence[float],
    epochs: int,
) -> Recogniser:
    """Learn to tell the interactions of a corpus apart. Draws from torch's global generator.

    Windows in which the hand has not moved yet say nothing: there all interactions shall be equally likely.

    Args:
        corpus: The trials.
        settings: Sizes and rates.
        augmentation: How trials are bent each time.
        past_s: Time constants of the past [s], for one that sees it.
        epochs: Passes over all trials.
    """
    past_s = past_s if settings.past else ()
    recorded = cut_tracks(corpus, corpus.tracks, 0, 1)
    question = principal_coordinates(
        recorded.question[recorded.valid > 0], settings.question_coordinates, settings.whitening
    )
    past = _past_coordinates(corpus, past_s)
    labels, width = len(corpus.interactions), corpus.protocol.window
    network = perceptron(question.size + past.size, settings.hidden, labels, settings.dropout)
    recogniser = Recogniser(network, question, past)
    optimiser = torch.optim.AdamW(network.parameters(), lr=settings.learning_rate)
    network.train()
    for epoch in range(epochs):
        for group in optimiser.param_groups:
            group["lr"] = settings.learning_rate * (0.5 * (1.0 + math.cos(math.pi * epoch / epochs)) + LEAST_RATE)
        phase = int(torch.randint(corpus.protocol.keep_every, ()))
        tracks, first = bend(corpus.tracks, augmentation), int(torch.randint(STRIDE, ()))
        batch = cut_tracks(corpus, tracks, first, STRIDE, phase)
        observed = tracks.observed[:, phase :: corpus.protocol.keep_every]
        newest = has_started(observed)[:, first + width - 1 :: STRIDE]
        wanted = functional.one_hot(batch.label, labels).float()[:, None].expand(*batch.valid.shape, -1)
        wanted = torch.where(newest[:, : batch.valid.shape[1], None], wanted, torch.full_like(wanted, 1.0 / labels))
        pasts = faded(observed[:, width - 1 :], past_s, corpus.rate_hz)[:, first::STRIDE][:, : batch.valid.shape[1]]
        surprise = -(wanted * functional.log_softmax(recogniser.logits(batch.question, pasts), -1)).sum(-1)
        optimiser.zero_grad()
        ((surprise * batch.valid).sum() / batch.valid.sum()).backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    network.eval()
    return recogniser


def faded(positions: Tensor, past_s: Sequence[float], rate_hz: float) -> Tensor:
    """(B, T, 3 J) positions [m] -> (B, T, C 3 J): `inference.past.fade` over whole tracks, for C time constants."""
    frame = torch.arange(positions.shape[1], dtype=torch.float32)
    age = frame[:, None] - frame
    means = []
    for constant in past_s:
        kept = math.exp(-1.0 / (constant * rate_hz))
        shares = torch.where(age < 0, torch.zeros(()), (1.0 - kept) * kept ** age.clamp(min=0.0))
        shares[:, 0] = kept**frame  # the first frame is also what was before it
        means.append(shares @ positions)
    return torch.cat(means, dim=-1) if means else positions[..., :0]


def _past_coordinates(corpus: Corpus, past_s: Sequence[float]) -> Coordinates:
    """The fading means about the mean position, in units of the deviation of all positions."""
    tracks = corpus.tracks
    recorded = tracks.observed[tracks.alive]
    mean, size = recorded.mean(dim=0).repeat(len(past_s)), recorded.shape[1] * len(past_s)
    return Coordinates(mean, torch.eye(size), torch.full((size,), float(recorded.std())), torch.ones(size))


def has_started(observed: Tensor) -> Tensor:
    """(B, T) whether the hand, the last joint of positions (B, T, 3 J) [m], has ever left its first place."""
    hand = observed[..., -3:]
    started: Tensor = ((hand - hand[:, :1]).norm(dim=-1) > STARTED_M).cumsum(dim=1) > 0
    return started

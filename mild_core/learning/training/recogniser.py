# SPDX-License-Identifier: Apache-2.0
"""A small network that classifies the interaction from the person's motion; the priors' likelihoods do it worse."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from mild_core.learning.data.coordinates import Coordinates, principal_coordinates
from mild_core.learning.training.corpus import Corpus, augment, cut_tracks
from mild_core.learning.training.settings import Augmentation, RecogniserSettings
from mild_core.learning.training.vae import LayerStack, perceptron

STARTED_M = 0.05
"""A motion starts when the hand is this far from its first place; before, it cannot be classified [m]."""

STRIDE = 4
"""Windows between two that are learned from: neighbours are almost equal."""

LEAST_RATE = 0.003
"""Share of the learning rate that the last epochs still have."""


@dataclass(frozen=True, eq=False)
class Recogniser:
    """Logits of the interactions from one window.

    Attributes:
        network: From coordinates to (P,), in evaluation mode.
        question: Coordinates of the human's windows.
    """

    network: LayerStack
    question: Coordinates

    def logits(self, windows: Tensor) -> Tensor:
        """(..., P) of windows (..., W D)."""
        found: Tensor = self.network(self.question.project(windows))
        return found


def train_recogniser(
    corpus: Corpus,
    settings: RecogniserSettings,
    augmentation: Augmentation,
    epochs: int,
) -> Recogniser:
    """Learn to classify the interactions of a corpus. Draws from torch's global generator.

    Windows in which the hand has not moved yet say nothing: there all interactions shall be equally likely.

    Args:
        corpus: The trials.
        settings: Sizes and rates.
        augmentation: How trials are bent each time.
        epochs: Passes over all trials.
    """
    recorded = cut_tracks(corpus, corpus.tracks, 0, 1)
    question = principal_coordinates(
        recorded.question[recorded.valid > 0], settings.question_coordinates, settings.whitening
    )
    labels, width = len(corpus.interactions), corpus.protocol.window
    network = perceptron(question.size, settings.hidden, labels, settings.dropout)
    recogniser = Recogniser(network, question)
    optimiser = torch.optim.AdamW(network.parameters(), lr=settings.learning_rate)
    network.train()
    for epoch in range(epochs):
        for group in optimiser.param_groups:
            group["lr"] = settings.learning_rate * (0.5 * (1.0 + math.cos(math.pi * epoch / epochs)) + LEAST_RATE)
        phase = int(torch.randint(corpus.protocol.keep_every, ()))
        tracks, first = augment(corpus.tracks, augmentation), int(torch.randint(STRIDE, ()))
        batch = cut_tracks(corpus, tracks, first, STRIDE, phase)
        observed = tracks.observed[:, phase :: corpus.protocol.keep_every]
        started = has_started(observed)[:, first + width - 1 :: STRIDE][:, : batch.valid.shape[1]]
        certain = functional.one_hot(batch.label, labels).float()[:, None]
        wanted = batch.valid_of(torch.where(started[..., None], certain, torch.full_like(certain, 1.0 / labels)))
        logits = recogniser.logits(batch.valid_of(batch.question))
        optimiser.zero_grad()
        functional.cross_entropy(logits, wanted).backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    network.eval()
    return recogniser


def has_started(observed: Tensor) -> Tensor:
    """(B, T) whether the hand, the last joint of positions (B, T, 3 J) [m], has ever left its first place."""
    hand = observed[..., -3:]
    started: Tensor = ((hand - hand[:, :1]).norm(dim=-1) > STARTED_M).cumsum(dim=1) > 0
    return started

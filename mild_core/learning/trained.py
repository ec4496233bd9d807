# SPDX-License-Identifier: Apache-2.0
"""What training returns: networks, priors and coordinates, and what torch makes of a trial with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from mild_core.inference.radial_basis import RadialBasis
from mild_core.learning.coordinates import Coordinates
from mild_core.learning.corpus import corpus_of, cut_tracks
from mild_core.learning.demonstration import Demonstration
from mild_core.learning.latent_prior import LatentPrior
from mild_core.learning.radial_basis import pasts
from mild_core.learning.recogniser import Recogniser
from mild_core.learning.settings import TrainingSettings
from mild_core.learning.vae import MemberNetworks
from mild_core.learning.windows import Protocol, cut
from mild_core.shapes import FloatArray


@dataclass(frozen=True, eq=False)
class TrainedMember:
    """One member.

    Attributes:
        networks: In evaluation mode.
        prior: Of all interactions.
        question: Coordinates of the human's windows.
        answer: Coordinates of the robot's windows.
        recogniser: None: the priors tell interactions apart.
    """

    networks: MemberNetworks
    prior: LatentPrior
    question: Coordinates
    answer: Coordinates
    recogniser: Recogniser | None = None

    def predict(self, questions: Tensor, label: Tensor) -> Tensor:
        """(B, N, W D) successive windows of B tracks and their labels (B,) -> (B, N, W J)."""
        with torch.no_grad():
            labels = len(self.prior.priors)
            known_label = torch.nn.functional.one_hot(label, labels).float()[:, None]
            window = self.question.project(questions)
            known = self.networks.sources(window, known_label.expand(-1, window.shape[1], -1))
            conditioned = self.networks.condition(known, *self.prior.explain(self.networks.observe(known), label))
            return self.answer.restore(self.networks.answer(known, self.networks.correct(known, conditioned)))


@dataclass(frozen=True, eq=False)
class TrainedModel:
    """All members of a model.

    Attributes:
        protocol: How windows are cut.
        settings: It was trained with.
        seed: Of all draws.
        interactions: By label.
        members: At least one.
        radial_basis: What answers beside them; None: they answer alone.
    """

    protocol: Protocol
    settings: TrainingSettings
    seed: int
    interactions: tuple[str, ...]
    members: tuple[TrainedMember, ...]
    radial_basis: RadialBasis | None = None

    def predict(self, demonstration: Demonstration) -> FloatArray:
        """Answer every window of a trial, its interaction given: torch's word, which the run time is held against.

        Returns:
            (N, W, J) joint angles [rad], in the order of `windows.cut`.
        """
        corpus = corpus_of([demonstration], self.protocol, self.interactions)
        true = cut(demonstration, self.protocol).controlled
        answers = np.zeros(true.shape)
        stride = self.settings.stride
        for first in range(min(stride, len(true))):
            batch = cut_tracks(corpus, corpus.tracks, first, stride)
            for member in self.members:
                answer = member.predict(batch.question, batch.label)[0].double().numpy()
                answers[first::stride] += answer.reshape(-1, *true.shape[1:]) / len(self.members)
        basis = self.radial_basis
        if basis is None:
            return answers
        label = np.eye(len(self.interactions))[self.interactions.index(demonstration.interaction)]
        observed = cut(demonstration, self.protocol).observed
        past = pasts(demonstration, self.protocol, self.settings.past_s)
        beside = np.array([basis.answer(*seen, label) for seen in zip(observed, past, strict=True)])
        blended: FloatArray = answers + basis.share[0] * (beside.reshape(answers.shape) - answers)
        return blended

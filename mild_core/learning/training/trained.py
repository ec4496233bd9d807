# SPDX-License-Identifier: Apache-2.0
"""What training returns: networks, priors and coordinates, and what torch makes of a trial with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from mild_core.inference.reservoir import Reservoir
from mild_core.inference.rest_detection import first_seen, rests, watch
from mild_core.inference.start_pose import StartPose
from mild_core.learning.data.coordinates import Coordinates
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol, cut, thin
from mild_core.learning.training.corpus import corpus_of, cut_tracks
from mild_core.learning.training.latent_prior import LatentPrior
from mild_core.learning.training.recogniser import Recogniser
from mild_core.learning.training.settings import TrainingSettings
from mild_core.learning.training.vae import MemberNetworks
from mild_core.shapes import FloatArray


@dataclass(frozen=True, eq=False)
class TrainedMember:
    """One member.

    Attributes:
        networks: In evaluation mode.
        prior: Of all interactions.
        question: Coordinates of the human's windows.
        answer: Coordinates of the robot's windows.
        recogniser: None: the reservoir classifies the interaction, or else the priors do.
        carried: Layers that training started with from another model, as `network.layer`.
    """

    networks: MemberNetworks
    prior: LatentPrior
    question: Coordinates
    answer: Coordinates
    recogniser: Recogniser | None = None
    carried: tuple[str, ...] = ()

    def predict(self, questions: Tensor, label: Tensor) -> Tensor:
        """(B, N, W D) successive windows of B tracks and their labels (B,) -> (B, N, W J)."""
        with torch.no_grad():
            labels = len(self.prior.priors)
            known_label = torch.nn.functional.one_hot(label, labels).float()[:, None]
            window = self.question.project(questions)
            sources = self.networks.sources(window, known_label.expand(-1, window.shape[1], -1))
            known = {name: value.flatten(0, 1) for name, value in sources.items()}
            lengths = [window.shape[1]] * len(window)
            explained = self.prior.explain(self.networks.observe(known), label, lengths)
            controlled = self.networks.correct(known, self.networks.condition(known, *explained))
            answer = self.answer.restore(self.networks.answer(known, controlled))
            return answer.reshape(*window.shape[:2], -1)

    def controlled_latents(
        self, demonstration: Demonstration, protocol: Protocol, interactions: tuple[str, ...]
    ) -> FloatArray:
        """(N, Q) means of the controlled agent's own posterior, of each of its windows in a trial."""
        corpus = corpus_of([demonstration], protocol, interactions)
        batch = cut_tracks(corpus, corpus.tracks, 0, 1)
        with torch.no_grad():
            posterior = self.networks.counterpart(self.answer.project(batch.answer[0]))
        return posterior.mean.double().numpy()


@dataclass(frozen=True, eq=False)
class TrainedModel:
    """All members of a model.

    Attributes:
        protocol: How windows are cut.
        settings: It was trained with.
        seed: Of all draws.
        interactions: By label.
        members: At least one.
        reservoir: What answers beside them; None: they answer alone.
        start_pose: Correction by the robot's start pose; None: none.
    """

    protocol: Protocol
    settings: TrainingSettings
    seed: int
    interactions: tuple[str, ...]
    members: tuple[TrainedMember, ...]
    reservoir: Reservoir | None = None
    start_pose: StartPose | None = None

    def predict(self, demonstration: Demonstration, *, started: bool = False) -> FloatArray:
        """Answer every window of a trial, its interaction given: torch's word, which the run time is held against.

        Args:
            demonstration: The trial.
            started: Whether it is known where the robot stood at the start.

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
        label = np.eye(len(self.interactions))[self.interactions.index(demonstration.interaction)]
        if self.reservoir is not None:
            answers += self.reservoir.share[0] * (self._beside(demonstration, label).reshape(answers.shape) - answers)
        if started and self.start_pose is not None:
            start = demonstration.controlled[0]
            both = zip(answers, self._resting(demonstration), strict=True)
            answers = np.array([self.start_pose.displaced(motion, start, label, resting) for motion, resting in both])
        return answers

    def _resting(self, demonstration: Demonstration) -> list[float]:
        """N, how much the person rests at the newest frame of every window."""
        trial, width = thin(demonstration, self.protocol), self.protocol.window
        hand_m = trial.observed_m[:, -1]
        rest, found = first_seen(hand_m[:1]), []
        for place_m in hand_m:
            rest = watch(rest, place_m, 1)
            found.append(rests(rest, place_m))
        return found[width - 1 : width - 1 + self.protocol.windows_of(trial.frames)]

    def _beside(self, demonstration: Demonstration, label: FloatArray) -> FloatArray:
        """(N, W J) what the reservoir answers to every window."""
        assert self.reservoir is not None
        trial, width = thin(demonstration, self.protocol), self.protocol.window
        positions = trial.observed_m.reshape(trial.frames, -1)
        states = self.reservoir.listen(positions, trial.rate_hz, None, 0)
        ends = range(width, width + self.protocol.windows_of(trial.frames))
        return np.array([self.reservoir.answer(states[end - 1], positions[end - width : end], label) for end in ends])

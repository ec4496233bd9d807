# SPDX-License-Identifier: Apache-2.0
"""What is minimised in an epoch: errors of prediction and of reconstruction, and the divergence from the prior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from mild_core.learning.data.coordinates import Coordinates
from mild_core.learning.training.corpus import WindowBatch
from mild_core.learning.training.latent_prior import LatentPrior, divergence
from mild_core.learning.training.settings import LossWeights, TrainingSettings
from mild_core.learning.training.vae import MemberNetworks, Posterior


@dataclass(frozen=True, eq=False)
class Terms:
    """The terms of the objective, means over the valid windows of a batch; tensors that gradients pass through.

    Errors are shares of the variance of the windows.

    Attributes:
        prediction: Of the robot's window from the human's; zero before there is a prior.
        observed: Of the human's window from its own latent.
        controlled: Of the robot's window from its own latent.
        divergence: Of both posteriors, in nats.
    """

    prediction: Tensor
    observed: Tensor
    controlled: Tensor
    divergence: Tensor

    def total(self, weights: LossWeights) -> Tensor:
        """Their weighted sum. The divergence is added: the bound of eq. 3 is maximised, its negative minimised."""
        return (
            weights.prediction * self.prediction
            + weights.observed * self.observed
            + weights.controlled * self.controlled
            + weights.divergence * self.divergence
        )


@dataclass(frozen=True, eq=False)
class Objective:
    """The objective of a training run.

    Attributes:
        settings: Weights, samples and strides.
        question: Coordinates of the human's windows.
        answer: Coordinates of the robot's windows.
        labels: P, number of interactions.
    """

    settings: TrainingSettings
    question: Coordinates
    answer: Coordinates
    labels: int

    def projected(self, windows: WindowBatch) -> WindowBatch:
        """Windows in coordinates, as all else here takes them; zero where they are not valid."""
        question, answer = (torch.zeros(*windows.valid.shape, c.size) for c in (self.question, self.answer))
        question[windows.places] = self.question.project(windows.valid_of(windows.question))
        answer[windows.places] = self.answer.project(windows.valid_of(windows.answer))
        return replace(windows, question=question, answer=answer)

    def known(self, networks: MemberNetworks, batch: WindowBatch) -> dict[str, Tensor]:
        """The sources of the networks at the valid windows: the human's coordinates, the label, the context."""
        label = functional.one_hot(batch.label, self.labels).float()[:, None].expand(*batch.valid.shape, -1)
        return {name: batch.valid_of(value) for name, value in networks.sources(batch.question, label).items()}

    def terms(
        self, networks: MemberNetworks, batch: WindowBatch, prior: LatentPrior | None, observed_only: bool = False
    ) -> Terms:
        """Evaluate a batch.

        Args:
            networks: In training mode.
            batch: Successive windows of trials at the gradient's stride, projected.
            prior: None in the first epoch, when both priors are N(0, I).
            observed_only: Leave out the robot's networks.
        """
        weights = self.settings.weights
        zero = torch.zeros(())
        known = self.known(networks, batch)
        human = networks.observe(known)
        observed = self._reconstruction(
            networks.counterpart_decoder(human.samples(self.settings.samples)), known["window"], self.question
        )
        if observed_only:
            return Terms(zero, observed, zero, self._divergence(human, prior, batch, True))
        wanted = batch.valid_of(batch.answer)
        robot = networks.counterpart(wanted)
        answered = networks.answer(known, robot.samples(self.settings.samples))
        controlled = self._reconstruction(answered, wanted, self.answer)
        divergence = self._divergence(human, prior, batch, True) + self._divergence(robot, prior, batch, False)
        prediction = zero
        if weights.prediction > 0.0:
            prediction = self._prediction(networks, batch, prior, known, human, wanted)
        return Terms(prediction, observed, controlled, divergence)

    def prediction(self, networks: MemberNetworks, batch: WindowBatch, prior: LatentPrior | None) -> Tensor:
        """Error of the robot's windows from what is known of the human."""
        known, wanted = self.known(networks, batch), batch.valid_of(batch.answer)
        return self._prediction(networks, batch, prior, known, networks.observe(known), wanted)

    def _prediction(
        self,
        networks: MemberNetworks,
        batch: WindowBatch,
        prior: LatentPrior | None,
        known: Mapping[str, Tensor],
        human: Posterior,
        wanted: Tensor,
    ) -> Tensor:
        """Error of the robot's windows from what is `known` of the human and the latent that follows from it."""
        # Before there is a prior the human's latent stands in for the robot's, to set the encoder going.
        conditioned = human.mean
        if prior is not None:
            conditioned = networks.condition(known, *prior.explain(human, batch.label, batch.lengths))
        predicted = networks.answer(known, networks.correct(known, conditioned))
        return self._reconstruction(predicted, wanted, self.answer)

    def _reconstruction(self, given: Tensor, wanted: Tensor, coordinates: Coordinates) -> Tensor:
        """Mean weighted squared error of (M, n) coordinates, or of samples (S, M, n) of them."""
        return ((given - wanted) ** 2 * coordinates.errors).sum(-1).mean()

    def _divergence(
        self, posterior: Posterior, prior: LatentPrior | None, batch: WindowBatch, observed: bool
    ) -> Tensor:
        if prior is None:
            size = posterior.mean.shape[-1]
            return divergence(posterior, torch.zeros(size), torch.eye(size), torch.zeros(())).mean()
        trial, number = batch.places
        label, step = batch.label[trial], (batch.first + number * self.settings.gradient_stride) // self.settings.stride
        block = prior.observed if observed else prior.controlled
        return block.divergence(posterior, label, prior.path[label, step]).mean()

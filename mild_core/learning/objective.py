# SPDX-License-Identifier: Apache-2.0
"""What is minimised in an epoch: errors of prediction and of reconstruction, and the divergence from the prior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from mild_core.learning.coordinates import Coordinates
from mild_core.learning.corpus import WindowBatch
from mild_core.learning.latent_prior import LatentPrior
from mild_core.learning.settings import LossWeights, TrainingSettings
from mild_core.learning.vae import MemberNetworks, Posterior


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

    def known(self, networks: MemberNetworks, batch: WindowBatch) -> dict[str, Tensor]:
        """The sources of the networks: coordinates of the human's windows, the label, the context."""
        window = self.question.project(batch.question)
        label = functional.one_hot(batch.label, self.labels).float()[:, None].expand(-1, window.shape[1], -1)
        return networks.sources(window, label)

    def terms(
        self, networks: MemberNetworks, batch: WindowBatch, prior: LatentPrior | None, observed_only: bool = False
    ) -> Terms:
        """Evaluate a batch.

        Args:
            networks: In training mode.
            batch: Successive windows of trials at the gradient's stride.
            prior: None in the first epoch, when both priors are N(0, I).
            observed_only: Leave out the robot's networks.
        """
        weights = self.settings.weights
        zero = torch.zeros(())
        known = self.known(networks, batch)
        human = networks.observe(known)
        observed = self._reconstruction(
            networks.counterpart_decoder(human.samples(self.settings.samples)), known["window"], self.question, batch
        )
        if observed_only:
            return Terms(zero, observed, zero, self._divergence(human, prior, batch, True))
        wanted = self.answer.project(batch.answer)
        robot = networks.counterpart(wanted)
        answered = networks.answer(known, robot.samples(self.settings.samples))
        controlled = self._reconstruction(answered, wanted, self.answer, batch)
        divergence = self._divergence(human, prior, batch, True) + self._divergence(robot, prior, batch, False)
        prediction = zero
        if weights.prediction > 0.0:
            prediction = self.prediction(networks, batch, prior, known, human)
        return Terms(prediction, observed, controlled, divergence)

    def prediction(
        self,
        networks: MemberNetworks,
        batch: WindowBatch,
        prior: LatentPrior | None,
        known: Mapping[str, Tensor],
        human: Posterior,
    ) -> Tensor:
        """Error of the robot's windows from what is `known` of the human and the latent that follows from it."""
        # Before there is a prior the human's latent stands in for the robot's, to set the encoder going.
        conditioned = human.mean
        if prior is not None:
            conditioned = networks.condition(known, *prior.explain(human, batch.label))
        predicted = networks.answer(known, networks.correct(known, conditioned))
        return self._reconstruction(predicted[None], self.answer.project(batch.answer), self.answer, batch)

    def _reconstruction(self, given: Tensor, wanted: Tensor, coordinates: Coordinates, batch: WindowBatch) -> Tensor:
        """Mean weighted squared error of (S, B, N, n) samples."""
        squared = ((given - wanted) ** 2 * coordinates.errors).sum(-1).mean(0)
        return _mean(squared, batch.valid)

    def _divergence(
        self, posterior: Posterior, prior: LatentPrior | None, batch: WindowBatch, observed: bool
    ) -> Tensor:
        if prior is None:
            return _mean(_divergence_from_unit(posterior), batch.valid)
        step = (
            batch.first + torch.arange(batch.valid.shape[1]) * self.settings.gradient_stride
        ) // self.settings.stride
        component = prior.path[batch.label][:, step]
        label = batch.label[:, None].expand_as(component)
        block = prior.observed if observed else prior.controlled
        return _mean(block.divergence(posterior, label, component), batch.valid)


def _divergence_from_unit(posterior: Posterior) -> Tensor:
    """KL(posterior || N(0, I))."""
    diagonal = torch.diagonal(posterior.factor, dim1=-2, dim2=-1)
    size = posterior.mean.shape[-1]
    square = posterior.mean.square().sum(-1) + posterior.factor.square().sum((-1, -2))
    return 0.5 * (square - size) - torch.log(diagonal).sum(-1)


def _mean(values: Tensor, valid: Tensor) -> Tensor:
    """Mean of (B, N) values over the valid windows."""
    return (values * valid).sum() / valid.sum()

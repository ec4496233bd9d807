# SPDX-License-Identifier: Apache-2.0
"""The priors of all interactions as the objective needs them: fixed within an epoch, gradients pass beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mild_core.compiled import compiled
from mild_core.inference.priors.filtering import explain_component
from mild_core.inference.priors.prior import Prior
from mild_core.inference.priors.semi_markov_chain import run_filter
from mild_core.learning.training.vae import Posterior
from mild_core.shapes import FloatArray

IntegerArray = NDArray[np.int64]


@compiled
def explain_windows(
    components: tuple[FloatArray, FloatArray],
    labels: IntegerArray,
    observed: FloatArray,
    widening: FloatArray,
    log_emissions: FloatArray,
    gains: FloatArray,
) -> None:
    """Density of each window under each component, and Sigma_co (Sigma_oo + widening)^-1.

    Args:
        components: Means (P, K, Z) and covariances (P, K, Z, Z) of all interactions, observed dimensions first.
        labels: (M,) places among the P.
        observed: (M, Q) latents.
        widening: (M, Q, Q) covariances of the encoder's posteriors.
        log_emissions: (M, K) filled.
        gains: (M, K, Z - Q, Q) filled.

    Source: eq. 8 of MILD as mild_core/README.md corrects it.
    """
    means, covariances = components
    (windows, size), total = observed.shape, means.shape[2]
    block, whitened, reciprocals = np.empty((total, size)), np.empty(size), np.empty(size)
    for n in range(windows):
        for j in range(means.shape[1]):
            mean, covariance, latent = means[labels[n], j], covariances[labels[n], j], (observed[n], widening[n])
            log_emissions[n, j], _ = explain_component(mean, covariance, latent, block, whitened, reciprocals)
            for row in range(size, total):  # times L^-1, as it is times L^-T already
                for column in range(size - 1, -1, -1):
                    value = block[row, column]
                    for k in range(column + 1, size):
                        value -= block[row, k] * block[k, column]
                    block[row, column] = value * reciprocals[column]
                    gains[n, j, row - size, column] = block[row, column]


def divergence(posterior: Posterior, mean: Tensor, precision: Tensor, log_determinant: Tensor) -> Tensor:
    """(M,) KL(posterior || prior) in nats, the prior a Gaussian or one for each of the M posteriors.

    Source: the regulariser of eq. 3 of MILD, in closed form.
    """
    difference = posterior.mean - mean
    distance = (difference * (precision @ difference[..., None])[..., 0]).sum(-1)
    trace = (precision * posterior.covariance).sum((-1, -2))
    diagonal = torch.diagonal(posterior.factor, dim1=-2, dim2=-1)
    log_ratio = log_determinant - 2.0 * torch.log(diagonal).sum(-1)
    return 0.5 * (trace + distance - posterior.mean.shape[-1] + log_ratio)


@dataclass(frozen=True, eq=False)
class BlockPrior:
    """One agent's block of all components of all interactions, for the divergence of its posteriors.

    Attributes:
        mean: (P, K, Q).
        precision: (P, K, Q, Q).
        log_determinant: (P, K) of the covariance.
    """

    mean: Tensor
    precision: Tensor
    log_determinant: Tensor

    def divergence(self, posterior: Posterior, label: Tensor, component: Tensor) -> Tensor:
        """(M,) KL(posterior || component) in nats; `label` and `component` are (M,)."""
        place = (label, component)
        return divergence(posterior, self.mean[place], self.precision[place], self.log_determinant[place])


@dataclass(frozen=True, eq=False)
class LatentPrior:
    """The priors of all interactions.

    Attributes:
        priors: One per interaction, by label.
        observed: The human's blocks.
        controlled: The robot's blocks.
        path: (P, N) the component expected at each step when nothing is observed (eq. 9).
        means: (P, K, Z).
        components: Means (P, K, Z) and covariances (P, K, Z, Z) in double precision.
    """

    priors: tuple[Prior, ...]
    observed: BlockPrior
    controlled: BlockPrior
    path: Tensor
    means: Tensor
    components: tuple[FloatArray, FloatArray]

    def explain(self, posterior: Posterior, label: Tensor, lengths: Sequence[int]) -> tuple[Tensor, Tensor]:
        """How far the filter believes in each component and what that one expects, at each step of B trials.

        Gradients reach the encoder through its mean alone; belief, gains and prior are taken as they are.

        Args:
            posterior: Of M steps, trial after trial.
            label: (B,) of the trials.
            lengths: Steps of each trial, M in sum.

        Returns:
            The belief (M, K) and the robot's latent expected under each component (M, K, C).
        """
        size = posterior.mean.shape[-1]
        observed = posterior.mean.detach().double().numpy()
        widening = posterior.covariance.detach().double().numpy()
        log_emissions = np.empty((len(observed), self.means.shape[1]))
        gains = np.empty((*log_emissions.shape, self.means.shape[-1] - size, size))
        of_step = label.repeat_interleave(torch.tensor(lengths))
        explain_windows(self.components, of_step.numpy(), observed, widening, log_emissions, gains)
        chosen = [self.priors[c] for c in label.tolist()]
        trials = np.split(log_emissions, np.cumsum(lengths)[:-1])
        belief = np.concatenate([run_filter(p.chain, row).weights for p, row in zip(chosen, trials, strict=True)])
        means = self.means[of_step]
        surprise = posterior.mean[..., None, :] - means[..., :size]
        expected = means[..., size:] + (torch.from_numpy(gains.astype(np.float32)) @ surprise[..., None])[..., 0]
        return torch.from_numpy(belief.astype(np.float32)), expected


def latent_prior(priors: Mapping[str, Prior], widening: tuple[Tensor, Tensor], steps: int) -> LatentPrior:
    """Put the priors of all interactions together.

    Args:
        priors: By interaction, in the order of the labels.
        widening: Mean posterior covariance (Q, Q) of the human's and (C, C) of the robot's encoder. The prior is
            estimated from posterior means; samples scatter more widely, and a dimension that an encoder has given up
            would otherwise be a point that no posterior could be near.
        steps: N, length of the component path.
    """
    means = np.ascontiguousarray(np.stack([prior.components.mean for prior in priors.values()]))
    covariances = np.ascontiguousarray(np.stack([prior.components.covariance for prior in priors.values()]))
    size = len(widening[0])
    observed = _block(means, covariances, slice(0, size), widening[0])
    controlled = _block(means, covariances, slice(size, None), widening[1])
    path = torch.tensor([prior.component_path(steps) for prior in priors.values()])
    return LatentPrior(
        tuple(priors.values()), observed, controlled, path, torch.from_numpy(means).float(), (means, covariances)
    )


def _block(means: FloatArray, covariances: FloatArray, part: slice, widening: Tensor) -> BlockPrior:
    covariance = torch.from_numpy(covariances[..., part, part]) + widening
    return BlockPrior(
        torch.from_numpy(means[..., part]).float(),
        torch.linalg.inv(covariance).float(),
        torch.logdet(covariance).float(),
    )

# SPDX-License-Identifier: Apache-2.0
"""Between epochs: the networks encode all trials, unbent, and the priors are re-estimated from the latents."""

from __future__ import annotations

import torch
from torch import Tensor

from mild_core.inference.priors import PRIORS
from mild_core.inference.priors.prior import FitSettings
from mild_core.learning.training.corpus import Corpus, cut_tracks
from mild_core.learning.training.objective import Objective
from mild_core.learning.training.snapshot import FittedPriors
from mild_core.learning.training.vae import MemberNetworks
from mild_core.shapes import FloatArray


def refit(
    networks: MemberNetworks, objective: Objective, corpus: Corpus, before: FittedPriors | None
) -> tuple[FittedPriors, float]:
    """Encode all trials, unbent, and re-estimate each interaction's prior, from the last one if there is one.

    Returns:
        The priors, and the log-likelihood of the latents under them, by step [nats].

    Source: Algorithm 1 of MILD, its EM step.
    """
    settings = objective.settings.prior
    latents, widening, steps = encode(networks, objective, corpus)
    fit = FitSettings(iterations=settings.iterations, covariance_fraction=settings.covariance_fraction)
    refitted, log_likelihood, frames = {}, 0.0, 0
    for name, sequences in latents.items():
        if before is None:
            size = objective.settings.architecture.latent
            prior = PRIORS[settings.kind].from_demonstrations(sequences, settings.components, size, fit)
        else:
            prior = before.by_name[name]
        found = prior.fit(sequences, fit)
        refitted[name] = found.prior
        log_likelihood += found.log_likelihoods[-1]
        frames += sum(len(z) for z in sequences)
    return FittedPriors(refitted, widening, steps), log_likelihood / frames


def encode(
    networks: MemberNetworks, objective: Objective, corpus: Corpus
) -> tuple[dict[str, list[FloatArray]], tuple[Tensor, Tensor], int]:
    """Joint latents of all trials, unbent.

    Returns:
        By interaction, one (N, Z) of posterior means per trial and interleaved copy (at most two of these: neighbours
        are almost equal); the mean posterior covariances of both agents; the most steps that any window can be at.
    """
    stride = objective.settings.stride
    latents: dict[str, list[FloatArray]] = {name: [] for name in corpus.interactions}
    covariances: list[tuple[Tensor, Tensor]] = []
    networks.eval()
    steps = 0
    with torch.no_grad():
        for first in sorted({0, stride // 2}):
            batch = objective.projected(cut_tracks(corpus, corpus.everything, first, stride))
            human = networks.observe(objective.known(networks, batch))
            robot = networks.counterpart(batch.valid_of(batch.answer))
            joint = torch.cat([human.mean, robot.mean], dim=-1).double()
            for label, trial in zip(batch.label.tolist(), torch.split(joint, batch.lengths), strict=True):
                latents[corpus.interactions[label]].append(trial.numpy())
            covariances.append((human.covariance.mean(0), robot.covariance.mean(0)))
            steps = max(steps, batch.valid.shape[1])
    mean = (torch.stack([pair[0] for pair in covariances]).mean(0), torch.stack([p[1] for p in covariances]).mean(0))
    return latents, mean, steps + 1

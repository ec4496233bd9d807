# SPDX-License-Identifier: Apache-2.0
"""Bütepage et al.'s networks: windows embedded by variational autoencoders, and recurrent models of how they go on.

They are learned one after the other, each kept as it is from then on: the embedding of people's windows, the dynamics
of people in it, the embedding of the controlled agent's windows, and its dynamics given the person's.

Source: J. Bütepage et al., "Imitating by Generating: Deep Generative Models for Imitation of Interactive Tasks",
Frontiers in Robotics and AI 2020; sizes, losses and where samples are drawn as in the MILD authors' re-implementation,
github.com/souljaboy764/buetepage-phri.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn
from torch.distributions import Normal, kl_divergence
from torch.nn import functional

from mild_core.learning.baselines.recurrent import HIDDEN, RecurrentNetwork
from mild_core.learning.training.compiled_gru import compile_memories

WINDOW_HIDDEN = (250, 150)
PERSON, CONTROLLED, DYNAMICS = 10, 7, 40
"""Sizes of the latents: of people's windows, of the controlled agent's, and of what two people are doing together."""

BETA = 0.5
"""Weight of the divergences beside squared errors summed over a window of standardised values."""

SAMPLES = 10
"""Of a window's posterior, decoded in training."""

LEAST_DEVIATION = 1e-2
"""Of all Gaussians."""

STEPS, LEARNING_RATE = 300, 1e-3
"""Of the embeddings and of the dynamics of people; the rate falls to zero."""

WINDOWS_EACH, PEOPLE_EACH, TIMES_EACH = 32, 16, 32
"""Drawn for a step: windows; people, each with their partner, and times of theirs at which windows are compared."""


def _normal(outputs: Tensor) -> Normal:
    """The halves of the outputs as mean and deviation."""
    mean, spread = outputs.chunk(2, dim=-1)
    return Normal(mean, functional.softplus(spread) + LEAST_DEVIATION, validate_args=False)


def _descend(network: nn.Module, loss: Callable[[], Tensor]) -> None:
    """Learn by a loss that draws other samples each time, then keep the network as it is."""
    optimiser = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)
    for _ in range(STEPS):
        optimiser.zero_grad()
        loss().backward()  # type: ignore[no-untyped-call]  # torch does not type it
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        schedule.step()
    network.requires_grad_(False)


class Embedding(nn.Module):
    """A variational autoencoder of standardised windows."""

    def __init__(self, values: int, latent: int) -> None:
        super().__init__()
        wide, narrow = WINDOW_HIDDEN
        self.encoder = nn.Sequential(
            *(nn.Linear(values, wide), nn.ReLU(), nn.Linear(wide, narrow), nn.ReLU(), nn.Linear(narrow, 2 * latent))
        )
        self.decoder = nn.Sequential(
            *(nn.Linear(latent, narrow), nn.ReLU(), nn.Linear(narrow, wide), nn.ReLU(), nn.Linear(wide, values))
        )

    def posterior(self, windows: Tensor) -> Normal:
        """(..., F) -> a diagonal Gaussian over (..., latent)."""
        return _normal(self.encoder(windows))

    def loss(self, windows: Tensor) -> Tensor:
        """Of windows (B, F): squared error of samples and divergence from N(0, 1), by value."""
        posterior = self.posterior(windows)
        error = ((self.decoder(posterior.rsample((SAMPLES,))) - windows) ** 2).mean()
        prior = Normal(torch.zeros_like(posterior.mean), torch.ones_like(posterior.mean))
        loss: Tensor = error + BETA * kl_divergence(posterior, prior).sum(-1).mean() / windows.shape[-1]
        return loss


def learn_embedding(windows: Tensor, latent: int) -> Embedding:
    """Of windows (N, F). Draws from torch's global generator."""
    embedding = Embedding(windows.shape[1], latent)
    _descend(embedding, lambda: embedding.loss(windows[torch.randint(len(windows), (WINDOWS_EACH,))]))
    return embedding


@dataclass(frozen=True, eq=False)
class People:
    """Tracks of people, padded at their ends.

    Attributes:
        frames: (B, T, inputs) standardised features, and the interaction.
        lengths: (B,) frames recorded.
        partner: (B,) place of who did it with them, or their own where no person did.
        features: D, how many of the inputs are features.
        window: W, frames of a window.
        stride: Every how many frames one is seen.
    """

    frames: Tensor
    lengths: Tensor
    partner: Tensor
    features: int
    window: int
    stride: int

    def drawn(self) -> People:
        """Some of them, with their partners. Draws from torch's global generator."""
        some = torch.randperm(len(self.lengths))[:PEOPLE_EACH]
        rows, count = torch.cat([some, self.partner[some]]), len(some)
        lengths, partner = self.lengths[rows], torch.arange(2 * count).roll(count)
        return replace(self, frames=self.frames[rows, : int(lengths.max())], lengths=lengths, partner=partner)

    def windows(self, first: int) -> tuple[Tensor, Tensor]:
        """(B, N, W D) windows that end with every `stride`-th frame from `first` on; (B, N) whether it was recorded."""
        return self.windows_at(torch.arange(first, self.frames.shape[1], self.stride))

    def windows_at(self, ends: Tensor) -> tuple[Tensor, Tensor]:
        """The same of windows that end with the frames `ends` (N,)."""
        begins = (ends - self.window + 1).clamp(min=0)
        places = begins[:, None] + torch.arange(self.window)
        recorded = (ends >= self.window - 1) & (ends < self.lengths[:, None])
        return self.frames[:, places, : self.features].flatten(2), recorded


class PersonDynamics(nn.Module):
    """From a person's frames so far to what is being done, and from that to the embedding of the person's window."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.memory = nn.GRU(inputs, HIDDEN, batch_first=True)
        compile_memories(self)
        self.doing = nn.Linear(HIDDEN, 2 * DYNAMICS)
        self.shown = nn.Sequential(
            *(nn.Linear(DYNAMICS, DYNAMICS), nn.Tanh(), nn.Linear(DYNAMICS, DYNAMICS), nn.Tanh()),
            nn.Linear(DYNAMICS, 2 * PERSON),
        )

    def posterior(self, frames: Tensor) -> Normal:
        """(B, T, inputs) -> a Gaussian over (B, T, DYNAMICS)."""
        return _normal(self.outputs(frames))

    def outputs(self, frames: Tensor) -> Tensor:
        """The same as numbers."""
        outputs: Tensor = self.doing(torch.tanh(self.memory(frames)[0]))
        return outputs

    def loss(self, people: People, embedding: Embedding, first: int) -> Tensor:
        """Each person's window is that of the embedding, and two people who do it together are doing the same."""
        seen = torch.arange(first, people.frames.shape[1], people.stride)
        some = torch.randperm(len(seen))[:TIMES_EACH]
        windows, recorded = people.windows_at(seen[some])
        doing = _normal(self.outputs(people.frames[:, seen])[:, some])
        sample = doing.rsample()
        window = kl_divergence(_normal(self.shown(sample)), embedding.posterior(windows)).sum(-1)
        other = Normal(doing.mean[people.partner], doing.stddev[people.partner])
        mine, theirs = (one.log_prob(sample) for one in (doing, other))  # type: ignore[no-untyped-call]  # torch's
        # Half of the Jensen-Shannon divergence; the partner's own row brings the other half.
        apart = (mine - torch.logaddexp(mine, theirs) + math.log(2.0)).sum(-1)
        loss: Tensor = (window + apart)[recorded].mean()
        return loss


def learn_people(people: People) -> PersonDynamics:
    """The embedding of people's windows, then their dynamics in it. Draws from torch's global generator."""
    parts = (people.windows(first) for first in range(people.stride))
    embedding = learn_embedding(torch.cat([windows[recorded] for windows, recorded in parts]), PERSON)
    dynamics = PersonDynamics(people.frames.shape[2])
    _descend(dynamics, lambda: dynamics.loss(people.drawn(), embedding, int(torch.randint(people.stride, ()))))
    return dynamics


class SharedEmbedding(RecurrentNetwork):
    """From what the person is doing to the controlled agent's embedding; training samples, predicting takes means.

    Theirs also sees the controlled agent's measured motion at each step, which no method gets here; its own last
    prediction in that place would hold nothing that its memory does not.
    """

    def __init__(self, person: PersonDynamics, controlled: Embedding, labels: int) -> None:
        super().__init__()
        self.person, self.controlled, self.labels = person, controlled, labels
        self.memory = nn.GRU(DYNAMICS + labels, HIDDEN, batch_first=True)
        self.latent = nn.Sequential(nn.Linear(HIDDEN, HIDDEN), nn.LeakyReLU(0.01), nn.Linear(HIDDEN, 2 * CONTROLLED))
        compile_memories(self)

    def _latents(self, frames: Tensor) -> Normal:
        """(B, T, inputs) -> a Gaussian over (B, T, CONTROLLED)."""
        with torch.no_grad():
            doing = self.person.posterior(frames).mean
        given = torch.cat([doing, frames[..., frames.shape[-1] - self.labels :]], dim=-1)
        return _normal(self.latent(self.memory(given)[0]))

    def answer(self, frames: Tensor) -> Tensor:
        """See `RecurrentNetwork`."""
        answer: Tensor = self.controlled.decoder(self._latents(frames).mean)
        return answer

    def loss(self, frames: Tensor, wanted: Tensor) -> Tensor:
        """Squared error of a decoded sample and divergence from the true window's posterior, by value."""
        latents = self._latents(frames)
        error = ((self.controlled.decoder(latents.rsample()) - wanted) ** 2).mean(dim=-1)
        apart = kl_divergence(latents, self.controlled.posterior(wanted)).sum(-1)
        loss: Tensor = error + BETA * apart / wanted.shape[-1]
        return loss


def people_of(tracks: Sequence[Tensor], partner: Sequence[int], features: int, window: int, stride: int) -> People:
    """Tracks (T, inputs) of any lengths put together; see `People` for the rest."""
    lengths = torch.tensor([len(track) for track in tracks])
    return People(
        nn.utils.rnn.pad_sequence(list(tracks), batch_first=True),
        lengths,
        torch.tensor(partner),
        features,
        window,
        stride,
    )

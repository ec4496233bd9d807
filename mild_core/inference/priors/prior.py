# SPDX-License-Identifier: Apache-2.0
"""The contract of a prior over the joint latent of both agents, and all that its members share.

A prior is K Gaussians and a chain that says in which order, and for how long, they follow each other. Members differ
in the chains that they admit and in how they re-estimate them; everything else is written once, here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from mild_core.inference.gaussian import Gaussian
from mild_core.inference.priors.demonstrations import LatentFrames, estimate_components, latent_frames, log_emissions
from mild_core.inference.priors.filtering import observe_frame
from mild_core.inference.priors.semi_markov_chain import (
    ChainCounts,
    ChainExpectation,
    SemiMarkovChain,
    component_probabilities,
    expect,
)
from mild_core.shapes import FloatArray, read_only, require_shape


@dataclass(frozen=True)
class FitSettings:
    """How to re-estimate a prior.

    Attributes:
        iterations: Of expectation maximisation, at most.
        tolerance: Stop when the log-likelihood per frame rises by less (nats).
        covariance_fraction: Share of the latents' variance that is added to every covariance.
        duration_floor: Share of a component's durations spread evenly over 1..D, so that it can always end.
        duration_spread: Least standard deviation of a component's duration as a share of its mean; 0 keeps the
            plain histogram of expected durations instead of a discretised normal distribution.
        pseudo_count: Transitions, and starts, that count as seen before any demonstration.
    """

    iterations: int = 20
    tolerance: float = 1e-4
    covariance_fraction: float = 0.1
    duration_floor: float = 0.01
    duration_spread: float = 0.2
    pseudo_count: float = 0.5


@dataclass(frozen=True, eq=False)
class ComponentPosteriors:
    """One observed latent as each component sees it, whatever was before.

    Attributes:
        log_emissions: (K,) log-densities of the observed block.
        distances: (K,) Mahalanobis distances in it.
        conditioned: (K,) Gaussians over the controlled latent, given the observed one.
    """

    log_emissions: FloatArray
    distances: FloatArray
    conditioned: Gaussian


@dataclass(frozen=True, eq=False)
class Fit:
    """A re-estimated prior.

    Attributes:
        prior: The new one.
        log_likelihoods: Of all latents, before each iteration and after the last.
    """

    prior: Prior
    log_likelihoods: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Prior(ABC):
    """A prior of one interaction over the joint latent [z_observed; z_controlled].

    Attributes:
        components: (K,) Gaussians over Z dimensions, the observed agent's Q first.
        chain: Their order and durations.
        phases: (K,) mean time of each component in a demonstration, from 0 (its start) to 1 (its end).
        observed_size: Q.

    Raises:
        ValueError: When the parts do not fit each other, or the chain is none of this kind.
    """

    components: Gaussian
    chain: SemiMarkovChain
    phases: FloatArray
    observed_size: int

    kind: ClassVar[str]

    def __post_init__(self) -> None:
        object.__setattr__(self, "phases", read_only(self.phases))
        require_shape("means", self.components.mean, (self.chain.components, None))
        require_shape("phases", self.phases, (self.chain.components,))
        if not 0 < self.observed_size <= self.components.mean.shape[1]:
            raise ValueError(f"observed_size {self.observed_size} is not within 1..{self.components.mean.shape[1]}")
        self.check_chain(self.chain)

    @staticmethod
    @abstractmethod
    def check_chain(chain: SemiMarkovChain) -> None:
        """Raise ValueError unless `chain` is one of this kind."""

    @staticmethod
    @abstractmethod
    def first_chain(components: int, lengths: Sequence[int], settings: FitSettings) -> SemiMarkovChain:
        """The chain to start from when each demonstration is cut into K equal parts."""

    @staticmethod
    @abstractmethod
    def estimate_chain(previous: SemiMarkovChain, counts: ChainCounts, settings: FitSettings) -> SemiMarkovChain:
        """The M-step of the chain."""

    @classmethod
    def from_demonstrations(
        cls, latents: Sequence[FloatArray], components: int, observed_size: int, settings: FitSettings | None = None
    ) -> Self:
        """A first prior: each demonstration is cut in time into K equal parts, part j belongs to component j.

        Args:
            latents: One (T, Z) per demonstration.
            components: K.
            observed_size: Q.
            settings: For the widening of the covariances and the first durations.

        Raises:
            ValueError: When a demonstration has fewer frames than there are components.

        Source: MILD, section "Initialisation"; `fit` refines it.
        """
        settings = settings or FitSettings()
        frames = latent_frames(latents)
        if min(frames.lengths) < components:
            raise ValueError(f"demonstrations of {frames.lengths} frames cannot be cut into {components} parts")
        assigned = np.concatenate([np.arange(length) * components // length for length in frames.lengths])
        gaussians = estimate_components(None, np.eye(components)[assigned], frames, settings.covariance_fraction)
        phases = (np.arange(components) + 0.5) / components
        return cls(gaussians, cls.first_chain(components, frames.lengths, settings), phases, observed_size)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, FloatArray], observed_size: int) -> Self:
        """The prior that `to_arrays` wrote.

        Raises:
            KeyError: When an array is missing.
            ValueError: When the arrays do not make a prior of this kind.
        """
        chain = SemiMarkovChain(arrays["initial"], arrays["transitions"], arrays["durations"])
        return cls(Gaussian(arrays["means"], arrays["covariances"]), chain, arrays["phases"], observed_size)

    def to_arrays(self) -> dict[str, FloatArray]:
        """Everything but the kind and `observed_size`, by name."""
        return {
            "means": self.components.mean,
            "covariances": self.components.covariance,
            "initial": self.chain.initial,
            "transitions": self.chain.transitions,
            "durations": self.chain.durations,
            "phases": self.phases,
        }

    @property
    def controlled_size(self) -> int:
        """C = Z - Q."""
        return int(self.components.mean.shape[1]) - self.observed_size

    def explain(self, observed: FloatArray, observed_covariance: FloatArray | None = None) -> ComponentPosteriors:
        """What each component says of one observed latent and expects of the controlled one.

        Args:
            observed: (Q,) latent of the observed agent.
            observed_covariance: (Q, Q) of the encoder; widens the observed block. None: exact.

        Source: eq. 8 of MILD, corrected.
        """
        require_shape("observed", observed, (self.observed_size,))
        components, controlled = self.chain.components, self.controlled_size
        if observed_covariance is None:
            observed_covariance = np.zeros((self.observed_size, self.observed_size))
        log_emissions, distances = np.empty(components), np.empty(components)
        means, covariances = np.empty((components, controlled)), np.empty((components, controlled, controlled))
        latent = np.ascontiguousarray(observed, dtype=np.float64)
        widening = np.ascontiguousarray(observed_covariance, dtype=np.float64)
        gaussians = (self.components.mean, self.components.covariance)
        observe_frame(gaussians, (latent, widening), log_emissions, distances, means, covariances)
        means.flags.writeable = covariances.flags.writeable = False
        return ComponentPosteriors(log_emissions, distances, Gaussian(means, covariances))

    def component_path(self, frames: int) -> list[int]:
        """The likeliest component of each of T frames when nothing is observed: the paper's prior of frame t.

        Source: eq. 9 of MILD.
        """
        return [int(j) for j in component_probabilities(self.chain, frames).argmax(axis=1)]

    def expect(self, latents: Sequence[FloatArray] | LatentFrames) -> ChainExpectation:
        """Posterior components, counts and log-likelihood of whole demonstrations, each (T, Z)."""
        frames = latents if isinstance(latents, LatentFrames) else latent_frames(latents)
        return expect(self.chain, log_emissions(self.components, frames), frames.lengths)

    def fit(self, latents: Sequence[FloatArray], settings: FitSettings | None = None) -> Fit:
        """A new prior, by expectation maximisation that starts from this one.

        Starting from the previous epoch's prior keeps component j the same part of the motion.

        Args:
            latents: One (T, Z) per demonstration of the interaction.
            settings: How far and how carefully.

        Source: Algorithm 1 of MILD, its EM step.
        """
        settings = settings or FitSettings()
        frames = latent_frames(latents)
        prior, expectation = self, self.expect(frames)
        history = [expectation.log_likelihood]
        for _ in range(settings.iterations):
            shares = expectation.responsibilities
            occupancy = np.ones(len(shares)) @ shares  # several times as fast as their sum over the long axis
            prior = replace(
                prior,
                components=estimate_components(prior.components, shares, frames, settings.covariance_fraction),
                chain=self.estimate_chain(prior.chain, expectation.counts, settings),
                phases=np.where(occupancy > 1e-6, frames.times @ shares / np.maximum(occupancy, 1e-6), prior.phases),
            )
            expectation = prior.expect(frames)
            history.append(expectation.log_likelihood)
            if history[-1] - history[-2] < settings.tolerance * len(frames.times):
                break
        return Fit(prior, tuple(history))

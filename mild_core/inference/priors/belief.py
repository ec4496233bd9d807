# SPDX-License-Identifier: Apache-2.0
"""What a prior believes while an interaction unfolds, as values."""

from __future__ import annotations

from dataclasses import dataclass

from mild_core.inference.gaussian import Gaussian
from mild_core.shapes import FloatArray, read_only


@dataclass(frozen=True, eq=False)
class Belief:
    """What is believed about the chain after the frames so far.

    Attributes:
        weights: (K,) over components, sums to one: h of the paper. Before the first frame: the start probabilities.
        memory: (K, D) over components and remaining time; its rows sum to `weights`. Zero before the first frame.
        started: Whether a frame has been seen.
        log_likelihood: log p(newest frame | frames before), 0 before the first.
        known: False when the newest frame was so far from every reachable component that all densities underflow.
            The belief then moved on by time alone.
    """

    weights: FloatArray
    memory: FloatArray
    started: bool
    log_likelihood: float
    known: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", read_only(self.weights))
        object.__setattr__(self, "memory", read_only(self.memory))


@dataclass(frozen=True, eq=False)
class Filtered:
    """A recording seen through the online filter.

    Attributes:
        weights: (T, K) belief after each frame.
        log_likelihoods: (T,) of each frame given those before it.
        conditioned_means: (T, K, Z - Q) what each component expects of the controlled latent, given the observed.
    """

    weights: FloatArray
    log_likelihoods: FloatArray
    conditioned_means: FloatArray


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

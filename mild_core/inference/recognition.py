# SPDX-License-Identifier: Apache-2.0
"""Which interaction is going on, from how well each one's prior predicts the person."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mild_core.shapes import FloatArray, read_only

CLOSEST_CALL = 50.0
"""Floor of the per-frame log-likelihood ratio [nat], so that one outlier cannot rule an interaction out."""


@dataclass(frozen=True, eq=False)
class Recognition:
    """What is believed about the interaction.

    Attributes:
        evidence: (P,) tempered log-likelihoods, forgotten little by little.
        probabilities: (P,) sum to one.
        likeliest: Number of the most probable one.
        probability: Of that one.
    """

    evidence: FloatArray
    probabilities: FloatArray
    likeliest: int = field(init=False)
    probability: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "evidence", read_only(self.evidence))
        object.__setattr__(self, "probabilities", read_only(self.probabilities))
        object.__setattr__(self, "likeliest", int(self.probabilities.argmax()))
        object.__setattr__(self, "probability", float(self.probabilities[self.likeliest]))


def uniform_belief(interactions: int) -> Recognition:
    """Nothing seen: all are equally likely."""
    return Recognition(np.zeros(interactions), np.full(interactions, 1.0 / interactions))


def one_hot_belief(interaction: int, interactions: int) -> Recognition:
    """Belief concentrated on a given interaction."""
    return Recognition(np.zeros(interactions), np.eye(interactions)[interaction])


def recognise(before: Recognition, log_likelihoods: FloatArray, temper: float, forgetting: float) -> Recognition:
    """Weigh one more frame.

    Args:
        before: The belief so far.
        log_likelihoods: (P,) log p(frame | frames before, interaction), but for a constant; the mean over all
            classifiers.
        temper: Power of one frame's likelihood. Successive windows overlap by W - 1 frames, so they are far from
            independent.
        forgetting: Share of the evidence that is kept, so that a new interaction is noticed.

    Source: ours: recognition by tempered per-interaction likelihood.
    """
    relative = np.maximum(log_likelihoods - log_likelihoods.max(), -CLOSEST_CALL)
    evidence = forgetting * before.evidence + temper * relative
    weights = np.exp(evidence - evidence.max())
    return Recognition(evidence - evidence.max(), weights / weights.sum())

# SPDX-License-Identifier: Apache-2.0
"""When to stop: how many epochs trials that are not learned from call for.

A network learns from all folds but one, for few epochs, and is asked about that one; then another for twice as many,
until twice as many make the error no smaller: it has levelled off. The members then learn from all trials for as many
epochs as were enough. Each of these trainings is a whole one, whose learning rate falls to zero: watched within one
long training, the error seems to level off while the rate is high, and who stops there errs an eighth more.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy

import torch

from mild_core.learning.training.corpus import Corpus, cut_tracks
from mild_core.learning.training.objective import Objective
from mild_core.learning.training.snapshot import Learner

LEAST_GAIN = 0.01
"""Share by which an error must fall to be a better one: less is chance."""


def lengths(epochs: int, doublings: int) -> tuple[int, ...]:
    """Numbers of epochs to try, each twice the one before, the last one `epochs`; none of no doublings."""
    shorter = {max(1, round(epochs / 2**n)) for n in range(doublings + 1)}
    return tuple(sorted(shorter)) if doublings else ()


def converged(errors: Sequence[float]) -> bool:
    """Whether the last of `errors`, each after twice as many epochs, is no clearly better one."""
    return len(errors) > 1 and not errors[-1] < errors[-2] * (1.0 - LEAST_GAIN)


def validation_error(learner: Learner, objective: Objective, held_out: Corpus) -> float:
    """Error of the robot's windows that a learner would make now on trials as recorded, the interaction given.

    The running average of the weights answers where there is one, as it will in the end.

    Returns:
        A share of the variance of the windows that are learned from.
    """
    networks = deepcopy(learner.networks)
    if learner.average:
        networks.load_state_dict(learner.average)
    networks.eval()
    with torch.no_grad():
        batch = objective.projected(cut_tracks(held_out, held_out.tracks, 0, objective.settings.stride))
        return float(objective.prediction(networks, batch, learner.prior))

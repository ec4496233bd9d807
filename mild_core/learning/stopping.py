# SPDX-License-Identifier: Apache-2.0
"""When to stop: how many epochs trials that are not learned from call for.

A first network learns from all folds but one and is asked about that one after every epoch, until its error has
levelled off. The members then learn from all trials, for as many epochs as were best: so their learning rate falls to
zero as it should, and no trial is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy

import torch

from mild_core.learning.corpus import Corpus, cut_tracks
from mild_core.learning.objective import Objective
from mild_core.learning.snapshot import Learner

LEAST_GAIN = 0.01
"""Share by which an error must fall to be a better one: less is chance."""


def best_epoch(errors: Sequence[float]) -> int:
    """Number of epochs, from 1, after which no clearly better error came."""
    best, epochs = float("inf"), 1
    for epoch, error in enumerate(errors):
        if error < best * (1.0 - LEAST_GAIN):
            best, epochs = error, epoch + 1
    return epochs


def levelled_off(errors: Sequence[float], patience: int) -> bool:
    """Whether the best of `errors`, one for each epoch, is `patience` epochs old."""
    return len(errors) > 0 and len(errors) - best_epoch(errors) >= patience


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

# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 of MILD as one generator: an epoch of the networks under a fixed prior, then the prior by EM.

Nothing is printed or written here: the caller iterates over a report of each epoch and, as the generator's return
value, what was learned. Equal arguments give equal results on one machine and one number of threads.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from mild_core.errors import DatasetError, SetupError
from mild_core.inference.reservoir import Reservoir
from mild_core.inference.start_pose import StartPose
from mild_core.learning.data.coordinates import Coordinates, plain_coordinates, principal_coordinates
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.folds import folds_of, require_folds
from mild_core.learning.data.seeding import drawing_from
from mild_core.learning.data.trial_validity import require_valid
from mild_core.learning.data.windows import Protocol
from mild_core.learning.training.compiled_gru import compile_memories
from mild_core.learning.training.corpus import Corpus, WindowBatch, augment, corpus_of, cut_tracks
from mild_core.learning.training.epoch_search import converged, lengths, validation_error
from mild_core.learning.training.objective import Objective
from mild_core.learning.training.recogniser import Recogniser, train_recogniser
from mild_core.learning.training.reestimation import refit
from mild_core.learning.training.reservoir import fit_reservoir
from mild_core.learning.training.reservoir_trials import STRIDE
from mild_core.learning.training.settings import Augmentation, TrainingSettings
from mild_core.learning.training.snapshot import Learner, Snapshot
from mild_core.learning.training.start_pose import fit_start_pose
from mild_core.learning.training.trained import TrainedMember, TrainedModel
from mild_core.learning.training.transfer import transfer_layers
from mild_core.learning.training.vae import MemberNetworks

UNBENT = Augmentation(1, 0.0, 0.0, 2, 0.0, 0.0, 0.0)
"""Trials as recorded, as an augmentation."""

LOOKING = -1
"""Number of the members that look for the number of epochs, in what seeds their draws."""


@dataclass(frozen=True)
class EpochReport:
    """How one epoch of one member went.

    Attributes:
        member: Its number, from 0; with `doublings` the first are those that look for the number of epochs.
        members: How many there will be at most, those included.
        epoch: Its number, from 0.
        epochs: How many there will be.
        prediction: Mean error of the robot's window given the human's; see `objective.Terms` for all four.
        observed: Mean error of the human's own window.
        controlled: Mean error of the robot's own window.
        divergence: Mean divergence of both posteriors from the prior [nats].
        log_likelihood: Of the latents under the prior, by step [nats]; NaN while the prior is not re-estimated.
        snapshot: What to go on from after it.
        validation: Error of prediction on the trials held out, after the last epoch; else NaN.
    """

    member: int
    members: int
    epoch: int
    epochs: int
    prediction: float
    observed: float
    controlled: float
    divergence: float
    log_likelihood: float
    snapshot: Snapshot
    validation: float = math.nan


def train(
    demonstrations: Sequence[Demonstration],
    protocol: Protocol,
    settings: TrainingSettings,
    seed: int,
    interactions: Sequence[str] = (),
    start: Mapping[str, NDArray[Any]] | None = None,
    resume: Sequence[Snapshot] = (),
) -> Generator[EpochReport, None, TrainedModel]:
    """Train all members, one after the other.

    Args:
        demonstrations: To learn from.
        protocol: How windows are cut.
        settings: How to train.
        seed: Of all draws.
        interactions: All that the model shall know, by label; default: those demonstrated, in order.
        start: Layers of another model to start from, see `transfer_layers`.
        resume: The newest snapshot of each member that an interrupted run of the same training left, in order.

    Yields:
        A report after each epoch.

    Returns:
        What was learned.

    Raises:
        ValueError, KeyError, RuntimeError: There is no demonstration, or a snapshot is of something else.
        DatasetError: See `require_learnable`; with `doublings` there are too few to hold some out.
        SetupError: No layer of `start` fits.

    Source: Algorithm 1 of MILD.
    """
    interactions = tuple(interactions or dict.fromkeys(d.interaction for d in demonstrations))
    require_learnable(demonstrations, protocol, settings)
    corpus, members, before = corpus_of(demonstrations, protocol, interactions, settings.paired, seed), [], 0
    if settings.doublings:
        require_folds(demonstrations, interactions)
        settings, before = yield from _long_enough(demonstrations, corpus, settings, seed, start or {}, resume)
    for number in range(settings.members):
        learner, objective = _learner(corpus, settings, (seed, number), start or {}, resume[before + number :])
        for report in _epochs(corpus, objective, learner, (seed, number)):
            yield replace(report, member=before + number, members=before + settings.members)
        members.append(_trained(corpus, objective, learner, seed, number))
    beside, start_pose = _beside(demonstrations, protocol, interactions, settings, seed)
    return TrainedModel(corpus.protocol, settings, seed, interactions, tuple(members), beside, start_pose)


def _beside(
    demonstrations: Sequence[Demonstration],
    protocol: Protocol,
    interactions: Sequence[str],
    settings: TrainingSettings,
    seed: int,
) -> tuple[Reservoir | None, StartPose | None]:
    """What is learned beside the members, in closed form."""
    found = fit_reservoir(demonstrations, protocol, interactions, settings, seed)
    if found is None or not settings.start_pose:
        return (found and found[0]), None
    return found[0], fit_start_pose(demonstrations, protocol, interactions, found[1], STRIDE)


def require_learnable(demonstrations: Sequence[Demonstration], protocol: Protocol, settings: TrainingSettings) -> None:
    """Every trial must show what can be, and give the prior one step for each component.

    Raises:
        DatasetError: One does not, or no person moves in any of them.
    """
    require_valid(demonstrations)
    for demonstration in demonstrations:
        frames = len(demonstration.observed_m)
        steps = -(-protocol.windows_of(-(-frames // protocol.keep_every)) // settings.stride)
        if steps < settings.prior.components:
            thing = f"trial {demonstration.trial} ({demonstration.interaction})"
            problem = (
                f"its {frames} frames give {steps} steps, fewer than the prior's {settings.prior.components} parts"
            )
            raise DatasetError(thing, problem, "leave it out or train with fewer components or a smaller stride")


def _long_enough(
    demonstrations: Sequence[Demonstration],
    corpus: Corpus,
    settings: TrainingSettings,
    seed: int,
    start: Mapping[str, NDArray[Any]],
    resume: Sequence[Snapshot],
) -> Generator[EpochReport, None, tuple[TrainingSettings, int]]:
    """Settings with as many epochs as make one fold's error level off, and how many learners that took."""
    fold, errors = folds_of(demonstrations)[0], list[float]()
    learned = corpus_of(fold.learned, corpus.protocol, corpus.interactions, settings.paired, seed)
    held_out = corpus_of(fold.held_out, corpus.protocol, corpus.interactions)
    tried = lengths(settings.epochs, settings.doublings)
    for place, epochs in enumerate(tried):
        learner, objective = _learner(learned, replace(settings, epochs=epochs), (seed, LOOKING), start, resume[place:])
        for report in _epochs(learned, objective, learner, (seed, LOOKING), held_out):
            yield replace(report, member=place, members=len(tried) + settings.members)
        errors += learner.validation
        if converged(errors):
            return replace(settings, epochs=tried[place - 1]), place + 1
    return settings, len(tried)


def _learner(
    corpus: Corpus,
    settings: TrainingSettings,
    draws: tuple[int, int],
    start: Mapping[str, NDArray[Any]],
    resume: Sequence[Snapshot],
) -> tuple[Learner, Objective]:
    """A member before its first epoch or as the first of `resume` has it, and what it minimises."""
    question, answer = window_coordinates(corpus, settings)
    labels = len(corpus.interactions)
    with drawing_from(*draws):
        networks = MemberNetworks(settings.architecture, question.size, answer.size, labels, settings.dropout)
    compile_memories(networks)
    carried = transfer_layers(networks, start)
    if start and not carried:
        problem = "no hidden layer of it has the name and size of one that is trained here"
        raise SetupError("start_from", problem, "leave it out, or name a model with the same architecture")
    rate, decay = settings.learning_rate, settings.weight_decay
    optimiser = torch.optim.AdamW(networks.parameters(), lr=rate, weight_decay=decay, fused=True)
    learner = Learner(networks, optimiser, carried)
    if resume:
        learner.go_on_from(resume[0], settings, corpus.interactions)
    return learner, Objective(settings, question, answer, labels)


def _epochs(
    corpus: Corpus, objective: Objective, learner: Learner, draws: tuple[int, int], held_out: Corpus | None = None
) -> Iterator[EpochReport]:
    """The epochs of one learner that are not done yet; after the last it is asked about `held_out`."""
    settings, networks = objective.settings, learner.networks
    frozen = round(settings.prior.frozen_from * settings.epochs)
    for epoch in range(learner.epochs, settings.epochs):
        if epoch == settings.observed_epochs and epoch:
            networks.start_controlled_from_observed()
            learner.fitted = None
        for group in learner.optimiser.param_groups:
            group["lr"] = settings.learning_rate_in(epoch)
        with drawing_from(*draws, epoch):
            terms = _pass(learner, objective, corpus, epoch < settings.observed_epochs)
        log_likelihood = math.nan
        due = epoch % settings.prior.every == 0 or epoch == settings.observed_epochs or epoch >= frozen - 1
        if learner.fitted is None or (epoch < frozen and due):
            learner.fitted, log_likelihood = refit(networks, objective, corpus, learner.fitted)
        if settings.averaging and epoch >= frozen:
            learner.average_in(settings.averaging)
        learner.epochs, validation = epoch + 1, math.nan
        if held_out is not None and learner.epochs == settings.epochs:
            validation = validation_error(learner, objective, held_out)
            learner.validation.append(validation)
        snapshot = learner.snapshot()
        yield EpochReport(0, 0, epoch, settings.epochs, *terms, log_likelihood, snapshot, validation)


def _trained(corpus: Corpus, objective: Objective, learner: Learner, seed: int, number: int) -> TrainedMember:
    """A learner after its last epoch."""
    networks = learner.networks
    if learner.average:
        networks.load_state_dict(learner.average)
    networks.eval()
    assert learner.prior is not None  # every epoch without one ends by making it
    with drawing_from(seed, number, objective.settings.epochs):
        recogniser = _recogniser(corpus, objective.settings)
    return TrainedMember(networks, learner.prior, objective.question, objective.answer, recogniser, learner.carried)


def _recogniser(corpus: Corpus, settings: TrainingSettings) -> Recogniser | None:
    """The recogniser network, where settings have one."""
    if settings.recogniser is None:
        return None
    epochs = round(settings.recogniser.epochs * settings.epochs)
    return train_recogniser(corpus, settings.recogniser, settings.augmentation or UNBENT, epochs)


def window_coordinates(corpus: Corpus, settings: TrainingSettings) -> tuple[Coordinates, Coordinates]:
    """Coordinates of the human's and of the robot's windows, from all trials."""
    windows = cut_tracks(corpus, corpus.everything, 0, 1)
    recorded = windows.valid > 0
    architecture = settings.architecture
    return (
        _coordinates(windows.question[recorded], architecture.question_coordinates, architecture.whitening),
        _coordinates(windows.answer[recorded], architecture.answer_coordinates, 0.0),
    )


def _coordinates(windows: Tensor, count: int, whitening: float) -> Coordinates:
    return principal_coordinates(windows, count, whitening) if count else plain_coordinates(windows)


def _pass(
    learner: Learner, objective: Objective, corpus: Corpus, observed_only: bool
) -> tuple[float, float, float, float]:
    """One epoch: every trial, `copies` times, with new augmentation. Returns the mean terms."""
    settings, networks, optimiser, prior = objective.settings, learner.networks, learner.optimiser, learner.prior
    tracks, phase = corpus.drawn(1), 0
    if settings.augmentation is not None:
        tracks = augment(corpus.drawn(settings.augmentation.copies), replace(settings.augmentation, copies=1))
        phase = int(torch.randint(corpus.protocol.keep_every, ()))
    cuts = min(
        settings.gradient_stride, corpus.protocol.windows_of(tracks.observed.shape[1] // corpus.protocol.keep_every)
    )
    windows = objective.projected(
        cut_tracks(corpus, tracks, int(torch.randint(cuts, ())), settings.gradient_stride, phase)
    )
    networks.train()
    # A trial of fewer windows than that stride may have none this time.
    cut = torch.nonzero(windows.valid.any(dim=1))[:, 0]
    sums, batches = torch.zeros(4), torch.split(cut[torch.randperm(len(cut))], settings.batch_trials)
    for rows in batches:
        batch = WindowBatch(
            windows.question[rows], windows.answer[rows], windows.valid[rows], windows.label[rows], windows.first
        )
        terms = objective.terms(networks, batch, prior, observed_only)
        optimiser.zero_grad()
        terms.total(settings.weights).backward()  # type: ignore[no-untyped-call]  # torch does not type it
        nn.utils.clip_grad_norm_(networks.parameters(), settings.largest_gradient)
        optimiser.step()
        sums += torch.stack([terms.prediction, terms.observed, terms.controlled, terms.divergence]).detach()
    prediction, observed, controlled, divergence = (sums / max(len(batches), 1)).tolist()
    return prediction, observed, controlled, divergence

# SPDX-License-Identifier: Apache-2.0
"""What it helps to start from the hidden layers of another recording's networks: `./mild measure carry_over`.

Networks as shipped, one member and nothing beside it, learn every fold twice from the same seed: from nothing, and from
the hidden layers that a model of other people has. Where these people are the recording's own, as Pepper's are NuiSI's,
that model learns from the same trials. Errors are of the held-out trials, the interaction given.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.folds import FOLDS, folds_of
from mild_core.learning.datasets import recording_named
from mild_core.learning.evaluation.comparison import averaged_over_seeds, change_against
from mild_core.learning.evaluation.errors import TrialErrors, errors_of_trial, summarise
from mild_core.learning.training.algorithm import train
from mild_core.learning.training.configuration import Configuration, read_configuration
from mild_core.learning.training.learned_model import finished, learn
from mild_core.learning.training.settings import TrainingSettings
from mild_core.learning.training.vae import RUNNING

Layers = Mapping[str, NDArray[Any]]

PAIRS = {
    "yumi_buetepage_same": ("nuisi_partner_same", "nuisi_v1_partner_same"),
    "nuisi_partner_same": ("nuisi_v1_partner_same",),
    "pepper_nuisi_same": ("nuisi_partner_same",),
}
"""Configurations, and those of the models that they may start from."""

SAME_PEOPLE = {"pepper_nuisi": "nuisi"}
"""Recordings whose trials are another one's."""


def alone(configuration: Configuration) -> TrainingSettings:
    """One member, without what is learned beside it: only its layers are carried over."""
    settings = configuration.settings
    return replace(settings, members=1, reservoir=None, start_pose=False, recogniser=None)


def trials_of(configuration: Configuration) -> tuple[Demonstration, ...]:
    """The training trials of its recording."""
    recording = recording_named(configuration.dataset)
    return recording.read(recording.default_path()).train


def layers_of(configuration: Configuration, trials: Sequence[Demonstration], seed: int) -> Layers:
    """The layers of a model that learned these trials."""
    protocol = recording_named(configuration.dataset).protocols[configuration.protocol]
    networks = finished(train(trials, protocol, alone(configuration), seed)).members[0].networks
    chains = {name: getattr(networks, name) for name in RUNNING}
    return {f"{name}.{key}": array for name, chain in chains.items() if chain for key, array in chain.arrays().items()}


def sources_of(target: Configuration, name: str, seed: int, folds: int) -> list[Layers]:
    """What to start from, for each fold: learned from people who are not held out there."""
    source = read_configuration(name)
    trials = trials_of(source)
    if SAME_PEOPLE.get(target.dataset) != source.dataset:
        return [layers_of(source, trials, seed)] * folds
    return [layers_of(source, fold.learned, seed) for fold in folds_of(trials)[:folds]]


def errors_from(target: Configuration, starts: Sequence[Layers | None], seed: int) -> list[TrialErrors]:
    """Errors of the trials of as many folds, each by the network that did not learn from it."""
    protocol = recording_named(target.dataset).protocols[target.protocol]
    found = []
    for fold, start in zip(folds_of(trials_of(target))[: len(starts)], starts, strict=True):
        predictor = learn(fold.learned, protocol, alone(target), seed, start)
        found += [errors_of_trial(trial, protocol, predictor.predict(trial)) for trial in fold.held_out]
    return found


def measure(name: str, seeds: int, folds: int) -> None:
    """One configuration, from nothing and from each model that it may start from."""
    target = read_configuration(name)
    recording = recording_named(target.dataset)
    errors: dict[str, list[list[TrialErrors]]] = {}
    for seed in range(seeds):
        starts: dict[str, Sequence[Layers | None]] = {"nothing": [None] * folds}
        starts |= {source: sources_of(target, source, seed, folds) for source in PAIRS[name]}
        for source, layers in starts.items():
            begin = time.process_time()
            errors.setdefault(source, []).append(errors_from(target, layers, seed))
            macro = summarise(errors[source][-1], recording.interactions).macro_mse
            print(f"{name}, seed {seed}, from {source}: {macro:.4f} ({time.process_time() - begin:.0f} s)", flush=True)
    for source, runs in errors.items():
        macros = [summarise(run, recording.interactions).macro_mse or np.nan for run in runs]
        line = f"{name} from {source}: {np.mean(macros):.4f} {recording.unit.squared_shown}"
        if source != "nothing":
            change = change_against(averaged_over_seeds(runs), averaged_over_seeds(errors["nothing"]))
            low, high = change.interval
            line += f", {change.change:+.1%} ({low:+.1%} to {high:+.1%}, p {change.p_value:.3f})"
        print(line, flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("configurations", nargs="*", default=list(PAIRS), help=f"default: {', '.join(PAIRS)}")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--folds", type=int, choices=range(1, FOLDS + 1), default=FOLDS, help="the first so many")
    given = parser.parse_args()
    torch.set_num_threads(1)
    for name in given.configurations:
        if name not in PAIRS:
            parser.error(f"there is no start for '{name}', only for {', '.join(PAIRS)}")
        measure(name, given.seeds, given.folds)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""How much processor time learning takes, beside the same in plain torch loops: `./mild measure em_iteration`.

One iteration of expectation maximisation of realistic size: 38 demonstrations of 600 frames, a 10-D latent, 10
components, durations up to 100 frames. With `--epoch` also an epoch of one network of the live model; with `--training`
that whole model, all networks of one seed, from all trials.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from time import process_time

import numpy as np
import torch

from mild_core.inference.priors import HSMM
from mild_core.inference.priors.demonstrations import latent_frames, log_emissions
from mild_core.inference.priors.prior import FitSettings
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol
from mild_core.learning.datasets import recording_named
from mild_core.learning.training.algorithm import train
from mild_core.learning.training.configuration import Configuration, read_configuration
from mild_core.learning.training.learned_model import learn

DEMONSTRATIONS, FRAMES, LATENT, COMPONENTS, LONGEST = 38, 600, 10, 10, 100
MORE = 10
LOOPED = 2
"""Demonstrations that the loops go through: what they take is multiplied, for they would take a minute."""


def made_latents() -> list[np.ndarray]:
    """Demonstrations that go through the components one after the other."""
    rng = np.random.default_rng(0)
    means = rng.normal(0.0, 3.0, (COMPONENTS, LATENT))
    path = np.arange(FRAMES) * COMPONENTS // FRAMES
    return [means[path] + rng.normal(size=(FRAMES, LATENT)) for _ in range(DEMONSTRATIONS)]


def made_prior(latents: list[np.ndarray]) -> HSMM:
    """Components of the demonstrations' equal parts, every duration equally likely."""
    prior = HSMM.from_demonstrations(latents, COMPONENTS, LATENT // 2)
    durations = np.full((COMPONENTS, LONGEST), 1.0 / LONGEST)
    return HSMM.from_arrays({**prior.to_arrays(), "durations": durations}, LATENT // 2)


def measure(latents: list[np.ndarray], prior: HSMM, repeats: int = 15) -> np.ndarray:
    """Milliseconds of an iteration, expectation and maximisation: what `MORE` more of them cost a fit, each time."""
    few, many = (FitSettings(iterations=count, tolerance=-np.inf) for count in (1, 1 + MORE))
    prior.fit(latents, few)  # compiles
    milliseconds = []
    for _ in range(repeats):
        start = process_time()
        prior.fit(latents, few)
        middle = process_time()
        prior.fit(latents, many)
        milliseconds.append(1e3 * (process_time() - middle - (middle - start)) / MORE)
    return np.array(milliseconds)


def looped(latents: list[np.ndarray], prior: HSMM) -> tuple[float, float]:
    """The same expectation frame by frame in torch.

    Returns:
        Milliseconds for all demonstrations, and how far its log-likelihood is from ours, per frame.
    """
    torch.set_num_threads(1)
    some = latents[:LOOPED]
    emissions = torch.tensor(log_emissions(prior.components, latent_frames(some))).reshape(LOOPED, FRAMES, COMPONENTS)
    chain = [torch.tensor(a) for a in (prior.chain.initial, prior.chain.transitions, prior.chain.durations)]
    start = process_time()
    total = sum(_expect(one, *chain) for one in emissions)
    seconds = process_time() - start
    return 1e3 * seconds * DEMONSTRATIONS / LOOPED, abs(total - prior.expect(some).log_likelihood) / (LOOPED * FRAMES)


def _expect(
    emissions: torch.Tensor, initial: torch.Tensor, transitions: torch.Tensor, durations: torch.Tensor
) -> float:
    """Forward and backward over one demonstration (T, K), with expected events; returns the log-likelihood."""
    total, scales, forward = 0.0, [], []
    densities = torch.exp(emissions - emissions.max(dim=1, keepdim=True).values)
    for t, density in enumerate(densities):
        if t == 0:
            now = initial[:, None] * durations
        else:
            left = torch.nn.functional.pad(forward[-1][:, 1:], (0, 1))
            now = left + durations * (forward[-1][:, 0] @ transitions)[:, None]
        now = now * density[:, None]
        scales.append(now.sum())
        forward.append(now / scales[-1])
        total += float(torch.log(scales[-1]) + emissions[t].max())
    backward = torch.ones_like(durations)
    shares, changes, lengths = [forward[-1].sum(dim=1)], torch.zeros_like(transitions), torch.zeros_like(durations)
    for t in range(len(emissions) - 1, 0, -1):
        ahead = densities[t][:, None] * backward / scales[t]
        rest = (durations * ahead).sum(dim=1)
        entering = forward[t - 1][:, 0] @ transitions
        lengths += entering[:, None] * durations * ahead
        changes += forward[t - 1][:, :1] * transitions * rest
        backward = torch.cat([(transitions @ rest)[:, None], ahead[:, :-1]], dim=1)
        shares.append((forward[t - 1] * backward).sum(dim=1))
    return total


def live_model() -> tuple[tuple[Demonstration, ...], Protocol, Configuration]:
    """All trials of the YuMi recording, and how the model that moves it live is trained."""
    torch.set_num_threads(1)
    asked = read_configuration("yumi_buetepage_ahead")
    recording = recording_named(asked.dataset)
    return recording.read(recording.default_path()).train, recording.protocols[asked.protocol], asked


def measure_epochs(count: int = 8) -> np.ndarray:
    """Seconds of each epoch of a network, after a first one that compiles; every other re-estimates the priors."""
    trials, protocol, asked = live_model()
    epochs, seconds = train(trials, protocol, replace(asked.settings, members=1), asked.seed), []
    next(epochs)
    for _ in range(count):
        start = process_time()
        next(epochs)
        seconds.append(process_time() - start)
    return np.array(seconds)


def measure_training() -> float:
    """Seconds of processor time that the model takes as it is shipped."""
    trials, protocol, asked = live_model()
    start = process_time()
    learn(trials, protocol, asked.settings, asked.seed)
    return process_time() - start


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--epoch", action="store_true", help="also an epoch of one network of the live model")
    parser.add_argument("--training", action="store_true", help="also the training of the whole live model")
    given = parser.parse_args()
    demonstrations = made_latents()
    hsmm = made_prior(demonstrations)
    times = measure(demonstrations, hsmm)
    print(f"one EM iteration: median {np.median(times):.1f} ms, best {times.min():.1f} ms of {len(times)}")
    milliseconds, apart = looped(demonstrations, hsmm)
    print(f"its expectation alone in torch loops: {milliseconds:.0f} ms; log-likelihoods {apart:.1e} apart per frame")
    if given.epoch:
        times = 1e3 * measure_epochs()
        print(f"one epoch of a network: median {np.median(times):.0f} ms, best {times.min():.0f} ms of {len(times)}")
    if given.training:
        print(f"a whole model: {measure_training():.0f} s")


if __name__ == "__main__":
    main()

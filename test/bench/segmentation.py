# SPDX-License-Identifier: Apache-2.0
"""One HSMM over all interactions beside one for each: what it takes for what, where it cuts, what it predicts.

`./mild measure segmentation [--dataset NAME] [--folds N] [--bags FOLDER]` learns the paper's model without a fold and
puts the one HSMM upon its latents, started in three ways. The fold's trials are then joined to one long recording, and
it cuts and labels that; the same recording is cut at rest, as `mild demonstrations` does, and the HSMMs of the single
interactions label what was cut out. The bags of the checkout are of people that no model learned from, each alone.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2  # type: ignore[import-untyped]  # scipy brings no types
from scipy.signal import find_peaks  # type: ignore[import-untyped]

from mild_core.inference.gaussian import Gaussian
from mild_core.inference.priors.demonstrations import estimate_components, latent_frames, log_emissions
from mild_core.inference.priors.filtering import UNDERFLOW
from mild_core.inference.priors.hsmm import HSMM
from mild_core.inference.priors.prior import FitSettings, Prior
from mild_core.inference.priors.semi_markov_chain import (
    ChainCounts,
    SemiMarkovChain,
    expect,
    normalise_rows,
    run_filter,
)
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.folds import FOLDS, Fold, folds_of
from mild_core.learning.data.segmentation import RestToRest, cut_at_rest
from mild_core.learning.data.windows import ONSET_M, REST_FRAMES, Protocol, cut
from mild_core.learning.datasets import DATASETS, recording_named
from mild_core.learning.evaluation.errors import TrialErrors, errors_of_trial, summarise
from mild_core.learning.training.algorithm import train
from mild_core.learning.training.corpus import corpus_of, cut_tracks
from mild_core.learning.training.learned_model import finished
from mild_core.learning.training.presets import PAPER
from mild_core.learning.training.trained import TrainedMember
from mild_core.shapes import FloatArray

Numbers = NDArray[np.intp]

BLEND_S = 0.5
"""Between two joined trials both agents go from the last pose of the one to the first of the next."""

ORDERS = 2
"""Long recordings of the same trials in other orders, to learn from and to cut."""

CROSSING = 0.01
"""Share of every component's ends that lead to the start of an interaction, any of them; of the last one's all."""

LEAST_S = 1.0
"""No shorter segment: what is shorter belongs to the one before, as `RestToRest.least_s` has it."""

CHANGE_S = 0.4
"""Change points: the latents of so long before and after differ most."""

NEAR_S = 1.0
"""A boundary this near to the rest between two interactions is right."""

FIT = FitSettings(iterations=10)


@dataclass(frozen=True, eq=False)
class Latents:
    """N windows of a recording.

    Attributes:
        observed: (N, Q) posterior means.
        widening: (N, Q, Q) posterior covariances.
        joint: (N, Z) with those of the other agent.
    """

    observed: FloatArray
    widening: FloatArray
    joint: FloatArray


@dataclass(frozen=True, eq=False)
class Joined:
    """Trials one after the other.

    Attributes:
        recording: As one.
        interaction: (T,) number of the interaction that goes on at each frame; -1 while the person rests or goes over.
        rests: First and last frame of each rest that divides two trials.
    """

    recording: Demonstration
    interaction: Numbers
    rests: tuple[tuple[int, int], ...]


class OneHsmm(HSMM):
    """An HSMM whose transitions before any count are those that it had, instead of one component after the other."""

    @staticmethod
    def estimate_chain(previous: SemiMarkovChain, counts: ChainCounts, settings: FitSettings) -> SemiMarkovChain:
        """See `Prior`."""
        estimated = HSMM.estimate_chain(previous, counts, settings)
        transitions = counts.transitions + settings.pseudo_count * previous.transitions
        return replace(estimated, transitions=normalise_rows(transitions, previous.transitions))


@dataclass(frozen=True, eq=False)
class Named:
    """A prior over all interactions, and which of these each of its components is: (K,)."""

    prior: Prior
    interaction: Numbers


def encode(member: TrainedMember, trial: Demonstration, protocol: Protocol) -> Latents:
    """Every window of a recording in the latent spaces of both agents."""
    corpus = corpus_of([trial], protocol, (trial.interaction,))
    batch = cut_tracks(corpus, corpus.tracks, 0, 1)
    with torch.no_grad():
        seen = member.networks.observe({"window": member.question.project(batch.question[0])})
        other = member.networks.counterpart(member.answer.project(batch.answer[0]))
    observed = seen.mean.double().numpy()
    joint = np.concatenate([observed, other.mean.double().numpy()], axis=1)
    return Latents(observed, seen.covariance.double().numpy(), joint)


def moving(trial: Demonstration) -> slice:
    """From the first to the last frame in which the hand is away from where it was at the trial's start and end."""
    hand, frames = trial.observed_m[:, -1], trial.frames
    away = [
        np.linalg.norm(hand - rest.mean(axis=0), axis=1) > ONSET_M for rest in (hand[:REST_FRAMES], hand[-REST_FRAMES:])
    ]
    return slice(int(away[0].argmax()), frames - int(away[1][::-1].argmax()))


def join(trials: Sequence[Demonstration], interactions: Sequence[str]) -> Joined:
    """One long recording of trials in that order."""
    rate_hz = trials[0].rate_hz
    share = np.arange(1, round(BLEND_S * rate_hz)) / round(BLEND_S * rate_hz)
    share = 3.0 * share**2 - 2.0 * share**3
    observed, controlled, interaction, ends = (
        list[FloatArray](),
        list[FloatArray](),
        list[Numbers](),
        list[tuple[int, int]](),
    )
    for trial in trials:
        if observed:
            for parts, following in ((observed, trial.observed_m), (controlled, trial.controlled)):
                before = parts[-1][-1]
                parts.append(before + np.multiply.outer(share, following[0] - before))
            interaction.append(np.full(len(share), -1))
        first, active = sum(map(len, observed)), moving(trial)
        observed.append(trial.observed_m)
        controlled.append(trial.controlled)
        label = np.full(trial.frames, -1)
        label[active] = list(interactions).index(trial.interaction)
        interaction.append(label)
        ends.append((first + active.start, first + active.stop))
    rests = tuple((before[1], after[0]) for before, after in pairwise(ends))
    moved = np.concatenate(controlled)
    recording = replace(trials[0], observed_m=np.concatenate(observed), controlled=moved, active=np.ones(len(moved)))
    return Joined(recording, np.concatenate(interaction), rests)


def orders(trials: Sequence[Demonstration], interactions: Sequence[str], seed: int) -> list[Joined]:
    """The trials joined in several orders."""
    rng = np.random.default_rng(seed)
    return [join([trials[i] for i in rng.permutation(len(trials))], interactions) for _ in range(ORDERS)]


def stacked(separate: Sequence[Prior], crossing: float) -> HSMM:
    """The HSMMs of all interactions side by side.

    Args:
        separate: One for each interaction.
        crossing: See `CROSSING`; 0 leaves every interaction to itself: likelihoods alone weigh them.
    """
    parts = [prior.chain for prior in separate]
    longest, total = max(part.longest for part in parts), sum(part.components for part in parts)
    start = np.concatenate([part.initial for part in parts]) / len(parts)
    transitions, first = np.zeros((total, total)), 0
    for part in parts:
        block = slice(first, first + part.components)
        transitions[block, block] = part.transitions
        first = block.stop
        share = np.full((part.components, 1), crossing)
        share[-1] = 1.0 if crossing else 0.0
        transitions[block] = (1.0 - share) * transitions[block] + share * start
    np.fill_diagonal(transitions, 0.0)
    durations = np.concatenate([np.pad(part.durations, ((0, 0), (0, longest - part.longest))) for part in parts])
    gaussians = Gaussian(
        np.concatenate([prior.components.mean for prior in separate]),
        np.concatenate([prior.components.covariance for prior in separate]),
    )
    chain = SemiMarkovChain(start, transitions / transitions.sum(axis=1, keepdims=True), durations)
    return OneHsmm(gaussians, chain, np.concatenate([prior.phases for prior in separate]), separate[0].observed_size)


def by_change_points(recordings: Sequence[FloatArray], count: int, size: int, rate_hz: float, seed: int) -> HSMM:
    """From long recordings alone: cut where the latents change most, what is alike between cuts is one component.

    Args:
        recordings: Joint latents, each (N, Z).
        count: Components.
        size: Of the observed agent's latent.
        rate_hz: Of the windows.
        seed: Of the clusters' first centres.
    """
    width = max(2, round(CHANGE_S * rate_hz))
    cuts = []
    for latents in recordings:
        sums = np.cumsum(np.pad(latents, ((1, 0), (0, 0))), axis=0)
        means = (sums[width:] - sums[:-width]) / width
        change = np.linalg.norm((means[width:] - means[:-width]) / latents.std(axis=0), axis=1)
        peaks = find_peaks(change, distance=width)[0] + width
        cuts.append(np.array([0, *peaks, len(latents)]))
    spans = [(latents, a, b) for latents, ends in zip(recordings, cuts, strict=True) for a, b in pairwise(ends)]
    scale = np.concatenate(recordings).std(axis=0)
    places = np.array([latents[a:b].mean(axis=0) / scale for latents, a, b in spans])
    _, cluster = kmeans2(places, count, minit="++", seed=seed)
    lengths = np.array([b - a for _, a, b in spans])
    assigned = np.repeat(cluster, lengths)
    transitions, first = np.full((count, count), 1e-3), 0
    for ends in cuts:
        mine = cluster[first : first + len(ends) - 1]
        np.add.at(transitions, (mine[:-1], mine[1:]), 1.0)
        first += len(mine)
    np.fill_diagonal(transitions, 0.0)
    durations = np.zeros((count, 2 * int(lengths.max())))
    np.add.at(durations, (cluster, lengths - 1), 1.0)
    uniform = np.full_like(durations, 1.0 / durations.shape[1])
    frames = latent_frames(recordings)
    gaussians = estimate_components(None, np.eye(count)[assigned], frames, FIT.covariance_fraction)
    chain = SemiMarkovChain(
        np.full(count, 1.0 / count),
        normalise_rows(transitions, transitions),
        0.9 * normalise_rows(durations, uniform) + 0.1 * uniform,
    )
    return OneHsmm(gaussians, chain, np.full(count, 0.5), size)


def responsibilities(prior: Prior, latents: FloatArray) -> FloatArray:
    """(N, K) posterior of the components, all windows of a recording known; of the person's latents alone too."""
    size = latents.shape[1]
    components = Gaussian(prior.components.mean[:, :size], prior.components.covariance[:, :size, :size])
    frames = latent_frames([latents])
    return expect(prior.chain, log_emissions(components, frames), frames.lengths).responsibilities


def naming(prior: Prior, latents: Sequence[FloatArray], truth: Sequence[Numbers], count: int) -> Named:
    """Which interaction each component stood for most while people moved, in what was learned from."""
    shares = np.zeros((prior.chain.components, count))
    for one, labels in zip(latents, truth, strict=True):
        weights = responsibilities(prior, one)
        for label in range(count):
            shares[:, label] += weights[labels == label].sum(axis=0)
    return Named(prior, shares.argmax(axis=1))


def by_interaction(named: Named, weights: FloatArray, count: int) -> FloatArray:
    """(N, P) posterior of the interactions, of (N, K) of the components."""
    posterior: FloatArray = weights @ np.eye(count)[named.interaction]
    return posterior


def segments(posterior: FloatArray, least: int) -> tuple[Numbers, Numbers]:
    """(N,) label of each window, short segments given to the one before, and where these labels change."""
    label = posterior.argmax(axis=1)
    ends = np.flatnonzero(np.diff(label)) + 1
    for a, b in zip(ends, [*ends[1:], len(label)], strict=False):
        if b - a < least:
            label[a:b] = label[a - 1]
    return label, np.flatnonzero(np.diff(label)) + 1


def boundaries(named: Named, weights: FloatArray, least: int, count: int) -> Numbers:
    """Where one interaction ends and the next begins: another one, or its phase falls back by more than a half."""
    _, cuts = segments(by_interaction(named, weights, count), least)
    phase = named.prior.phases[weights.argmax(axis=1)]
    again = np.flatnonzero(np.diff(phase) < -0.5) + 1
    found: list[int] = []
    for place in sorted({*cuts.tolist(), *again.tolist()}):
        if not found or place - found[-1] >= least:
            found.append(place)
    return np.array(found, dtype=np.intp)


def predict(member: TrainedMember, prior: Prior, latents: Latents, shape: tuple[int, ...]) -> FloatArray:
    """The other agent's windows from the person's alone, as the run time does it: filter, condition, mix, decode."""
    seen = [prior.explain(z, w) for z, w in zip(latents.observed, latents.widening, strict=True)]
    belief = run_filter(prior.chain, np.array([one.log_emissions for one in seen]), lowest=UNDERFLOW).weights
    means = np.array([one.conditioned.mean for one in seen])
    expected = torch.from_numpy((belief[..., None] * means).sum(axis=1)).float()
    with torch.no_grad():
        answered = member.answer.restore(member.networks.answer({}, expected))
    return answered.double().numpy().reshape(shape)


@dataclass(eq=False)
class Figures:
    """What was found, by kind of prior: values by what they are of, and errors of predictions."""

    values: dict[str, dict[str, list[float]]] = field(default_factory=lambda: defaultdict(lambda: defaultdict(list)))
    errors: dict[str, list[TrialErrors]] = field(default_factory=lambda: defaultdict(list))

    def add(self, kind: str, what: str, values: object) -> None:
        """Add one value or several."""
        self.values[kind][what] += np.atleast_1d(np.asarray(values, dtype=float)).tolist()


def purity(weights: FloatArray, labels: Numbers, count: int) -> float:
    """Share of the frames with a label that belong to the interaction which their component holds most of."""
    shares = np.array([weights[labels == label].sum(axis=0) for label in range(count)])
    return float(shares.max(axis=0).sum() / shares.sum())


def judge_boundaries(figures: Figures, kind: str, found_s: FloatArray, rests_s: FloatArray) -> None:
    """How far the nearest boundary is outside of each rest between two trials, and how many are wrong."""
    outside = np.maximum(np.maximum(rests_s[:, :1] - found_s, found_s - rests_s[:, 1:]), 0.0)  # (rests, boundaries)
    nearest = outside.min(axis=1) if len(found_s) else np.full(len(rests_s), np.inf)
    figures.add(kind, "outside_s", nearest)
    figures.add(kind, "found", nearest <= NEAR_S)
    figures.add(kind, "wanted", (outside.min(axis=0) <= NEAR_S) if len(found_s) else [])


def label_cuts(
    figures: Figures,
    joined: Joined,
    latents: Latents,
    posteriors: Mapping[tuple[str, str], FloatArray],
    separate: Sequence[Prior],
    shift: int,
) -> None:
    """The movements that are cut out at rest, labelled by each kind of prior: by both agents, by the person alone."""
    one, count = joined.recording, len(separate)
    times_s = np.arange(one.frames) / one.rate_hz
    cuts = cut_at_rest(one.observed_m, one.controlled, times_s, RestToRest())
    trials = [part for part in cuts.segments if not part.fault]
    ends = np.array(sorted({edge / one.rate_hz for part in trials for edge in (part.begin, part.end)}))
    judge_boundaries(figures, "cut at rest", ends, np.array(joined.rests) / one.rate_hz)
    last = len(latents.joint)
    for part in trials:
        true = np.bincount(joined.interaction[part.onset : part.back] + 1, minlength=count + 1)[1:]
        if not true.any():
            continue
        span = slice(max(0, part.begin - shift), min(last, max(part.end - shift, 1)))
        for who, values in (("both", latents.joint), ("person", latents.observed)):
            likely = [likelihood(prior, values[span]) for prior in separate]
            figures.add("one for each", f"label by {who}", float(np.argmax(likely) == true.argmax()))
            for (kind, by), posterior in posteriors.items():
                if by == who:
                    label = posterior[span].sum(axis=0).argmax()
                    figures.add(kind, f"label by {who}", float(label == true.argmax()))


def likelihood(prior: Prior, latents: FloatArray) -> float:
    """Log-likelihood of a stretch of latents; of the person's alone too."""
    size = latents.shape[1]
    components = Gaussian(prior.components.mean[:, :size], prior.components.covariance[:, :size, :size])
    frames = latent_frames([latents])
    return expect(prior.chain, log_emissions(components, frames), frames.lengths).log_likelihood


def one_hsmms(
    member: TrainedMember, fold: Fold, protocol: Protocol, interactions: Sequence[str], seed: int
) -> dict[str, Named]:
    """One HSMM over all interactions, started in three ways and refined alike, without a label, on long recordings."""
    separate, count = member.prior.priors, len(interactions)
    long = orders(fold.learned, interactions, seed)
    latents = [encode(member, one.recording, protocol).joint for one in long]
    shift = protocol.window // 2
    truth = [one.interaction[shift : shift + len(z)] for one, z in zip(long, latents, strict=True)]
    components, size = sum(prior.chain.components for prior in separate), separate[0].observed_size
    trials = [encode(member, trial, protocol).joint for trial in fold.learned]
    starts: dict[str, HSMM] = {
        "one, from those for each": stacked(separate, CROSSING),
        "one, from change points": by_change_points(
            latents, components, size, fold.learned[0].rate_hz / protocol.keep_every, seed
        ),
        "one, from equal parts": HSMM.from_demonstrations(trials, components, size, FIT),
    }
    return {kind: naming(start.fit(latents, FIT).prior, latents, truth, count) for kind, start in starts.items()} | {
        "one, those for each as they are": naming(starts["one, from those for each"], latents, truth, count)
    }


def measure_fold(
    figures: Figures, member: TrainedMember, fold: Fold, protocol: Protocol, interactions: Sequence[str], seed: int
) -> dict[str, Named]:
    """Everything about one fold; returns its priors over all interactions."""
    separate, count = member.prior.priors, len(interactions)
    kinds = one_hsmms(member, fold, protocol, interactions, seed)
    shift, least = protocol.window // 2, round(LEAST_S * fold.learned[0].rate_hz)
    for joined in orders(fold.held_out, interactions, seed + 1):
        latents = encode(member, joined.recording, protocol)
        truth = joined.interaction[shift : shift + len(latents.joint)]
        active = truth >= 0
        rests_s = np.array(joined.rests) / joined.recording.rate_hz
        posteriors = {}
        for kind, named in kinds.items():
            weights = responsibilities(named.prior, latents.joint)
            figures.add(kind, "purity", purity(weights[active], truth[active], count))
            found = boundaries(named, weights, least, count)
            judge_boundaries(figures, kind, (found + shift) / joined.recording.rate_hz, rests_s)
            for who, values in (("both", weights), ("person", responsibilities(named.prior, latents.observed))):
                posteriors[kind, who] = by_interaction(named, values, count)
                label, _ = segments(posteriors[kind, who], least)
                figures.add(kind, f"frames by {who}", (label == truth)[active].mean())
        label_cuts(figures, joined, latents, posteriors, separate, shift)
    alone = {"one for each, recognised": stacked(separate, 0.0), **{kind: named.prior for kind, named in kinds.items()}}
    for trial in fold.held_out:
        latents, shape = encode(member, trial, protocol), cut(trial, protocol).controlled.shape
        given = separate[list(interactions).index(trial.interaction)]
        for kind, prior in ({"one for each": given} | alone).items():
            figures.errors[kind].append(errors_of_trial(trial, protocol, predict(member, prior, latents, shape)))
    return kinds


def measure_bags(
    figures: Figures,
    member: TrainedMember,
    kinds: Mapping[str, Named],
    like: Demonstration,
    protocol: Protocol,
    bags: Path,
    interactions: Sequence[str],
) -> None:
    """Whole bags, the person alone: which interaction is each taken for while the hand is away."""
    from mild_ros.command_line.cutting import cut_bag
    from mild_ros.demonstrations.settings import CutParameters, DemonstrationSettings, RobotParameters

    settings = DemonstrationSettings(robot=RobotParameters("yumi"), cut=CutParameters(rate_hz=like.rate_hz))
    count, shift = len(interactions), protocol.window // 2
    for label, name in enumerate(interactions):
        path = bags / {"waving": "hand_wave"}.get(name, name)
        if not path.is_dir():
            continue
        bag = cut_bag(path, name, settings, False, lambda: None)
        still = np.broadcast_to(like.controlled[0], (len(bag.arm_m), *like.controlled.shape[1:]))
        trial = replace(like, observed_m=bag.arm_m, controlled=still, active=np.ones(len(still)))
        observed, active = encode(member, trial, protocol).observed, moving(trial)
        span = slice(max(0, active.start - shift), max(active.stop - shift, 1))
        likely = [likelihood(prior, observed[span]) for prior in member.prior.priors]
        figures.add("one for each", "bags", float(np.argmax(likely) == label))
        for kind, named in kinds.items():
            posterior = by_interaction(named, responsibilities(named.prior, observed), count)[span]
            figures.add(kind, "bags", float(posterior.sum(axis=0).argmax() == label))


def show(figures: Figures, interactions: Sequence[str], scale: str) -> None:
    """All figures, a line for each kind of prior."""
    for kind in dict.fromkeys([*figures.values, *figures.errors]):
        values, parts = figures.values[kind], []
        for what in ("purity", "frames by both", "frames by person", "label by both", "label by person", "bags"):
            if values[what]:
                parts.append(f"{what} {np.mean(values[what]):.2f}")
        if values["outside_s"]:
            outside = np.array(values["outside_s"])
            parts.append(
                f"boundaries found {np.mean(values['found']):.2f}, of its own right {np.mean(values['wanted']):.2f}, "
                f"outside the rest by {outside[np.isfinite(outside)].mean():.2f} s"
            )
        if figures.errors[kind]:
            errors = summarise(figures.errors[kind], interactions)
            low, high = errors.macro_interval or (np.nan, np.nan)
            parts.append(f"error {errors.macro_mse:.4f} ({low:.4f} to {high:.4f}) {scale}")
        print(f"{kind}: {'; '.join(parts)}", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--dataset", default="buetepage_hr", choices=sorted(DATASETS), help="what is learned from and cut"
    )
    parser.add_argument("--folds", type=int, default=FOLDS, help="of four, from the first on")
    parser.add_argument("--epochs", type=int, default=PAPER.epochs, help="of the paper's model")
    parser.add_argument("--bags", type=Path, default=Path("bags"), help="folder of the bags")
    given = parser.parse_args()
    torch.set_num_threads(1)
    recording = recording_named(given.dataset)
    trials, protocol = recording.read(recording.default_path()).train, recording.protocols["same"]
    figures = Figures()
    for seed, fold in enumerate(folds_of(trials)[: given.folds]):
        learned = finished(
            train(fold.learned, protocol, replace(PAPER, epochs=given.epochs), seed, recording.interactions)
        )
        kinds = measure_fold(figures, learned.members[0], fold, protocol, recording.interactions, seed)
        measure_bags(figures, learned.members[0], kinds, trials[0], protocol, given.bags, recording.interactions)
        print(f"{seed + 1} of {given.folds} folds", flush=True)
        show(figures, recording.interactions, recording.unit.squared_shown)


if __name__ == "__main__":
    main()

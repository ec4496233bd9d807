# SPDX-License-Identifier: Apache-2.0
"""One member of a model: its networks and its priors, and their prediction for one window, given the interaction.

A member has one structure, of which the context, the residual and the recogniser may be missing:

    context = GRU(window, label)                  remembers from window to window
    latent = posterior(encoder(context, window))
    belief = filter(prior, latent);  controlled = sum of belief times each component conditioned on the latent
    motion = decoder(controlled + residual(context, window, label), label)

Both halves of a step are one compiled function each: `observe_window`, `generate_window`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mild_core.compiled import compiled
from mild_core.inference.mixing import classify, posterior, propagate_covariance
from mild_core.inference.networks import Float32Array, Network, run_layers
from mild_core.inference.priors.filtering import UNDERFLOW, filter_frames, observe_frame
from mild_core.inference.priors.prior import Prior
from mild_core.shapes import FloatArray, read_only

NEVER_SEEN = 2.0
"""Out-of-distribution score, at least, of a frame at which every density underflows."""

Layers = tuple[NDArray[np.int64], Float32Array]
"""Program and parameters of a `Network`, as the compiled functions take them; an absent one has no layers."""

ABSENT: Layers = (np.zeros((0, 6), dtype=np.int64), np.zeros(0, dtype=np.float32))

PriorParts = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Of a prior: means (K, Z), covariances (K, Z, Z), initial (K,), transitions (K, K), durations (K, D)."""


class Observed(NamedTuple):
    """What `observe_window` found.

    Attributes:
        window: (W D,) the features.
        context: What the context network says, empty without one.
        context_memory: New memory of its cells.
        latent: (Q,) mean of the observed latent.
        memory: (K, D) new memory of the chain.
        weights: (K,) belief over components.
        log_likelihood: Of this frame given those before.
        means: (K, C) what each component expects of the controlled latent.
        covariances: (K, C, C).
        score: Out of distribution; NaN when a feature is not finite, and then nothing else holds.
    """

    window: Float32Array
    context: Float32Array
    context_memory: Float32Array
    latent: FloatArray
    memory: FloatArray
    weights: FloatArray
    log_likelihood: float
    means: FloatArray
    covariances: FloatArray
    score: float


@dataclass(frozen=True, eq=False)
class Member:
    """Encoder, priors and decoder that were trained together.

    Attributes:
        networks: By name, see `manifest.NETWORKS`.
        priors: One per interaction.
        latent_radius: (P,) Mahalanobis distance from the nearest component that the interaction's own windows hardly
            ever exceed.
        operators: (P, K, N N, C C) see `mixing.propagate_covariance`.
    """

    networks: Mapping[str, Network]
    priors: tuple[Prior, ...]
    latent_radius: FloatArray
    operators: FloatArray


@dataclass(frozen=True, eq=False)
class MemberState:
    """What one copy of a member remembers.

    Attributes:
        context: Memory of the context network's cells.
        memory: (K, D) belief over components and remaining time.
    """

    context: Float32Array
    memory: FloatArray


@dataclass(frozen=True, eq=False)
class Generated:
    """What a member expects the controlled agent to do.

    Attributes:
        motion: (W, N) the decoded window.
        covariance: (N, N) of a frame's values, averaged over the window.
        weights: (K,) belief over the components.
        phase: Expected progress by that belief, 0 to 1.
    """

    motion: FloatArray
    covariance: FloatArray
    weights: FloatArray
    phase: float


@dataclass(frozen=True, eq=False)
class CompiledMember:
    """A member conditioned on one interaction, laid out for the compiled step.

    Attributes:
        member: Which one.
        label: (P,) one for the interaction, zero for the others.
        phases: (K,) of its prior.
        operators: (K, N N, C C) of its prior, see `mixing.propagate_covariance`.
        radius: See `Member.latent_radius`.
        residual_covariance: (N, N) of the model.
        prior: Its parts.
        context: Networks, each its `Layers`.
        encoder: The same.
        residual: The same.
        decoder: The same.
        recogniser: The same.
    """

    member: Member
    label: Float32Array
    phases: FloatArray
    operators: FloatArray
    radius: float
    residual_covariance: FloatArray
    prior: PriorParts
    context: Layers
    encoder: Layers
    residual: Layers
    decoder: Layers
    recogniser: Layers

    def init(self) -> MemberState:
        """Nothing seen yet."""
        context = self.member.networks.get("context")
        memory = context.first_memory() if context else np.zeros(0, dtype=np.float32)
        memory.flags.writeable = False
        return MemberState(memory, read_only(np.zeros(self.prior[4].shape)))

    def observe(self, state: MemberState, features: FloatArray, missed: int) -> Observed:
        """Encode one window and move the belief on.

        Args:
            state: Before it.
            features: (W, D).
            missed: Steps of the chain that went by unseen; -1 at the very first.

        Returns:
            What was found; its score is NaN when a feature is not finite, and then nothing else holds.
        """
        found = Observed(
            *observe_window(
                self.context, self.encoder, self.prior, self.radius, state.context, state.memory, features, self.label,
                missed,
            )
        )  # fmt: skip
        found.context_memory.flags.writeable = found.memory.flags.writeable = False
        return found

    def recognise(self, observed: Observed) -> FloatArray:
        """(P,) logarithms of the interactions' probabilities, by the recogniser."""
        return recognise_window(self.recogniser, observed.window)

    def generate(self, observed: Observed) -> Generated:
        """Condition on what was observed, mix and decode."""
        motion, covariance, phase = generate_window(
            self.residual, self.decoder, self.label, observed.window, observed.context, observed.weights,
            observed.means, observed.covariances, self.operators, self.phases, self.residual_covariance,
        )  # fmt: skip
        weights = observed.weights
        motion.flags.writeable = covariance.flags.writeable = weights.flags.writeable = False
        return Generated(motion, covariance, weights, phase)


@compiled
def run_network(network: Layers, values: Float32Array) -> Float32Array:
    """Push values through a network that remembers nothing."""
    return run_layers(network[0], network[1], values, np.empty(0, dtype=np.float32))


@compiled
def observe_window(
    context_network: Layers, encoder: Layers, prior: PriorParts, radius: float, context_memory: Float32Array,
    memory: FloatArray, features: FloatArray, label: Float32Array, missed: int,
) -> tuple[
    Float32Array, Float32Array, Float32Array, FloatArray, FloatArray, FloatArray, float, FloatArray, FloatArray, float
]:  # fmt: skip
    """Encode one window and move the belief on: the parts of `Observed`.

    Args:
        context_network: May be absent.
        encoder: Of the member.
        prior: Of the interaction.
        radius: Of the latent, see `Member.latent_radius`.
        context_memory: Memory of the context network, left unchanged.
        memory: Memory of the chain (K, D), left unchanged.
        features: (W, D).
        label: (P,).
        missed: Steps of the chain that went by unseen, -1 at the very first.
    """
    means, covariances, initial, transitions, durations = prior
    after_context, after, context = context_memory.copy(), memory.copy(), np.empty(0, dtype=np.float32)
    components, joint = means.shape
    size = joint // 2
    weights, expected = np.empty(components), np.empty((components, size))
    spread, latent = np.empty((components, size, size)), np.zeros(size)
    window = np.empty(features.size, dtype=np.float32)
    for row in range(features.shape[0]):
        for d in range(features.shape[1]):
            window[row * features.shape[1] + d] = features[row, d]
    if not np.isfinite(features).all():
        return window, context, after_context, latent, after, weights, np.nan, expected, spread, np.nan
    if context_network[0].shape[0] > 0:
        given = np.concatenate((window, label))
        context = run_layers(context_network[0], context_network[1], given, after_context)
    latent, widening = posterior(run_network(encoder, np.concatenate((context, window))), size)
    passed = max(missed, 0)
    shape = (passed + 1, components)
    emissions, chances, steps = np.zeros(shape), np.empty(shape), np.empty(passed + 1)
    events, distances = (np.empty(shape), np.empty(shape), np.empty(shape)), np.empty(components)
    observe_frame((means, covariances), (latent, widening), emissions[passed], distances, expected, spread)
    chain = (initial, transitions, durations)
    filter_frames(emissions, after, missed < 0, chain, UNDERFLOW, chances, steps, events)
    weights[:] = chances[passed]
    log_likelihood, score = steps[passed], distances.min() / radius
    if not log_likelihood > UNDERFLOW:
        score = max(score, NEVER_SEEN)
    return window, context, after_context, latent, after, weights, log_likelihood, expected, spread, score


@compiled
def recognise_window(network: Layers, window: Float32Array) -> FloatArray:
    """(P,) logarithms of the interactions' probabilities, by a recogniser."""
    return classify(run_network(network, window))


@compiled
def generate_window(
    residual: Layers, decoder: Layers, label: Float32Array, window: Float32Array, context: Float32Array,
    belief: FloatArray, means: FloatArray, covariances: FloatArray, operators: FloatArray, phases: FloatArray,
    residual_covariance: FloatArray,
) -> tuple[FloatArray, FloatArray, float]:  # fmt: skip
    """Condition on what was observed, mix and decode.

    Args:
        residual: May be absent.
        decoder: Takes the latent, and the label if it has room for it.
        label: (P,).
        window: Of `Observed`, as the four that follow.
        context: What the context network says.
        belief: (K,).
        means: (K, C).
        covariances: (K, C, C).
        operators: (K, N N, C C) see `propagate_covariance`.
        phases: (K,) mean time of each component.
        residual_covariance: (N, N) added to the covariance.

    Returns:
        The decoded window (W, N), covariance (N, N) of a frame's values averaged over it, and the phase by the belief.
    """
    latent, phase = np.zeros(means.shape[1]), 0.0
    for j in range(belief.shape[0]):
        phase += belief[j] * phases[j]
        for c in range(latent.shape[0]):
            latent[c] += belief[j] * means[j, c]
    covariance = residual_covariance.copy()
    propagate_covariance(belief, (means, covariances), latent, operators, covariance)
    if residual[0].shape[0] > 0:
        shift = run_network(residual, np.concatenate((context, window, label)))
        for c in range(latent.shape[0]):
            latent[c] += shift[c]
    given = np.zeros(decoder[0][0, 1], dtype=np.float32)
    given[: latent.size] = latent
    if given.size > latent.size:
        given[latent.size :] = label
    decoded, size = run_network(decoder, given), covariance.shape[0]
    motion = np.empty((decoded.shape[0] // size, size))
    for i in range(decoded.shape[0]):
        motion[i // size, i % size] = decoded[i]
    return motion, covariance, phase


def combined(generated: Sequence[Generated], shares: FloatArray) -> Generated:
    """Several answers as one, by their shares (n,); the covariance also holds how far their windows disagree."""
    if len(generated) == 1:
        return generated[0]
    motions = np.stack([part.motion for part in generated])
    motion = np.tensordot(shares, motions, 1)
    apart = motions - motion
    covariance = np.tensordot(shares, [part.covariance for part in generated], 1)
    covariance += np.einsum("n,nwa,nwb->ab", shares, apart, apart) / len(motion)
    weights = np.tensordot(shares, [part.weights for part in generated], 1)
    return Generated(motion, covariance, weights, float(shares @ [part.phase for part in generated]))


@dataclass(frozen=True, eq=False)
class ConditionedEnsemble:
    """All members of a model, conditioned on one interaction.

    Attributes:
        members: One or more.
    """

    members: tuple[CompiledMember, ...]

    def init(self) -> tuple[MemberState, ...]:
        """Nothing seen yet."""
        return tuple([member.init() for member in self.members])

    def observe(self, states: Sequence[MemberState], features: FloatArray, missed: int) -> tuple[Observed, ...]:
        """What each finds; arguments as for `CompiledMember.observe`."""
        both = zip(self.members, states, strict=True)
        return tuple([member.observe(state, features, missed) for member, state in both])

    def recognise(self, found: Sequence[Observed]) -> FloatArray:
        """(P,) mean of their recognisers' logarithms of probabilities."""
        said = [member.recognise(one) for member, one in zip(self.members, found, strict=True)]
        mean: FloatArray = np.mean(said, axis=0)
        return mean

    def generate(self, found: Sequence[Observed]) -> Generated:
        """What they expect together, each with an equal share."""
        answers = [member.generate(one) for member, one in zip(self.members, found, strict=True)]
        return combined(answers, np.full(len(answers), 1.0 / len(answers)))


def compile_member(member: Member, interaction: int, residual_covariance: FloatArray) -> CompiledMember:
    """Lay a member out for the compiled step.

    Args:
        member: Which one.
        interaction: Number of the given interaction.
        residual_covariance: (N, N) of the model.
    """

    def layers(name: str) -> Layers:
        network = member.networks.get(name)
        return (network.program.copy(), network.parameters.copy()) if network else ABSENT

    prior = member.priors[interaction]
    chain = prior.chain
    parts = (prior.components.mean, prior.components.covariance, chain.initial, chain.transitions, chain.durations)
    mean, covariance, initial, transitions, durations = (np.array(part, order="C") for part in parts)
    return CompiledMember(
        member,
        np.eye(len(member.priors), dtype=np.float32)[interaction],
        np.array(prior.phases),
        np.array(member.operators[interaction]),
        float(member.latent_radius[interaction]),
        residual_covariance,
        (mean, covariance, initial, transitions, durations),
        layers("context"),
        layers("encoder"),
        layers("residual"),
        layers("decoder"),
        layers("recogniser"),
    )


def condition_ensemble(
    members: Sequence[Member], interaction: int, residual_covariance: FloatArray
) -> ConditionedEnsemble:
    """Lay all members out; arguments as for `compile_member`."""
    return ConditionedEnsemble(tuple([compile_member(member, interaction, residual_covariance) for member in members]))


def covariance_operators(decoder: Network, priors: Sequence[Prior], window: int) -> FloatArray:
    """(P, K, N N, C C): mean over the window's frames of J (x) J, J the decoder's Jacobian at each component.

    Args:
        decoder: The network.
        priors: One per interaction.
        window: W.
    """
    interactions, components = len(priors), priors[0].chain.components
    operators = []
    for p, j in np.ndindex(interactions, components):
        latent = priors[p].components.mean[j, priors[p].observed_size :]
        point = np.concatenate([latent, np.eye(interactions)[p]])[: decoder.inputs].astype(np.float32)
        rows = decoder.jacobian(point, range(latent.size)).reshape(window, decoder.outputs // window, latent.size)
        operators.append(np.einsum("wac,wbd->abcd", rows, rows).reshape(rows.shape[1] ** 2, latent.size**2) / window)
    return read_only(np.stack(operators).reshape(interactions, components, *operators[0].shape))

# SPDX-License-Identifier: Apache-2.0
"""One member of a model: its networks and its priors, and their prediction for one window, given the interaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.inference.networks import Float32Array, Network
from mild_core.inference.priors.prior import Prior
from mild_core.inference.stepping import (
    BUFFER_PARTS,
    IntArray,
    Observed,
    Parts,
    PriorParts,
    generate_window,
    observe_window,
    recognise_window,
)
from mild_core.shapes import FloatArray, read_only


@dataclass(frozen=True, eq=False)
class Member:
    """Encoder, priors and decoder that were trained together.

    Attributes:
        networks: By name, see `manifest.SOURCES`.
        inputs: What each network takes in, in order.
        sizes: Number of values of each of `stepping.BUFFER_PARTS`.
        priors: One per interaction.
        latent_radius: (P,) Mahalanobis distance from the nearest component that the interaction's own windows hardly
            ever exceed.
        operators: (P, K, N N, C C) see `mixing.propagate_covariance`.
    """

    networks: Mapping[str, Network]
    inputs: Mapping[str, tuple[str, ...]]
    sizes: Mapping[str, int]
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
        offsets: Where each of `stepping.BUFFER_PARTS` begins, and the length of the buffer.
        prior: Its parts.
        perceiving: Context and encoder networks, each the parts of `stepping.Compiled`.
        acting: Residual and decoder networks.
        recogniser: That network.
    """

    member: Member
    label: FloatArray
    phases: FloatArray
    operators: FloatArray
    radius: float
    residual_covariance: FloatArray
    offsets: IntArray
    prior: PriorParts
    perceiving: tuple[Parts, Parts]
    acting: tuple[Parts, Parts]
    recogniser: Parts

    def init(self) -> MemberState:
        """Nothing seen yet."""
        context = self.member.networks.get("context")
        memory = context.first_memory() if context else np.zeros(0, dtype=np.float32)
        memory.flags.writeable = False
        return MemberState(memory, read_only(np.zeros(self.prior[4].shape)))

    def observe(self, state: MemberState, features: FloatArray, steps: int, stride: int, missed: int) -> Observed:
        """Encode one window and move the belief on.

        Args:
            state: Before it.
            features: (W, D).
            steps: How many of its frames are new to a context network that takes frames.
            stride: Between those.
            missed: Steps of the chain that went by unseen; -1 at the very first.

        Returns:
            What was found; its score is NaN when a feature is not finite, and then nothing else holds.
        """
        member = self.member
        steps = steps if "frame" in member.inputs.get("context", ()) else 1
        memories, given, timing = (state.context, state.memory), (features, self.label), (steps, stride, missed)
        restart = member.priors[0].restart
        found = observe_window(self.perceiving, self.prior, self.radius, self.offsets, memories, given, timing, restart)
        found[0].flags.writeable = found[1].flags.writeable = False
        return Observed(*found)

    def recognise(self, observed: Observed) -> FloatArray:
        """(P,) logarithms of the interactions' probabilities, by the recogniser."""
        return recognise_window(self.recogniser, observed.buffer)

    def generate(self, observed: Observed) -> Generated:
        """Condition on what was observed, mix and decode."""
        found = (observed.buffer, observed.weights, observed.means, observed.covariances)
        motion, covariance, weights, phase = generate_window(
            self.acting, self.offsets, found, self.operators, self.phases, self.residual_covariance
        )
        motion.flags.writeable = covariance.flags.writeable = weights.flags.writeable = False
        return Generated(motion, covariance, weights, phase)


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

    def observe(
        self, states: Sequence[MemberState], features: FloatArray, steps: int, stride: int, missed: int
    ) -> tuple[Observed, ...]:
        """What each finds; arguments as for `CompiledMember.observe`."""
        both = zip(self.members, states, strict=True)
        return tuple([member.observe(state, features, steps, stride, missed) for member, state in both])

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
    prior = member.priors[interaction]
    offsets = np.concatenate([[0], np.cumsum([member.sizes.get(name, 0) for name in BUFFER_PARTS])])

    def ready(name: str) -> Parts:
        if name not in member.networks:
            return np.zeros((0, 6), dtype=np.int64), np.zeros(0, dtype=np.float32), np.zeros(0, dtype=np.int64)
        network = member.networks[name]
        starts = [(offsets[BUFFER_PARTS.index(source)], member.sizes[source]) for source in member.inputs[name]]
        input_slices = np.concatenate([np.arange(first, first + size) for first, size in starts])
        return network.program.copy(), network.parameters.copy(), input_slices

    chain = prior.chain
    parts = (prior.components.mean, prior.components.covariance, chain.initial, chain.transitions, chain.durations)
    mean, covariance, initial, transitions, durations = (np.array(part, order="C") for part in parts)
    return CompiledMember(
        member,
        np.eye(len(member.priors))[interaction],
        np.array(prior.phases),
        np.array(member.operators[interaction]),
        float(member.latent_radius[interaction]),
        residual_covariance,
        offsets,
        (mean, covariance, initial, transitions, durations),
        (ready("context"), ready("encoder")),
        (ready("residual"), ready("decoder")),
        ready("recogniser"),
    )


def condition_ensemble(
    members: Sequence[Member], interaction: int, residual_covariance: FloatArray
) -> ConditionedEnsemble:
    """Lay all members out; arguments as for `compile_member`."""
    return ConditionedEnsemble(tuple([compile_member(member, interaction, residual_covariance) for member in members]))


def covariance_operators(
    decoder: Network, inputs: tuple[str, ...], sizes: Mapping[str, int], priors: Sequence[Prior], window: int
) -> FloatArray:
    """(P, K, N N, C C): mean over the window's frames of J (x) J, J the decoder's Jacobian at each component.

    Args:
        decoder: The network.
        inputs: What it takes in. Sources other than the latent, the label and the belief are held at zero.
        sizes: Values of each source.
        priors: One per interaction.
        window: W.
    """
    interactions, components, size = len(priors), priors[0].chain.components, sizes["controlled"]
    offsets = {name: sum(sizes[before] for before in inputs[:index]) for index, name in enumerate(inputs)}
    operators = []
    for p, j in np.ndindex(interactions, components):
        known = {
            "controlled": priors[p].components.mean[j, priors[p].observed_size :],
            "label": np.eye(interactions)[p],
            "belief": np.eye(components)[j],
        }
        point = np.concatenate([known.get(name, np.zeros(sizes[name])) for name in inputs]).astype(np.float32)
        rows = np.zeros((window, decoder.outputs // window, size))
        if "controlled" in inputs:
            columns = range(offsets["controlled"], offsets["controlled"] + size)
            rows = decoder.jacobian(point, columns).reshape(rows.shape)
        operators.append(np.einsum("wac,wbd->abcd", rows, rows).reshape(rows.shape[1] ** 2, size**2) / window)
    return read_only(np.stack(operators).reshape(interactions, components, *operators[0].shape))

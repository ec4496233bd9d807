# SPDX-License-Identifier: Apache-2.0
"""One member of a model: its networks and its priors, and what they make of one window."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.inference.networks import Float32Array, Network
from mild_core.inference.priors.prior import Prior
from mild_core.inference.stepping import (
    BOARD,
    Chains,
    IntArray,
    Observed,
    Parts,
    StackedPriors,
    generate_window,
    observe_window,
)
from mild_core.shapes import FloatArray, read_only


@dataclass(frozen=True, eq=False)
class Member:
    """Encoder, priors and decoder that were trained together.

    Attributes:
        networks: By name, see `manifest.SOURCES`.
        inputs: What each network takes in, in order.
        sizes: Number of values of each of `stepping.BOARD`.
        priors: One per interaction.
        latent_radius: (P,) Mahalanobis distance from the nearest component that the interaction's own windows hardly
            ever exceed.
        centres: (M, F) of what the `distance` network gave for training windows; (0, 0) without that network.
        radii: (M,) how far from each centre they reach.
        operators: (P, K, N N, C C) see `mixing.add_spread`.
    """

    networks: Mapping[str, Network]
    inputs: Mapping[str, tuple[str, ...]]
    sizes: Mapping[str, int]
    priors: tuple[Prior, ...]
    latent_radius: FloatArray
    centres: FloatArray
    radii: FloatArray
    operators: FloatArray


@dataclass(frozen=True, eq=False)
class MemberState:
    """What one copy of a member remembers.

    Attributes:
        context: Memory of the context network's cells.
        memory: (A, K, D) belief over components and remaining time, of each interaction that is considered.
    """

    context: Float32Array
    memory: FloatArray


@dataclass(frozen=True, eq=False)
class Generated:
    """What a member expects the controlled agent to do.

    Attributes:
        motion: (W, N) the decoded window.
        covariance: (N, N) of a frame's values, averaged over the window.
        weights: (K,) belief over the components of the likeliest interaction, after the gate.
        phase: Expected progress by that belief, 0 to 1.
    """

    motion: FloatArray
    covariance: FloatArray
    weights: FloatArray
    phase: float


@dataclass(frozen=True, eq=False)
class ReadyMember:
    """A member with everything laid out for the compiled step.

    Attributes:
        member: Which one.
        considered: (A,) numbers of the interactions that can be the one.
        phases: (P, K) of all priors.
        residual_covariance: (N, N) of the model.
        places: Where each of `stepping.BOARD` begins, and the length of the board.
        chains: The parts of `stepping.Chains`.
        perceiving: Context, encoder, distance and recogniser networks, each the parts of `stepping.Compiled`.
        acting: Gate, residual and decoder networks.
    """

    member: Member
    considered: IntArray
    phases: FloatArray
    residual_covariance: FloatArray
    places: IntArray
    chains: StackedPriors
    perceiving: tuple[Parts, Parts, Parts, Parts]
    acting: tuple[Parts, Parts, Parts]

    def init(self) -> MemberState:
        """Nothing seen yet."""
        context = self.member.networks.get("context")
        memory = context.first_memory() if context else np.zeros(0, dtype=np.float32)
        memory.flags.writeable = False
        return MemberState(memory, read_only(np.zeros(self.chains[4].shape)))

    def observe(
        self,
        state: MemberState,
        features: FloatArray,
        label: FloatArray,
        steps: int,
        stride: int,
        missed: int,
    ) -> Observed:
        """Encode one window and move the beliefs on.

        Args:
            state: Before it.
            features: (W, D).
            label: (P,) probability of each interaction so far.
            steps: How many of its frames are new to a context network that takes frames.
            stride: Between those.
            missed: Steps of the chains that went by unseen; -1 at the very first.

        Returns:
            What was found; its score is NaN when a feature is not finite, and then nothing else holds.
        """
        member = self.member
        steps = steps if "frame" in member.inputs.get("context", ()) else 1
        memories, given, timing = (state.context, state.memory), (features, label), (steps, stride, missed)
        regions, restart = (member.centres, member.radii), member.priors[0].restart
        found = observe_window(self.perceiving, self.chains, regions, self.places, memories, given, timing, restart)
        found[0].flags.writeable = found[1].flags.writeable = False
        return Observed(*found)

    def generate(self, observed: Observed, label: FloatArray) -> Generated:
        """Condition on what was observed, mix and decode.

        Args:
            observed: What `observe` found.
            label: (P,) probability of each interaction, this window included.
        """
        found = (observed.board, observed.weights, observed.means, observed.covariances)
        motion, covariance, weights, phase = generate_window(
            self.acting, self.places, found, label, self.considered, self.member.operators, self.phases,
            self.residual_covariance,
        )  # fmt: skip
        motion.flags.writeable = covariance.flags.writeable = weights.flags.writeable = False
        return Generated(motion, covariance, weights, phase)


def combined(generated: Sequence[Generated]) -> Generated:
    """Means of the members' parts; the covariance also holds how far their windows disagree."""
    if len(generated) == 1:
        return generated[0]
    motions = np.stack([part.motion for part in generated])
    motion = motions.mean(axis=0)
    apart = (motions - motion).reshape(-1, motion.shape[1])
    covariance = np.mean([part.covariance for part in generated], axis=0) + apart.T @ apart / len(apart)
    weights = np.mean([part.weights for part in generated], axis=0)
    return Generated(motion, covariance, weights, sum(part.phase for part in generated) / len(generated))


def make_ready(member: Member, considered: Sequence[int], residual_covariance: FloatArray) -> ReadyMember:
    """Lay a member out for the compiled step.

    Args:
        member: Which one.
        considered: Numbers of the interactions that can be the one.
        residual_covariance: (N, N) of the model.
    """
    priors = [member.priors[p] for p in considered]
    longest = max(prior.chain.longest for prior in priors)
    chains = Chains(
        np.stack([prior.components.mean for prior in priors]),
        np.stack([prior.components.covariance for prior in priors]),
        np.stack([prior.chain.initial for prior in priors]),
        np.stack([prior.chain.transitions for prior in priors]),
        np.stack([np.pad(p.chain.durations, ((0, 0), (0, longest - p.chain.longest))) for p in priors]),
        member.latent_radius[list(considered)],
    )
    places = np.concatenate([[0], np.cumsum([member.sizes.get(name, 0) for name in BOARD])])

    def ready(name: str) -> Parts:
        if name not in member.networks:
            return np.zeros((0, 6), dtype=np.int64), np.zeros(0, dtype=np.float32), np.zeros(0, dtype=np.int64)
        network = member.networks[name]
        starts = [(places[BOARD.index(source)], member.sizes[source]) for source in member.inputs[name]]
        intake = np.concatenate([np.arange(first, first + size) for first, size in starts])
        return network.program.copy(), network.parameters.copy(), intake

    return ReadyMember(
        member,
        np.array(considered),
        np.stack([prior.phases for prior in member.priors]),
        residual_covariance,
        places,
        (*chains,),
        (ready("context"), ready("encoder"), ready("distance"), ready("recogniser")),
        (ready("gate"), ready("residual"), ready("decoder")),
    )


def spread_operators(
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
    places = {name: sum(sizes[before] for before in inputs[:index]) for index, name in enumerate(inputs)}
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
            columns = range(places["controlled"], places["controlled"] + size)
            rows = decoder.jacobian(point, columns).reshape(rows.shape)
        operators.append(np.einsum("wac,wbd->abcd", rows, rows).reshape(rows.shape[1] ** 2, size**2) / window)
    return read_only(np.stack(operators).reshape(interactions, components, *operators[0].shape))

# SPDX-License-Identifier: Apache-2.0
"""One member of a model: its networks and its priors, and what they make of one window."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.inference.gaussian import Gaussian
from mild_core.inference.mixing import add_spread, gate_weights, mix_means, nearest, posterior
from mild_core.inference.networks import Float32Array, Network
from mild_core.inference.priors.belief import Belief, Explanation
from mild_core.inference.priors.prior import Prior
from mild_core.shapes import FloatArray, read_only

NEVER_SEEN = 2.0
"""Out-of-distribution score, at least, of a frame at which every density underflows."""

Values = dict[str, Float32Array]
"""The sources that networks take in, by name; see `manifest.SOURCES`."""


@dataclass(frozen=True, eq=False)
class MemberState:
    """What one copy of a member remembers.

    Attributes:
        context: Memory of the context network's cells.
        beliefs: One per interaction that is considered.
    """

    context: Float32Array
    beliefs: tuple[Belief, ...]


@dataclass(frozen=True, eq=False)
class Percept:
    """One window as a member sees it.

    Attributes:
        state: After the window.
        values: Sources of the networks that come later.
        explanations: One per interaction that is considered.
        out_of_distribution: Above 1 is unknown.
    """

    state: MemberState
    values: Values
    explanations: tuple[Explanation, ...]
    out_of_distribution: float


@dataclass(frozen=True, eq=False)
class Generated:
    """What a member expects the controlled agent to do.

    Attributes:
        motion: (W, N) the decoded window.
        covariance: (N, N) of a frame's values, averaged over the window; without the model's residual.
        weights: (K,) belief over the components of the likeliest interaction, after the gate.
    """

    motion: FloatArray
    covariance: FloatArray
    weights: FloatArray


@dataclass(frozen=True, eq=False)
class Member:
    """Encoder, priors and decoder that were trained together.

    Attributes:
        networks: By name, see `manifest.SOURCES`.
        inputs: What each network takes in, in order.
        priors: One per interaction.
        latent_radius: (P,) Mahalanobis distance from the nearest component that the interaction's own windows hardly
            ever exceed.
        centres: (M, F) of what the `distance` network gave for training windows; (0, 0) without that network.
        radii: (M,) how far from each centre they reach.
        operators: (P, K, N N, C C) see `mixing.add_spread`.
    """

    networks: Mapping[str, Network]
    inputs: Mapping[str, tuple[str, ...]]
    priors: tuple[Prior, ...]
    latent_radius: FloatArray
    centres: FloatArray
    radii: FloatArray
    operators: FloatArray

    @property
    def latent_size(self) -> int:
        """C: dimensions of the controlled latent."""
        return self.priors[0].controlled_size

    @property
    def frame_values(self) -> int:
        """N: values of one frame of the decoded window."""
        return math.isqrt(self.operators.shape[2])

    def init(self, interactions: Sequence[int]) -> MemberState:
        """Nothing seen yet.

        Args:
            interactions: Numbers of those that are considered.
        """
        context = self.networks.get("context")
        memory = context.first_memory() if context else np.zeros(0, dtype=np.float32)
        return MemberState(memory, tuple(self.priors[p].initial_belief() for p in interactions))

    def observe(
        self, state: MemberState, rows: Float32Array, window: Float32Array, label: Float32Array,
        interactions: Sequence[int], missed: int,
    ) -> Percept:  # fmt: skip
        """Encode one window and move the beliefs on.

        Args:
            state: Before it.
            rows: (n, D) the frames that are new to a context network that takes frames, oldest first.
            window: (W D,) all frames.
            label: (P,) probability of each interaction so far.
            interactions: Numbers of those that are considered.
            missed: Steps of the chain that went by unseen.
        """
        values: Values = {"frame": rows[-1], "window": window, "label": label}
        memory = self._remember(state.context, rows, values)
        latent, covariance = posterior(self._run("encoder", values), self.priors[0].observed_size)
        values["observed"] = latent.astype(np.float32)
        explanations = tuple(self.priors[p].explain(latent, covariance) for p in interactions)
        beliefs = tuple(
            self.priors[p].advance(belief, explanation, missed)
            for p, belief, explanation in zip(interactions, state.beliefs, explanations, strict=True)
        )
        score = min(
            float(explanation.distances.min()) / float(self.latent_radius[p])
            for p, explanation in zip(interactions, explanations, strict=True)
        )
        if not any(belief.known for belief in beliefs):
            score = max(score, NEVER_SEEN)
        if "distance" in self.networks:
            score = max(score, float(nearest(self._run("distance", values), self.centres, self.radii)))
        return Percept(MemberState(memory, beliefs), values, explanations, score)

    def generate(self, percept: Percept, label: Float32Array, interactions: Sequence[int]) -> Generated:
        """Condition on what was observed, mix and decode.

        Args:
            percept: Of `observe`, with the same `interactions`.
            label: (P,) probability of each interaction, this window included.
            interactions: Numbers of those that are considered.
        """
        values = dict(percept.values)
        values["label"] = label
        shift = self._run("residual", values).astype(np.float64) if "residual" in self.networks else None
        mixed: list[tuple[float, FloatArray, Gaussian]] = []
        latent = np.zeros(self.latent_size) if shift is None else shift.copy()
        for p, belief, explanation in zip(interactions, percept.state.beliefs, percept.explanations, strict=True):
            weights = self._gated(belief, values)
            mixed.append((float(label[p]), weights, explanation.conditioned))
            latent += float(label[p]) * mix_means(weights, explanation.conditioned.mean)
        centre = latent if shift is None else latent - shift
        covariance = np.zeros((self.frame_values, self.frame_values))
        for p, (share, weights, components) in zip(interactions, mixed, strict=True):
            add_spread(share * weights, (components.mean, components.covariance), centre, self.operators[p], covariance)
        likeliest = max(mixed, key=lambda part: part[0])[1]
        values["belief"], values["controlled"] = likeliest.astype(np.float32), latent.astype(np.float32)
        motion = self._run("decoder", values).astype(np.float64).reshape(-1, self.frame_values)
        return Generated(motion, covariance, likeliest)

    def _remember(self, memory: Float32Array, rows: Float32Array, values: Values) -> Float32Array:
        """Run the context network, once per new frame where it takes frames, and add what it says to `values`."""
        if "context" not in self.networks:
            return memory
        taken = self.inputs["context"]
        for frame in rows if "frame" in taken else rows[-1:]:
            values["frame"] = frame
            values["context"], memory = self.networks["context"].run(self._gather(taken, values), memory)
        return memory

    def _gated(self, belief: Belief, values: Values) -> FloatArray:
        if "gate" not in self.networks:
            return belief.weights
        values["belief"] = belief.weights.astype(np.float32)
        return gate_weights(belief.weights, self._run("gate", values))

    def _run(self, name: str, values: Values) -> Float32Array:
        network = self.networks[name]
        return network.run(self._gather(self.inputs[name], values), network.first_memory())[0]

    @staticmethod
    def _gather(names: tuple[str, ...], values: Values) -> Float32Array:
        return values[names[0]] if len(names) == 1 else np.concatenate([values[name] for name in names])


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

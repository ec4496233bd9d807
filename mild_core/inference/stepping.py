# SPDX-License-Identifier: Apache-2.0
"""One step of a member, compiled as two functions: observe a window, generate a motion.

Between them the interaction is recognised, which needs all members. All values that networks take in lie on one board,
an array in the order of `BOARD`; a network's intake is a list of places there.

Source: Algorithm 2 of MILD.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mild_core.compiled import compiled
from mild_core.inference.mixing import add_spread, gate_weights, nearest, posterior, tell_apart
from mild_core.inference.networks import Float32Array, run_layers
from mild_core.inference.priors.filtering import UNDERFLOW, filter_frames, observe_frame
from mild_core.shapes import FloatArray

BOARD = ("frame", "window", "label", "context", "observed", "belief", "controlled")
FRAME, WINDOW, LABEL, CONTEXT, OBSERVED, BELIEF, CONTROLLED = range(7)

NEVER_SEEN = 2.0
"""Out-of-distribution score, at least, of a frame at which every density underflows."""

IntArray = NDArray[np.int64]


class Compiled(NamedTuple):
    """A network as the kernels take it; an absent one has no layers.

    The kernels get plain tuples and name their parts inside: checking the class of a named one costs microseconds.

    Attributes:
        program: See `networks.Network`.
        parameters: See `networks.Network`.
        intake: (n,) places on the board.
    """

    program: IntArray
    parameters: Float32Array
    intake: IntArray


Parts = tuple[IntArray, Float32Array, IntArray]
"""A `Compiled`, plain."""

StackedPriors = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""A `Chains`, plain."""


class Chains(NamedTuple):
    """The priors of the A interactions that are considered, stacked.

    Attributes:
        means: (A, K, Z).
        covariances: (A, K, Z, Z).
        initial: (A, K).
        transitions: (A, K, K).
        durations: (A, K, D).
        radius: (A,) see `Member.latent_radius`.
    """

    means: FloatArray
    covariances: FloatArray
    initial: FloatArray
    transitions: FloatArray
    durations: FloatArray
    radius: FloatArray


class Observed(NamedTuple):
    """What `observe_window` found.

    Attributes:
        context: New memory of the context network.
        memory: (A, K, D) new memory of the chains.
        board: With everything up to the observed latent.
        weights: (A, K) belief over components.
        log_likelihoods: (A,) of this frame given those before, or the recogniser's log-probabilities.
        means: (A, K, C) what each component expects of the controlled latent.
        covariances: (A, K, C, C).
        score: Out of distribution; NaN when a feature is not finite, and then nothing else holds.
    """

    context: Float32Array
    memory: FloatArray
    board: Float32Array
    weights: FloatArray
    log_likelihoods: FloatArray
    means: FloatArray
    covariances: FloatArray
    score: float


@compiled
def run_network(parts: Parts, board: Float32Array, memory: Float32Array) -> Float32Array:
    """Gather a network's values from the board and push them through."""
    network = Compiled(parts[0], parts[1], parts[2])
    values = np.empty(network.intake.shape[0], dtype=np.float32)
    for i in range(values.shape[0]):
        values[i] = board[network.intake[i]]
    return run_layers(network.program, network.parameters, values, memory)


@compiled
def run_context(
    network: Parts, features: FloatArray, steps: int, stride: int, places: IntArray, board: Float32Array,
    memory: Float32Array,
) -> None:  # fmt: skip
    """Run the context network over the newest `steps` frames, `stride` apart, and lay its last output on the board."""
    frames, values = features.shape
    for back in range(steps - 1, -1, -1):
        row = frames - 1 - back * stride
        for d in range(values):
            board[places[FRAME] + d] = features[row, d]
        if network[0].shape[0] > 0:
            after = run_network(network, board, memory)
            for c in range(after.shape[0]):
                board[places[CONTEXT] + c] = after[c]


@compiled
def lay_out(features: FloatArray, label: FloatArray, places: IntArray) -> tuple[Float32Array, bool]:
    """A board with window (W, D) and label (P,) on it, and whether all features are finite."""
    board, finite = np.zeros(places[-1], dtype=np.float32), True
    for row in range(features.shape[0]):
        for d in range(features.shape[1]):
            finite = finite and np.isfinite(features[row, d])
            board[places[WINDOW] + row * features.shape[1] + d] = features[row, d]
    board[places[LABEL] : places[LABEL] + label.size] = label
    return board, finite


@compiled
def follow_chains(
    priors: StackedPriors,
    latent: tuple[FloatArray, FloatArray],
    missed: int,
    restart: float,
    memory: FloatArray,
    found: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> float:
    """Move the beliefs of all interactions on by one observed latent, its mean (Q,) and covariance (Q, Q).

    Fills `found`: weights, log-likelihoods, means and covariances of `Observed`, and changes `memory` in place.

    Returns:
        The out-of-distribution score of the latent.
    """
    chains = Chains(priors[0], priors[1], priors[2], priors[3], priors[4], priors[5])
    weights, log_likelihoods, means, covariances = found
    passed, components = max(missed, 0), weights.shape[1]
    shape = (passed + 1, components)
    emissions, chances, steps = np.zeros(shape), np.empty(shape), np.empty(passed + 1)
    events, distances = (np.empty(shape), np.empty(shape), np.empty(shape)), np.empty(components)
    score, known = np.inf, False
    for a in range(weights.shape[0]):
        gaussians = (chains.means[a], chains.covariances[a])
        observe_frame(gaussians, latent, emissions[passed], distances, means[a], covariances[a])
        chain = (chains.initial[a], chains.transitions[a], chains.durations[a])
        filter_frames(emissions, memory[a], missed < 0, chain, restart, UNDERFLOW, chances, steps, events)
        log_likelihoods[a] = steps[passed]
        known = known or log_likelihoods[a] > UNDERFLOW
        for j in range(components):
            weights[a, j] = chances[passed, j]
            score = min(score, distances[j] / chains.radius[a])
    return score if known else max(score, NEVER_SEEN)


@compiled
def observe_window(
    networks: tuple[Parts, Parts, Parts, Parts],
    priors: StackedPriors,
    regions: tuple[FloatArray, FloatArray],
    places: IntArray,
    state: tuple[Float32Array, FloatArray],
    given: tuple[FloatArray, FloatArray],
    timing: tuple[int, int, int],
    restart: float,
) -> tuple[Float32Array, FloatArray, Float32Array, FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """Encode one window and move the beliefs on: the parts of `Observed`.

    Args:
        networks: Context, encoder, distance, recogniser.
        priors: The parts of `Chains`.
        regions: Centres (M, F) and radii (M,) of the distance network's outputs.
        places: Where each of `BOARD` begins, and the length of the board.
        state: Memory of the context network and of the chains, left unchanged.
        given: Features (W, D) and the probabilities of all P interactions so far.
        timing: Frames for the context network to take in and the stride between them; steps of the chains that went
            by unseen, -1 at the very first.
        restart: See `filter_frames`.
    """
    features, label = given
    context, memory = state[0].copy(), state[1].copy()
    considered, components, total = priors[0].shape
    size = places[BELIEF] - places[OBSERVED]
    weights, log_likelihoods = np.empty((considered, components)), np.empty(considered)
    means = np.empty((considered, components, total - size))
    covariances = np.empty((considered, components, total - size, total - size))
    board, finite = lay_out(features, label, places)
    if not finite:
        return context, memory, board, weights, log_likelihoods, means, covariances, np.nan
    run_context(networks[0], features, timing[0], timing[1], places, board, context)
    nothing = np.empty(0, dtype=np.float32)
    latent, widening = posterior(run_network(networks[1], board, nothing), size)
    for q in range(size):
        board[places[OBSERVED] + q] = latent[q]
    found = (weights, log_likelihoods, means, covariances)
    score = follow_chains(priors, (latent, widening), timing[2], restart, memory, found)
    if networks[2][0].shape[0] > 0:
        score = max(score, nearest(run_network(networks[2], board, nothing), regions[0], regions[1]))
    if networks[3][0].shape[0] > 0 and considered == label.shape[0] and log_likelihoods.max() > UNDERFLOW:
        tell_apart(run_network(networks[3], board, nothing), log_likelihoods)
    return context, memory, board, weights, log_likelihoods, means, covariances, score


@compiled
def mix_latent(
    gate: Parts, places: IntArray, board: Float32Array, label: FloatArray, considered: IntArray,
    beliefs: FloatArray, means: FloatArray,
) -> tuple[FloatArray, FloatArray, int]:  # fmt: skip
    """Weigh the components by belief, gate and interaction.

    Returns:
        The mixed latent (C,), the gated beliefs (A, K), and which of the A is the likeliest interaction.
    """
    nothing = np.empty(0, dtype=np.float32)
    gated = beliefs.copy()
    latent, likeliest = np.zeros(means.shape[2]), 0
    for a in range(considered.shape[0]):
        if gate[0].shape[0] > 0:
            for j in range(beliefs.shape[1]):
                board[places[BELIEF] + j] = beliefs[a, j]
            gated[a] = gate_weights(beliefs[a], run_network(gate, board, nothing))
        share = label[considered[a]]
        if share > label[considered[likeliest]]:
            likeliest = a
        for j in range(gated.shape[1]):
            for c in range(latent.shape[0]):
                latent[c] += share * gated[a, j] * means[a, j, c]
    return latent, gated, likeliest


@compiled
def generate_window(
    networks: tuple[Parts, Parts, Parts],
    places: IntArray,
    observed: tuple[Float32Array, FloatArray, FloatArray, FloatArray],
    label: FloatArray,
    considered: IntArray,
    operators: FloatArray,
    phases: FloatArray,
    residual_covariance: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Condition on what was observed, mix and decode.

    Args:
        networks: Gate, residual, decoder.
        places: As for `observe_window`.
        observed: Board, weights, means and covariances of `Observed`.
        label: (P,) probability of each interaction, this window included.
        considered: (A,) numbers of the interactions in `observed`.
        operators: (P, K, N N, C C) see `add_spread`.
        phases: (P, K) mean time of each component.
        residual_covariance: (N, N) added to the covariance.

    Returns:
        The decoded window (W, N), covariance (N, N) of a frame's values averaged over it, the belief (K,) over the
        components of the likeliest interaction, after the gate, and the phase by that belief.
    """
    board, beliefs, means, covariances = observed[0].copy(), observed[1], observed[2], observed[3]
    nothing = np.empty(0, dtype=np.float32)
    for p in range(label.shape[0]):
        board[places[LABEL] + p] = label[p]
    latent, gated, likeliest = mix_latent(networks[0], places, board, label, considered, beliefs, means)
    covariance = residual_covariance.copy()
    for a in range(considered.shape[0]):
        spread = (means[a], covariances[a])
        add_spread(label[considered[a]] * gated[a], spread, latent, operators[considered[a]], covariance)
    if networks[1][0].shape[0] > 0:
        shift = run_network(networks[1], board, nothing)
        for c in range(latent.shape[0]):
            latent[c] += shift[c]
    phase = 0.0
    for j in range(gated.shape[1]):
        board[places[BELIEF] + j] = gated[likeliest, j]
        phase += gated[likeliest, j] * phases[considered[likeliest], j]
    for c in range(latent.shape[0]):
        board[places[CONTROLLED] + c] = latent[c]
    decoded, size = run_network(networks[2], board, nothing), covariance.shape[0]
    motion = np.empty((decoded.shape[0] // size, size))
    for i in range(decoded.shape[0]):
        motion[i // size, i % size] = decoded[i]
    return motion, covariance, gated[likeliest].copy(), phase

# SPDX-License-Identifier: Apache-2.0
"""One step of a member given the interaction, compiled as two functions: observe a window, generate a motion.

Between them the interaction is recognised, which needs all members given each of them. All values that networks take in
lie in one buffer, an array in the order of `BUFFER_PARTS`; a network's input slices are places there.

Source: Algorithm 2 of MILD.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mild_core.compiled import compiled
from mild_core.inference.mixing import classify, posterior, propagate_covariance
from mild_core.inference.networks import Float32Array, run_layers
from mild_core.inference.priors.filtering import UNDERFLOW, filter_frames, observe_frame
from mild_core.shapes import FloatArray

BUFFER_PARTS = ("frame", "window", "label", "context", "observed", "belief", "controlled")
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
        input_slices: (n,) places in the buffer.
    """

    program: IntArray
    parameters: Float32Array
    input_slices: IntArray


Parts = tuple[IntArray, Float32Array, IntArray]
"""A `Compiled`, plain."""

PriorParts = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Of a prior: means (K, Z), covariances (K, Z, Z), initial (K,), transitions (K, K), durations (K, D)."""


class Observed(NamedTuple):
    """What `observe_window` found.

    Attributes:
        context: New memory of the context network.
        memory: (K, D) new memory of the chain.
        buffer: With everything up to the observed latent.
        weights: (K,) belief over components.
        log_likelihood: Of this frame given those before.
        means: (K, C) what each component expects of the controlled latent.
        covariances: (K, C, C).
        score: Out of distribution; NaN when a feature is not finite, and then nothing else holds.
    """

    context: Float32Array
    memory: FloatArray
    buffer: Float32Array
    weights: FloatArray
    log_likelihood: float
    means: FloatArray
    covariances: FloatArray
    score: float


@compiled
def run_network(parts: Parts, buffer: Float32Array, memory: Float32Array) -> Float32Array:
    """Gather a network's values from the buffer and push them through."""
    network = Compiled(parts[0], parts[1], parts[2])
    values = np.empty(network.input_slices.shape[0], dtype=np.float32)
    for i in range(values.shape[0]):
        values[i] = buffer[network.input_slices[i]]
    return run_layers(network.program, network.parameters, values, memory)


@compiled
def run_context(
    network: Parts, features: FloatArray, steps: int, stride: int, offsets: IntArray, buffer: Float32Array,
    memory: Float32Array,
) -> None:  # fmt: skip
    """Run the context network over the newest `steps` frames, `stride` apart, and lay its last output on the buffer."""
    frames, values = features.shape
    for back in range(steps - 1, -1, -1):
        row = frames - 1 - back * stride
        for d in range(values):
            buffer[offsets[FRAME] + d] = features[row, d]
        if network[0].shape[0] > 0:
            after = run_network(network, buffer, memory)
            for c in range(after.shape[0]):
                buffer[offsets[CONTEXT] + c] = after[c]


@compiled
def lay_out(features: FloatArray, label: FloatArray, offsets: IntArray) -> tuple[Float32Array, bool]:
    """A buffer with window (W, D) and label (P,) in it, and whether all features are finite."""
    buffer, finite = np.zeros(offsets[-1], dtype=np.float32), True
    for row in range(features.shape[0]):
        for d in range(features.shape[1]):
            finite = finite and np.isfinite(features[row, d])
            buffer[offsets[WINDOW] + row * features.shape[1] + d] = features[row, d]
    buffer[offsets[LABEL] : offsets[LABEL] + label.size] = label
    return buffer, finite


@compiled
def follow_chain(
    prior: PriorParts,
    latent: tuple[FloatArray, FloatArray],
    missed: int,
    restart: float,
    memory: FloatArray,
    found: tuple[FloatArray, FloatArray, FloatArray],
) -> tuple[float, float]:
    """Move the belief on by one observed latent, its mean (Q,) and covariance (Q, Q).

    Fills `found`: weights, means and covariances of `Observed`, and changes `memory` in place.

    Returns:
        The log-likelihood, and the latent's Mahalanobis distance from the nearest component.
    """
    weights, means, covariances = found
    passed, components = max(missed, 0), weights.shape[0]
    shape = (passed + 1, components)
    emissions, chances, steps = np.zeros(shape), np.empty(shape), np.empty(passed + 1)
    events, distances = (np.empty(shape), np.empty(shape), np.empty(shape)), np.empty(components)
    observe_frame((prior[0], prior[1]), latent, emissions[passed], distances, means, covariances)
    chain = (prior[2], prior[3], prior[4])
    filter_frames(emissions, memory, missed < 0, chain, restart, UNDERFLOW, chances, steps, events)
    weights[:] = chances[passed]
    return steps[passed], distances.min()


@compiled
def observe_window(
    networks: tuple[Parts, Parts],
    prior: PriorParts,
    radius: float,
    offsets: IntArray,
    state: tuple[Float32Array, FloatArray],
    given: tuple[FloatArray, FloatArray],
    timing: tuple[int, int, int],
    restart: float,
) -> tuple[Float32Array, FloatArray, Float32Array, FloatArray, float, FloatArray, FloatArray, float]:
    """Encode one window and move the belief on: the parts of `Observed`.

    Args:
        networks: Context, encoder.
        prior: Of the interaction.
        radius: Of the latent, see `Member.latent_radius`.
        offsets: Where each of `BUFFER_PARTS` begins, and the length of the buffer.
        state: Memory of the context network and of the chain, left unchanged.
        given: Features (W, D) and the label (P,).
        timing: Frames for the context network to take in and the stride between them; steps of the chain that went
            by unseen, -1 at the very first.
        restart: See `filter_frames`.
    """
    features, label = given
    context, memory = state[0].copy(), state[1].copy()
    components, total = prior[0].shape
    size = offsets[BELIEF] - offsets[OBSERVED]
    weights, means = np.empty(components), np.empty((components, total - size))
    covariances = np.empty((components, total - size, total - size))
    buffer, finite = lay_out(features, label, offsets)
    if not finite:
        return context, memory, buffer, weights, np.nan, means, covariances, np.nan
    run_context(networks[0], features, timing[0], timing[1], offsets, buffer, context)
    nothing = np.empty(0, dtype=np.float32)
    latent, widening = posterior(run_network(networks[1], buffer, nothing), size)
    for q in range(size):
        buffer[offsets[OBSERVED] + q] = latent[q]
    found = (weights, means, covariances)
    log_likelihood, distance = follow_chain(prior, (latent, widening), timing[2], restart, memory, found)
    score = distance / radius
    if not log_likelihood > UNDERFLOW:
        score = max(score, NEVER_SEEN)
    return context, memory, buffer, weights, log_likelihood, means, covariances, score


@compiled
def recognise_window(network: Parts, buffer: Float32Array) -> FloatArray:
    """(P,) logarithms of the interactions' probabilities, by a recogniser."""
    return classify(run_network(network, buffer, np.empty(0, dtype=np.float32)))


@compiled
def generate_window(
    networks: tuple[Parts, Parts],
    offsets: IntArray,
    observed: tuple[Float32Array, FloatArray, FloatArray, FloatArray],
    operators: FloatArray,
    phases: FloatArray,
    residual_covariance: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Condition on what was observed, mix and decode.

    Args:
        networks: Residual, decoder.
        offsets: As for `observe_window`.
        observed: Buffer, weights, means and covariances of `Observed`.
        operators: (K, N N, C C) see `propagate_covariance`.
        phases: (K,) mean time of each component.
        residual_covariance: (N, N) added to the covariance.

    Returns:
        The decoded window (W, N), covariance (N, N) of a frame's values averaged over it, the belief (K,) over the
        components, and the phase by that belief.
    """
    buffer, belief, means, covariances = observed[0].copy(), observed[1], observed[2], observed[3]
    nothing, begin = np.empty(0, dtype=np.float32), offsets[BELIEF]
    latent, phase = np.zeros(means.shape[1]), 0.0
    for j in range(belief.shape[0]):
        phase += belief[j] * phases[j]
        for c in range(latent.shape[0]):
            latent[c] += belief[j] * means[j, c]
    covariance = residual_covariance.copy()
    propagate_covariance(belief, (means, covariances), latent, operators, covariance)
    if networks[0][0].shape[0] > 0:
        shift = run_network(networks[0], buffer, nothing)
        for c in range(latent.shape[0]):
            latent[c] += shift[c]
    buffer[begin : begin + belief.size] = belief
    buffer[offsets[CONTROLLED] : offsets[CONTROLLED] + latent.size] = latent
    decoded, size = run_network(networks[1], buffer, nothing), covariance.shape[0]
    motion = np.empty((decoded.shape[0] // size, size))
    for i in range(decoded.shape[0]):
        motion[i // size, i % size] = decoded[i]
    return motion, covariance, belief.copy(), phase

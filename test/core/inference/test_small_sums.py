# SPDX-License-Identifier: Apache-2.0
"""The small sums of a step, the reservoir's units and the robot's start, each against its formula in numpy."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.inference.manifest import NetworkSpec
from mild_core.inference.member import Generated, combined
from mild_core.inference.mixing import DIAGONAL_FLOOR, classify, posterior, propagate_covariance
from mild_core.inference.model import build_model
from mild_core.inference.networks import LayerSpec
from mild_core.inference.reservoir import SETTLED_S, Reservoir
from mild_core.inference.start_pose import StartPose
from test.core.inference.random_model import manifest, paper_member, random_arrays

RATE_HZ = 40.0


@pytest.fixture(name="rng")
def _rng() -> np.random.Generator:
    return np.random.default_rng(7)


def test_posterior_is_a_lower_triangle_times_its_transpose(rng):
    outputs = rng.normal(size=4 + 10).astype(np.float32)
    factor = np.zeros((4, 4))
    factor[np.tril_indices(4)] = outputs[4:]
    factor[np.diag_indices(4)] = 2.0 * np.abs(np.diag(factor)) + DIAGONAL_FLOOR
    mean, covariance = posterior(outputs, 4)
    np.testing.assert_array_equal(mean, outputs[:4])
    np.testing.assert_allclose(covariance, factor @ factor.T, atol=1e-12)


def test_log_probabilities_are_normalised_whatever_the_logits(rng):
    logits = (300.0 * rng.normal(size=6)).astype(np.float32)
    found = classify(logits)
    assert np.exp(found).sum() == pytest.approx(1.0)
    np.testing.assert_allclose(np.diff(found), np.diff(logits.astype(np.float64)), atol=1e-3)


def test_spread_is_the_moments_of_the_mixture_through_each_component_s_jacobian(rng):
    components, latent, values, window = 3, 2, 4, 5
    weights, means = rng.dirichlet(np.ones(components)), rng.normal(size=(components, latent))
    roots, jacobians = (
        rng.normal(size=(components, latent, latent)),
        rng.normal(size=(components, window, values, latent)),
    )
    covariances, centre = roots @ roots.swapaxes(1, 2), weights @ means
    operators = np.einsum("jwac,jwbd->jabcd", jacobians, jacobians).reshape(components, values**2, latent**2) / window
    found = np.eye(values)
    propagate_covariance(weights, (means, covariances), centre, operators, found)
    wanted = np.eye(values)
    for j in range(components):
        apart = means[j] - centre
        moment = covariances[j] + np.outer(apart, apart)
        wanted += weights[j] * np.mean([rows @ moment @ rows.T for rows in jacobians[j]], axis=0)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_operators_are_the_mean_over_the_window_of_what_the_decoder_makes_of_a_latent():
    member = paper_member(hidden=(20, 12))
    linear = (LayerSpec("dense", "only", 5, 280),)
    member["decoder"] = NetworkSpec(("controlled",), linear)
    of = manifest((member,), components=3)
    arrays = random_arrays(of)
    jacobian = arrays["member_0.decoder.only.weight"].T.reshape(40, 7, 5)
    wanted = np.mean([np.einsum("ac,bd->abcd", rows, rows) for rows in jacobian], axis=0).reshape(49, 25)
    operators = build_model(of, arrays).members[0].operators
    assert operators.shape == (4, 3, 49, 25)
    np.testing.assert_allclose(operators, np.broadcast_to(wanted, operators.shape), atol=1e-4)


def test_members_that_disagree_are_less_sure_by_how_far_they_are_apart(rng):
    shares = np.array([0.25, 0.75])
    parts = [
        Generated(rng.normal(size=(6, 2)), np.eye(2) * scale, rng.dirichlet(np.ones(3)), phase)
        for scale, phase in ((1.0, 0.2), (3.0, 0.6))
    ]
    both = combined(parts, shares)
    apart = parts[1].motion - parts[0].motion
    np.testing.assert_allclose(both.motion, 0.25 * parts[0].motion + 0.75 * parts[1].motion)
    # The variance of a choice between two is p (1 - p) times their squared distance.
    np.testing.assert_allclose(both.covariance, 2.5 * np.eye(2) + 0.25 * 0.75 * apart.T @ apart / 6, atol=1e-12)
    np.testing.assert_allclose(both.weights, 0.25 * parts[0].weights + 0.75 * parts[1].weights)
    assert both.phase == pytest.approx(0.5)


@pytest.fixture(name="reservoir")
def _reservoir(rng) -> Reservoir:
    units, joints, interactions, outputs, values = 6, 1, 2, 3, 8
    return Reservoir(
        intake=0.5 * rng.normal(size=(6 * joints + 1, units)),
        sources=rng.integers(0, units, (2, units)).astype(float),
        strengths=0.3 * rng.normal(size=(2, units)),
        leak=np.linspace(0.1, 0.9, units),
        readout=rng.normal(size=(interactions, units + 9 * joints, outputs)),
        bias=rng.normal(size=(interactions, outputs)),
        back=rng.normal(size=(outputs, values)),
        mean=rng.normal(size=values),
        share=np.array([0.3]),
        label_weight=rng.normal(size=(units + 9 * joints, interactions)),
        label_bias=rng.normal(size=interactions),
    )


def by_hand(reservoir: Reservoir, frames: np.ndarray, state: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """The units of Jaeger et al. (2007), one after the other."""
    for position, velocity in zip(frames, velocities, strict=True):
        drive = np.concatenate([position, velocity, [1.0]]) @ reservoir.intake
        links = np.zeros((len(state), len(state)))
        for unit, sources in enumerate(reservoir.sources.T.astype(int)):
            for source, strength in zip(sources, reservoir.strengths[:, unit], strict=True):
                links[unit, source] += strength
        state = (1.0 - reservoir.leak) * state + reservoir.leak * np.tanh(drive + links @ state)
    return state


def test_units_are_leaky_integrators_that_hear_velocities_in_metres_per_second(reservoir, rng):
    track = np.cumsum(0.02 * rng.normal(size=(30, 3)), axis=0)
    velocities = np.vstack([np.zeros(3), (track[1:] - track[:-1]) * RATE_HZ])
    still = round(SETTLED_S * RATE_HZ)
    rest = by_hand(reservoir, np.repeat(track[:1], still, axis=0), np.zeros(6), np.zeros((still, 3)))
    found = reservoir.listen(track, RATE_HZ, None, 0)
    np.testing.assert_allclose(found[-1], by_hand(reservoir, track, rest, velocities), atol=1e-12)


@pytest.mark.parametrize("passed", [1, 2, 7])
def test_what_was_missed_is_heard_with_the_next_window(reservoir, rng, passed):
    track, window = np.cumsum(0.02 * rng.normal(size=(30 + passed, 3)), axis=0), 20
    whole = reservoir.listen(track, RATE_HZ, None, 0)
    after = reservoir.listen(track[-window:], RATE_HZ, whole[-1 - passed], passed)
    # The first frame of a window knows no velocity, and it is not among the new ones.
    np.testing.assert_allclose(after[-1], whole[-1], atol=1e-12)
    assert len(after) == passed


def test_readouts_see_the_state_and_the_newest_the_oldest_and_the_middle_frame(reservoir, rng):
    state, positions, label = rng.normal(size=6), rng.normal(size=(9, 3)), np.array([0.3, 0.7])
    seen = np.concatenate([state, positions[8], positions[0], positions[4]])
    coordinates = sum(p * (seen @ reservoir.readout[k] + reservoir.bias[k]) for k, p in enumerate(label))
    np.testing.assert_allclose(
        reservoir.answer(state, positions, label), coordinates @ reservoir.back + reservoir.mean, atol=1e-12
    )
    wanted = seen @ reservoir.label_weight + reservoir.label_bias
    np.testing.assert_allclose(reservoir.classify(state, positions), wanted, atol=1e-12)


def test_the_reservoir_has_its_share_and_widens_the_covariance_by_their_disagreement(reservoir, rng):
    motion, other, covariance = rng.normal(size=(4, 2)), rng.normal(size=8), np.eye(2)
    mixed, wider = reservoir.blend(motion, covariance, other)
    apart = other.reshape(4, 2) - motion
    np.testing.assert_allclose(mixed, 0.7 * motion + 0.3 * other.reshape(4, 2))
    np.testing.assert_allclose(wider, covariance + 0.3 * 0.7 * apart.T @ apart / 4)


@pytest.fixture(name="start_pose")
def _start_pose(rng) -> StartPose:
    gains = (0.5 * rng.normal(size=(2, 3, 3)) for _ in range(2))
    one = np.array([1.0])
    return StartPose(rng.normal(size=(2, 3)), 2.0 * one, *gains, 0.6 * one, 0.25 * one)


def test_a_start_displaces_by_its_own_gain_near_it_and_by_the_other_far_from_it(start_pose):
    label, mean = np.array([0.0, 1.0]), start_pose.mean[1]
    unusual = np.array([0.1, -0.2, 0.05])
    at_rest, moved = start_pose.resting[1] @ unusual, start_pose.moving[1] @ unusual
    for distance_rad in (0.0, 0.6, 6.0):
        pose = mean + np.array([0.0, 0.0, distance_rad])
        near = np.exp(-(distance_rad**2) / (2.0 * 0.6**2))
        found = start_pose.displaced(pose[None], mean + unusual, label, 0.0)[0] - pose
        np.testing.assert_allclose(found, near * at_rest + (1.0 - near) * moved, atol=1e-12)


def test_a_start_counts_for_the_interactions_that_it_is_within_reach_of(start_pose):
    start = start_pose.mean[0] + np.array([0.3, 0.0, 0.0])
    pose = start_pose.mean.mean(axis=0)[None] + 100.0
    near = np.linalg.norm(start - start_pose.mean[1]) <= 2.0
    wanted = 0.5 * start_pose.moving[0] @ (start - start_pose.mean[0])
    wanted = wanted + 0.5 * near * start_pose.moving[1] @ (start - start_pose.mean[1])
    found = start_pose.displaced(pose, start, np.array([0.5, 0.5]), 0.0) - pose
    np.testing.assert_allclose(found[0], wanted, atol=1e-9)
    far = start_pose.mean[0] + np.array([50.0, 0.0, 0.0])
    np.testing.assert_array_equal(start_pose.displaced(pose, far, np.array([0.5, 0.5]), 1.0), pose)


def test_while_the_person_rests_a_pose_near_the_start_is_drawn_to_it(start_pose):
    label, start = np.array([1.0, 0.0]), start_pose.mean[0] + np.array([0.1, 0.0, -0.1])
    poses = start_pose.mean[0] + np.array([[0.02, 0.1, 0.0], [0.4, 0.1, 0.0]])
    gone = start_pose.displaced(poses, start, label, 0.0)
    half = start_pose.displaced(poses, start, label, 0.5)
    stands = 0.5 * np.exp(-((gone - start) ** 2).sum(axis=1, keepdims=True) / (2.0 * 0.25**2))
    np.testing.assert_allclose(half, gone + stands * (start - gone), atol=1e-12)

# SPDX-License-Identifier: Apache-2.0
"""The compiled recursions against the enumeration of all segmentations."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.inference.priors.filtering import UNDERFLOW
from mild_core.inference.priors.semi_markov_chain import SemiMarkovChain, component_probabilities, expect
from mild_core.inference.priors.semi_markov_chain import run_filter as filtered
from test.core.inference.enumeration import counts, posterior

# Two roads through some 10^4 sums and products in double precision; the scaling costs a few more digits.
EXACT = 1e-11


def random_chain(rng: np.random.Generator, components: int, longest: int) -> SemiMarkovChain:
    transitions = rng.dirichlet(np.ones(components), components) if components > 1 else np.ones((1, 1))
    if components > 1:
        np.fill_diagonal(transitions, 0.0)
        transitions /= transitions.sum(axis=1, keepdims=True)
    return SemiMarkovChain(rng.dirichlet(np.ones(components)), transitions, rng.dirichlet(np.ones(longest), components))


def run_filter(chain: SemiMarkovChain, log_emissions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = filtered(chain, log_emissions)
    return found.weights, found.log_likelihoods


SIZES = [(1, 3, 6), (2, 3, 7), (3, 2, 6), (3, 4, 5), (2, 6, 4)]
"""(K, D, T): with T both longer and shorter than D, so that segments are cut on the right."""


@pytest.mark.parametrize(("components", "longest", "frames"), SIZES)
@pytest.mark.parametrize("seed", range(3))
def test_filter_is_the_enumerated_posterior_of_the_frames_so_far(components, longest, frames, seed):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, components, longest)
    log_emissions = rng.normal(0.0, 2.0, (frames, components))
    weights, log_likelihoods = run_filter(chain, log_emissions)
    for seen in range(1, frames + 1):
        likelihood, table = posterior(chain, np.exp(log_emissions[:seen]))
        assert log_likelihoods[:seen].sum() == pytest.approx(np.log(likelihood), abs=EXACT)
        np.testing.assert_allclose(weights[seen - 1], table[-1], atol=EXACT)


@pytest.mark.parametrize(("components", "longest", "frames"), SIZES)
@pytest.mark.parametrize("seed", range(3))
def test_expectation_is_the_enumerated_one(components, longest, frames, seed):
    rng = np.random.default_rng(10 + seed)
    chain = random_chain(rng, components, longest)
    lengths = [frames, max(frames - 2, 1)]
    log_emissions = rng.normal(0.0, 2.0, (sum(lengths), components))
    found = expect(chain, log_emissions, lengths)
    log_likelihood, start = 0.0, 0
    transitions, durations = np.zeros_like(chain.transitions), np.zeros_like(chain.durations)
    for length in lengths:
        emissions = np.exp(log_emissions[start : start + length])
        likelihood, table = posterior(chain, emissions)
        np.testing.assert_allclose(found.responsibilities[start : start + length], table, atol=EXACT)
        log_likelihood += np.log(likelihood)
        more_transitions, more_durations = counts(chain, emissions)
        transitions += more_transitions
        durations += more_durations
        start += length
    assert found.log_likelihood == pytest.approx(log_likelihood, abs=EXACT)
    np.testing.assert_allclose(found.counts.transitions, transitions, atol=EXACT)
    np.testing.assert_allclose(found.counts.durations, durations, atol=EXACT)
    np.testing.assert_allclose(found.counts.initial, found.responsibilities[[0, lengths[0]]].sum(axis=0), atol=EXACT)


def in_logarithms(chain: SemiMarkovChain, log_emissions: np.ndarray) -> tuple[float, np.ndarray]:
    """Log-likelihood and (T, K) posterior by forward and backward over all (K, D) states in the log domain."""
    with np.errstate(divide="ignore"):
        moves, durations, start = (np.log(part) for part in (chain.transitions, chain.durations, chain.initial))
    forward, backward = [start[:, None] + durations + log_emissions[0][:, None]], [np.zeros(durations.shape)]
    for row in log_emissions[1:]:
        entering = np.logaddexp.reduce(forward[-1][:, 0][:, None] + moves, axis=0)
        left = np.pad(forward[-1][:, 1:], ((0, 0), (0, 1)), constant_values=-np.inf)
        forward.append(np.logaddexp(left, entering[:, None] + durations) + row[:, None])
    for row in log_emissions[:0:-1]:
        ahead = backward[-1] + row[:, None]
        rest = np.logaddexp.reduce(durations + ahead, axis=1)
        backward.append(np.column_stack([np.logaddexp.reduce(moves + rest, axis=1), ahead[:, :-1]]))
    both = np.logaddexp.reduce(np.array(forward) + np.array(backward[::-1]), axis=2)
    total = np.logaddexp.reduce(both[-1])
    return float(total), np.exp(both - total)


@pytest.mark.parametrize(("spread", "longest"), [(1.0, 11), (60.0, 11), (900.0, 11), (1.0, 40), (60.0, 40)])
def test_expectation_holds_where_one_component_is_far_likelier_than_another(spread, longest):
    rng = np.random.default_rng(21)
    chain, frames = random_chain(rng, 4, longest), 60
    likeliest = np.arange(frames) * 7 // frames % 4
    log_emissions = rng.normal(0.0, 1.0, (frames, 4)) - spread * rng.random((frames, 4))
    log_emissions[np.arange(frames), likeliest] += 0.2 * spread
    log_likelihood, posterior = in_logarithms(chain, log_emissions)
    found = expect(chain, log_emissions, [frames])
    assert found.log_likelihood == pytest.approx(log_likelihood, rel=1e-13)
    np.testing.assert_allclose(found.responsibilities, posterior, atol=EXACT)
    # Every frame belongs to one segment: as many start as there are transitions, and the first.
    assert found.counts.durations.sum() == pytest.approx(found.counts.transitions.sum() + 1.0, abs=EXACT)


@pytest.mark.parametrize("components", [1, 4])
@pytest.mark.parametrize("spread", [1.0, 60.0, 900.0])
def test_expectation_of_many_unequal_demonstrations_is_that_of_each(components, spread):
    """More of them than are gone through at once, from one frame to many times the longest duration."""
    rng = np.random.default_rng(22)
    chain, lengths = random_chain(rng, components, 9), [5, 70, 1, 33, 9, 10, 1, 41, 2, 64, 8]
    log_emissions = rng.normal(0.0, 1.0, (sum(lengths), components)) - spread * rng.random((sum(lengths), components))
    found = expect(chain, log_emissions, lengths)
    parts = np.split(log_emissions, np.cumsum(lengths)[:-1])
    alone = [expect(chain, part, [len(part)]) for part in parts]
    for one, part in zip(alone, parts, strict=True):
        log_likelihood, posterior = in_logarithms(chain, part)
        assert one.log_likelihood == pytest.approx(log_likelihood, rel=1e-12)
        np.testing.assert_allclose(one.responsibilities, posterior, atol=EXACT)
    np.testing.assert_allclose(found.responsibilities, np.concatenate([a.responsibilities for a in alone]), atol=EXACT)
    assert found.log_likelihood == pytest.approx(sum(one.log_likelihood for one in alone), rel=1e-12)
    for name in ("initial", "transitions", "durations"):
        expected = sum(getattr(one.counts, name) for one in alone)
        np.testing.assert_allclose(getattr(found.counts, name), expected, atol=EXACT)


def test_a_frame_out_of_reach_in_one_demonstration_changes_no_other():
    rng = np.random.default_rng(23)
    chain = SemiMarkovChain(np.array([1.0, 0.0]), np.array([[0.0, 1.0], [1.0, 0.0]]), np.tile([0.0, 0.0, 1.0], (2, 1)))
    hidden = np.array([[0.0, 900.0], [-300.0, 900.0], [-300.0, 0.0], [-2.0, -1.0]])
    plain = rng.normal(0.0, 1.0, (9, 2))
    found = expect(chain, np.concatenate([plain, hidden, hidden[:2], plain[:3]]), [9, 4, 2, 3])
    expected = [in_logarithms(chain, part) for part in (plain, plain[:3])]
    assert found.log_likelihood == pytest.approx(expected[0][0] - 301.0 - 300.0 - 300.0 + expected[1][0], abs=1e-9)
    np.testing.assert_allclose(found.responsibilities[:9], expected[0][1], atol=EXACT)
    np.testing.assert_allclose(
        found.responsibilities[9:15], [[1, 0], [1, 0], [1, 0], [0, 1], [1, 0], [1, 0]], atol=EXACT
    )
    np.testing.assert_allclose(found.responsibilities[15:], expected[1][1], atol=EXACT)


def test_starting_as_if_a_segment_had_just_ended_gives_another_belief():
    rng = np.random.default_rng(3)
    chain = random_chain(rng, 3, 4)
    log_emissions = rng.normal(0.0, 2.0, (4, 3))
    memory = np.zeros((3, 4))
    memory[:, 0] = chain.initial
    weights = filtered(chain, log_emissions, memory).weights
    right, _ = run_filter(chain, log_emissions)
    assert abs(weights - right).max() > 0.01


def test_printed_equation_6_is_a_hidden_markov_model():
    """alpha_t(j) = b_j sum_i alpha_{t-1}(i) T_ij sum_d p_j(d), as printed: the duration sums out."""
    rng = np.random.default_rng(4)
    transitions, initial = rng.dirichlet(np.ones(3), 3), rng.dirichlet(np.ones(3))
    durations = rng.dirichlet(np.ones(5), 3)
    log_emissions = rng.normal(0.0, 1.0, (12, 3))
    printed = initial * np.exp(log_emissions[0])
    printed /= printed.sum()
    printed_path = [printed]
    for row in np.exp(log_emissions[1:]):
        printed = row * sum(printed @ transitions * durations[:, d] for d in range(5))
        printed /= printed.sum()
        printed_path.append(printed)
    markov, _ = run_filter(SemiMarkovChain(initial, transitions, np.ones((3, 1))), log_emissions)
    semi_markov, _ = run_filter(SemiMarkovChain(initial, transitions, durations), log_emissions)
    np.testing.assert_allclose(printed_path, markov, atol=EXACT)
    assert abs(markov - semi_markov).max() > 0.05


def test_geometric_durations_make_a_hidden_markov_model():
    rng = np.random.default_rng(5)
    stay, frames = np.array([0.6, 0.85, 0.3]), 30
    moves = random_chain(rng, 3, 1).transitions
    initial = rng.dirichlet(np.ones(3))
    durations = (1.0 - stay[:, None]) * stay[:, None] ** np.arange(frames)
    durations[:, -1] += 1.0 - durations.sum(axis=1)
    markov = SemiMarkovChain(initial, np.diag(stay) + (1.0 - stay[:, None]) * moves, np.ones((3, 1)))
    semi_markov = SemiMarkovChain(initial, moves, durations)
    log_emissions = rng.normal(0.0, 1.5, (frames, 3))
    for one, other in zip(run_filter(markov, log_emissions), run_filter(semi_markov, log_emissions), strict=True):
        np.testing.assert_allclose(one, other, atol=EXACT)
    one, other = (expect(chain, log_emissions, [frames]) for chain in (markov, semi_markov))
    np.testing.assert_allclose(one.responsibilities, other.responsibilities, atol=EXACT)
    assert one.log_likelihood == pytest.approx(other.log_likelihood, abs=EXACT)


def test_equal_rows_make_a_mixture():
    rng = np.random.default_rng(6)
    shares = rng.dirichlet(np.ones(4))
    log_emissions = rng.normal(0.0, 3.0, (20, 4))
    weights, log_likelihoods = run_filter(
        SemiMarkovChain(shares, np.tile(shares, (4, 1)), np.ones((4, 1))), log_emissions
    )
    joint = shares * np.exp(log_emissions)
    np.testing.assert_allclose(weights, joint / joint.sum(axis=1, keepdims=True), atol=EXACT)
    np.testing.assert_allclose(log_likelihoods, np.log(joint.sum(axis=1)), atol=EXACT)


def test_a_frame_that_underflows_passes_as_time_and_says_so():
    rng = np.random.default_rng(7)
    chain = random_chain(rng, 3, 5)
    log_emissions = rng.normal(0.0, 1.0, (6, 3))
    seen = log_emissions.copy()
    log_emissions[3] -= 5000.0
    seen[3] = 0.0
    weights, log_likelihoods = run_filter(chain, log_emissions)
    unobserved, _ = run_filter(chain, seen)
    assert log_likelihoods[3] < UNDERFLOW < log_likelihoods[[0, 1, 2, 4, 5]].min()
    np.testing.assert_allclose(weights, unobserved, atol=EXACT)
    assert abs(weights[3] - chain.initial).max() > 0.01


def test_components_that_cannot_be_reached_do_not_count_however_likely():
    chain = SemiMarkovChain(np.array([1.0, 0.0]), np.array([[0.0, 1.0], [1.0, 0.0]]), np.tile([0.0, 0.0, 1.0], (2, 1)))
    log_emissions = np.array([[0.0, 900.0], [-300.0, 900.0], [-300.0, 0.0], [-2.0, -1.0]])
    weights, log_likelihoods = run_filter(chain, log_emissions)
    np.testing.assert_array_equal(weights, [[1, 0], [1, 0], [1, 0], [0, 1]])
    np.testing.assert_allclose(log_likelihoods, [0.0, -300.0, -300.0, -1.0], atol=EXACT)
    found = expect(chain, log_emissions, [4])
    np.testing.assert_allclose(found.responsibilities, weights, atol=EXACT)


def test_without_observations_the_components_follow_their_durations():
    durations = np.zeros((3, 4))
    durations[[0, 1, 2], [1, 3, 0]] = 1.0
    chain = SemiMarkovChain(np.array([1.0, 0, 0]), np.roll(np.eye(3), 1, axis=1), durations)
    path = component_probabilities(chain, 9)
    np.testing.assert_array_equal(path.argmax(axis=1), [0, 0, 1, 1, 1, 1, 2, 0, 0])
    np.testing.assert_allclose(path.max(axis=1), 1.0, atol=EXACT)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"initial": [0.5, 0.4]}, "initial"),
        ({"transitions": [[0.5, 0.5], [2.0, -1.0]]}, "transitions"),
        ({"durations": [[1.0], [np.nan]]}, "durations"),
        ({"transitions": [[1.0]]}, "transitions"),
    ],
)
def test_what_is_no_chain_is_refused(change, word):
    parts = {"initial": [0.5, 0.5], "transitions": [[0.5, 0.5], [0.5, 0.5]], "durations": [[1.0], [1.0]]}
    with pytest.raises(ValueError, match=word):
        SemiMarkovChain(**{name: np.array(values) for name, values in (parts | change).items()})

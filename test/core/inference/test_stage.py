# SPDX-License-Identifier: Apache-2.0
"""The stage against the same steps taken one by one with the public parts, and what it does with a bad stream."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.inference.gaussian import Gaussian
from mild_core.inference.mixing import NEGLIGIBLE_WEIGHT
from mild_core.inference.model import build_model
from mild_core.inference.motion_model import MildModel
from mild_core.inference.priors.semi_markov_chain import run_filter
from mild_core.inference.stage import Inference
from mild_core.inference.start_pose import StartPose
from mild_core.signals import FeatureWindow, JointMeasurement
from test.core.inference.oracles import initial_belief, update
from test.core.inference.random_model import (
    INTERACTIONS,
    manifest,
    paper_member,
    random_arrays,
)

PERIOD_NS = 25_000_000
JOINTS = ("shoulder", "elbow", "hand")

# The stage and the composition below run the same float32 networks; a latent differs by the order of a float64 sum,
# and is then rounded to float32, at most one unit in its last place: some 1e-7 of values of order one.
CLOSE = 2e-6


def windows(count, seed=0, first_ns=1_000_000_000, step=1):
    rng = np.random.default_rng(seed)
    track = np.cumsum(rng.normal(0.0, 0.02, (40 + count * step, 9)), axis=0)
    return [
        FeatureWindow(first_ns + i * step * PERIOD_NS, "arm", JOINTS, track[i * step : i * step + 40])
        for i in range(count)
    ]


def run(stage, stream, state=None):
    state, answers = state or stage.init(), []
    for window in stream:
        state, motions = stage.step(state, window, 0)
        answers.extend(motions)
    return state, answers


def posterior(outputs, size=5):
    mean, factor = outputs[:size].astype(np.float64), np.zeros((size, size))
    factor[np.tril_indices(size)] = outputs[size:]
    factor[np.diag_indices(size)] = 2.0 * abs(np.diagonal(factor)) + 1e-4
    return mean, factor @ factor.T


class ByHand:
    """One copy of one member, given an interaction, from the public parts: networks and priors."""

    def __init__(self, model: MildModel, index: int, interaction: int) -> None:
        self.member, self.number = model.members[index], interaction
        self.inputs = {name: spec.inputs for name, spec in model.manifest.members[index].items()}
        self.prior = self.member.priors[interaction]
        self.belief, self.label = initial_belief(self.prior), np.eye(len(INTERACTIONS))[interaction]
        context = self.member.networks.get("context")
        self.memory = context.first_memory() if context else None

    def run(self, name, values, memory=None):
        network = self.member.networks[name]
        taken = np.concatenate([np.asarray(values[source]).ravel() for source in self.inputs[name]])
        return network.run(taken.astype(np.float32), network.first_memory() if memory is None else memory)

    def step(self, window):
        values = {"window": window.features, "label": self.label}
        networks = self.member.networks
        if "context" in networks:
            values["context"], self.memory = self.run("context", values, self.memory)
        values["observed"], covariance = posterior(self.run("encoder", values)[0])
        self.belief = update(self.prior, self.belief, values["observed"], covariance)
        weights, explanation = self.belief.weights, self.prior.explain(values["observed"], covariance)
        score = explanation.distances.min() / self.member.latent_radius[self.number]
        latent = weights @ explanation.conditioned.mean
        centre = latent
        if "residual" in networks:
            latent = latent + self.run("residual", values)[0]
        motion = self.run("decoder", values | {"controlled": latent})[0].reshape(40, 7)
        return motion, weights, self.spread(weights, explanation.conditioned, centre), score

    def spread(self, weights, conditioned: Gaussian, centre):
        apart = conditioned.mean - centre
        second = conditioned.covariance + apart[:, :, None] * apart[:, None, :]
        operators = self.member.operators[self.number].reshape(len(weights), 7, 7, -1)
        weights = np.where(weights < NEGLIGIBLE_WEIGHT, 0.0, weights)
        return np.einsum("k,kabs,ks->ab", weights, operators, second.reshape(len(weights), -1))


def test_a_given_interaction_is_the_paper_s_algorithm_step_by_step(paper_model):
    by_hand = ByHand(paper_model, 0, 2)
    state, answers = run(Inference(paper_model, "rocket"), windows(30))
    for window, answer in zip(windows(30), answers, strict=True):
        motion, weights, spread, score = by_hand.step(window)
        np.testing.assert_allclose(answer.positions, motion, atol=CLOSE)
        np.testing.assert_allclose(answer.belief, weights, atol=CLOSE)
        np.testing.assert_allclose(answer.covariance, spread + paper_model.residual_covariance, atol=CLOSE)
        assert answer.out_of_distribution == pytest.approx(score, abs=CLOSE)
        assert answer.phase == pytest.approx(weights @ by_hand.prior.phases, abs=CLOSE)
        assert (answer.interaction, answer.probability) == ("rocket", 1.0)
        assert (answer.stamp_ns, answer.lead_ns, answer.period_ns) == (window.stamp_ns, PERIOD_NS, PERIOD_NS)
    assert state.counts["accepted"] == 30


def test_copies_take_turns_and_members_are_averaged(full_model):
    """Two members, each with a context and a residual; with a stride of two, two copies of each."""
    copies = [[ByHand(full_model, member, 1) for member in range(2)] for _ in range(2)]
    _, answers = run(Inference(full_model, "hand_shake"), windows(20))
    for index, (window, answer) in enumerate(zip(windows(20), answers, strict=True)):
        parts = [member.step(window) for member in copies[index % 2]]
        motions, weights, spreads, scores = (np.array(column) for column in zip(*parts, strict=True))
        np.testing.assert_allclose(answer.positions, motions.mean(axis=0), atol=CLOSE)
        np.testing.assert_allclose(answer.belief, weights.mean(axis=0), atol=CLOSE)
        apart = (motions - motions.mean(axis=0)).reshape(-1, 7)
        expected = spreads.mean(axis=0) + apart.T @ apart / len(apart) + full_model.residual_covariance
        np.testing.assert_allclose(answer.covariance, expected, atol=CLOSE)
        assert answer.out_of_distribution == pytest.approx(scores.mean(), abs=CLOSE)


def test_covariance_is_a_covariance(full_model):
    _, answers = run(Inference(full_model, "auto"), windows(10))
    for answer in answers:
        np.testing.assert_allclose(answer.covariance, answer.covariance.T, atol=1e-12)  # Sums in another order.
        assert (
            np.linalg.eigvalsh(answer.covariance).min() >= 0.01 - 1e-9
        )  # At least the residual, 0.01 on its diagonal.


def test_the_same_windows_give_the_same_bits_and_states_are_values(full_model):
    stage = Inference(full_model)
    middle, _ = run(stage, windows(15))
    first, second = (run(stage, windows(30)[15:], middle) for _ in range(2))
    for one, other in zip(first[1], second[1], strict=True):
        for part in fields(one):
            np.testing.assert_array_equal(getattr(one, part.name), getattr(other, part.name))
    assert first[0].counts == second[0].counts
    with pytest.raises(ValueError, match="read-only"):
        first[0].copies[0].members[0][0].memory[0] = 1.0


def test_the_layout_of_a_window_in_memory_changes_nothing(paper_model):
    stage, stream = Inference(paper_model, "rocket"), windows(3)
    turned = [FeatureWindow(w.stamp_ns, "arm", JOINTS, np.asfortranarray(w.features)) for w in stream]
    for one, other in zip(run(stage, stream)[1], run(stage, turned)[1], strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)


def with_nan(window):
    features = window.features.copy()
    features[7, 3] = np.nan
    return FeatureWindow(window.stamp_ns, "arm", JOINTS, features)


@pytest.mark.parametrize(
    ("spoil", "outcome"),
    [
        (with_nan, "not_finite"),
        (lambda w: FeatureWindow(w.stamp_ns, "arm", ("elbow", "shoulder", "hand"), w.features), "wrong_joints"),
        (lambda w: FeatureWindow(w.stamp_ns, "arm", JOINTS, w.features[1:]), "wrong_shape"),
        (lambda w: FeatureWindow(w.stamp_ns - PERIOD_NS, "arm", JOINTS, w.features), "duplicate"),
    ],
)
def test_an_unusable_window_is_counted_and_leaves_no_trace(full_model, spoil, outcome):
    stage, stream = Inference(full_model), windows(8)
    before, _ = run(stage, stream[:4])
    after, motions = stage.step(before, spoil(stream[4]), 0)
    assert motions == ()
    assert after.outcome == outcome
    assert after.detail
    assert after.counts == before.counts | {outcome: 1}
    smooth, disturbed = run(stage, stream[4:], before)[1], run(stage, stream[4:], after)[1]
    for one, other in zip(smooth, disturbed, strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)


@pytest.mark.parametrize(
    ("jump_ns", "event"), [(-100 * PERIOD_NS, "time_reset"), (-1, "time_reset"), (41 * PERIOD_NS, "gap_reset")]
)
def test_a_jump_in_time_resets(full_model, jump_ns, event):
    stage = Inference(full_model)
    before, _ = run(stage, windows(10))
    later = windows(5, seed=3, first_ns=before.stamp_ns + jump_ns)
    after, answers = run(stage, later, before)
    _, fresh = run(stage, later)
    for one, other in zip(answers, fresh, strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)
    assert after.counts == before.counts | {"accepted": 15, event: 1}


@pytest.mark.parametrize("passed", [1, 2, 39, 40])
def test_a_gap_of_up_to_a_window_is_bridged(full_model, passed):
    """All frames of a gap that is no longer than the window are in the window: nothing has to be forgotten."""
    stage = Inference(full_model)
    before, _ = run(stage, windows(10))
    late = windows(1, seed=3, first_ns=before.stamp_ns + passed * PERIOD_NS)
    after, _ = run(stage, late, before)
    assert after.index == before.index + passed
    assert after.counts.get("missed", 0) == passed - 1
    assert "gap_reset" not in after.counts


def test_a_stamp_that_trembles_is_no_missed_window(full_model):
    stage, state = Inference(full_model), None
    for number, tremble_ns in enumerate((0, 5_000_000, -5_000_000, 6_000_000, 0)):
        (window,) = windows(1, seed=number, first_ns=10**9 + number * PERIOD_NS + tremble_ns)
        state, _ = run(stage, [window], state)
    assert (state.index, state.counts) == (4, {"accepted": 5})


@pytest.mark.parametrize(("protocol", "lead"), [("ahead", 1), ("next", 40), ("same", -39)])
def test_a_prediction_says_how_far_ahead_of_its_window_it_begins(protocol, lead):
    of = manifest((paper_member(hidden=(20, 12)),), components=4, protocol=protocol, lead_frames=lead)
    _, (answer,) = run(Inference(build_model(of, random_arrays(of)), "rocket"), windows(1))
    assert (answer.lead_ns, answer.period_ns) == (lead * PERIOD_NS, PERIOD_NS)


def test_missed_windows_pass_as_time(paper_model):
    stage, stream = Inference(paper_model, "rocket"), windows(10)
    state, answers = run(stage, [*stream[:3], *stream[6:]])
    assert state.counts["missed"] == 3
    prior, network = paper_model.members[0].priors[2], paper_model.members[0].networks["encoder"]
    latents = [posterior(network.run(w.features.ravel().astype(np.float32), network.first_memory())[0]) for w in stream]
    belief = initial_belief(prior)
    for latent, covariance in latents[:3]:
        belief = update(prior, belief, latent, covariance)
    blank = np.zeros((4, prior.chain.components))
    blank[3] = prior.explain(*latents[6]).log_emissions
    after = run_filter(prior.chain, blank, belief.memory.copy())
    np.testing.assert_allclose(answers[3].belief, after.weights[3], atol=CLOSE)


def test_an_unknown_interaction_lists_the_known_ones(paper_model):
    with pytest.raises(SetupError, match="did you mean 'hand_wave'") as caught:
        Inference(paper_model, "hand_waive")
    assert "parachute" in str(caught.value)


def test_motion_that_underflows_everywhere_is_counted_and_does_not_change_the_belief():
    of = manifest((paper_member(hidden=(20, 12)),), components=4)
    arrays = random_arrays(of)
    # An encoder that is always sure: random ones get less sure the farther away they look.
    arrays["member_0.encoder.hidden_2.weight"][:, 5:] = 0.0
    arrays["member_0.encoder.hidden_2.bias"][5:] = 0.1
    for interaction in ("rocket", "auto"):
        stage = Inference(build_model(of, arrays), interaction)
        state, _ = run(stage, windows(5))
        far = FeatureWindow(state.stamp_ns + PERIOD_NS, "arm", JOINTS, np.full((40, 9), 1e4))
        after, (motion,) = stage.step(state, far, 0)
        assert motion.out_of_distribution >= 2.0
        assert motion.interaction == ("rocket" if interaction == "rocket" else "")
        assert after.counts["unknown"] == 1 + state.counts.get("unknown", 0)
        assert np.isfinite(motion.positions).all()
        np.testing.assert_array_equal(after.recognition.evidence, state.recognition.evidence)


def test_what_underflows_is_unknown_however_wide_the_known_latents_lie():
    of = manifest((paper_member(hidden=(20, 12)),), components=4)
    arrays = random_arrays(of) | {"member_0.latent_radius": np.full(4, 1e12)}
    arrays["member_0.encoder.hidden_2.weight"][:, 5:] = 0.0
    arrays["member_0.encoder.hidden_2.bias"][5:] = 0.1
    stage = Inference(build_model(of, arrays), "rocket")
    state, (known,) = run(stage, windows(1))
    far = FeatureWindow(state.stamp_ns + PERIOD_NS, "arm", JOINTS, np.full((40, 9), 1e4))
    _, (motion,) = stage.step(state, far, 0)
    assert known.out_of_distribution < 1e-6
    assert motion.out_of_distribution == 2.0


def test_a_jump_in_time_forgets_the_person_and_not_where_the_robot_stood(paper_model):
    gains, one = (np.zeros((4, 7, 7)) for _ in range(2)), np.array([1.0])
    model = replace(paper_model, start_pose=StartPose(np.zeros((4, 7)), one, *gains, one, one))
    stage, names = Inference(model, "rocket"), model.manifest.controlled.joint_names
    measured = JointMeasurement(10**9 - PERIOD_NS, names, np.linspace(0.1, 0.7, 7))
    state, _ = stage.step(stage.init(), measured, 0)
    state, _ = run(stage, windows(5), state)
    for jump_ns in (100 * PERIOD_NS, -(10**8)):
        after, _ = run(stage, windows(1, first_ns=state.stamp_ns + jump_ns), state)
        np.testing.assert_array_equal(after.start, measured.positions_rad)
        assert after.counts["accepted"] == 6


def test_evidence_names_the_interaction_whose_motion_it_is():
    """Four priors at four places of the latent, and a person at the third."""
    of = manifest((paper_member(hidden=(20, 12)),), components=4)
    arrays, stream = random_arrays(of), windows(40)
    model = build_model(of, arrays)
    network = model.members[0].networks["encoder"]
    latents = np.array(
        [posterior(network.run(w.features.ravel().astype(np.float32), network.first_memory())[0])[0] for w in stream]
    )
    for index, name in enumerate(INTERACTIONS):
        place = np.concatenate([latents.mean(axis=0), np.zeros(5)])
        place[0] += 3.0 * (index - 2)
        arrays[f"member_0.prior.{name}.means"] = np.tile(place, (4, 1))
        arrays[f"member_0.prior.{name}.covariances"] = np.tile(np.eye(10), (4, 1, 1))
    stage = Inference(build_model(of, arrays))
    first, answers = run(stage, stream)
    assert (answers[0].interaction, answers[-1].interaction) == ("", "rocket")
    assert answers[-1].probability > 0.9
    assert first.recognition.probabilities.sum() == pytest.approx(1.0, abs=1e-12)
    assert first.recognition.likeliest == 2
    # Far from all that the model knows it is the likeliest one all the same, and is not named.
    strange = Inference(build_model(of, arrays | {"member_0.latent_radius": np.full(4, 1e-6)}))
    _, unknown = run(strange, stream)
    assert unknown[-1].probability == answers[-1].probability
    assert unknown[-1].out_of_distribution > 1.0
    assert unknown[-1].interaction == ""


def test_a_recogniser_replaces_the_priors_without_a_given_interaction(full_model):
    state, _ = run(Inference(full_model), windows(1))
    values = windows(1)[0].features.ravel().astype(np.float32)
    evidence = np.zeros(len(INTERACTIONS))
    for member in full_model.members:
        logits = member.networks["recogniser"].run(values, np.zeros(0, np.float32))[0].astype(np.float64)
        evidence += (logits - np.log(np.exp(logits).sum())) / len(full_model.members)
    expected = full_model.temper * (evidence - evidence.max())
    np.testing.assert_allclose(state.recognition.evidence, expected, atol=CLOSE)
    conditioned, _ = run(Inference(full_model, "rocket"), windows(1))
    np.testing.assert_array_equal(conditioned.recognition.probabilities, np.eye(len(INTERACTIONS))[2])

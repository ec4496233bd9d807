# SPDX-License-Identifier: Apache-2.0
"""Recognising gestures of people who were never recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mild_core.inference.gesture_recogniser import (
    CAUTIOUS_S,
    FEATURES,
    GESTURES,
    MEMORY,
    PERIOD_NS,
    RATE_HZ,
    GestureRecogniser,
    GestureState,
    features_of,
    gesture_classes,
    unit_arm,
)
from mild_core.inference.model import load_model
from mild_core.inference.recognition import recognise, uniform_belief
from mild_core.inference.stage import Inference
from mild_core.learning.training.gestures import GestureSettings, background_arms
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.shapes import FloatArray
from mild_core.signals import NAMED, NONE, OFFERED, FeatureWindow

ROOT = Path(__file__).resolve().parent.parent.parent.parent


@pytest.fixture(scope="module")
def shipped() -> GestureRecogniser:
    found = load_model(ROOT / "models" / "yumi_buetepage_ahead").gestures
    assert found is not None
    return found


def played(recogniser: GestureRecogniser, frames: FloatArray, period_ns: int = PERIOD_NS) -> list[GestureState]:
    state, states = recogniser.init(), []
    for index, arm in enumerate(frames):
        state = recogniser.step(state, arm, 10**9 + index * period_ns)
        states.append(state)
    return states


def waving(frames: int, rate_hz: float = 20.0) -> FloatArray:
    """A person who raises the hand beside the head and waves."""
    times = np.arange(frames) / rate_hz
    share = np.clip((times - 1.5) / 0.8, 0.0, 1.0)[:, None]
    share = share * share * (3.0 - 2.0 * share)
    swing = 0.25 * np.sin(2.0 * np.pi * 1.6 * times)[:, None] * (share > 0.9)
    hand = (1.0 - share) * np.array([0.15, -0.1, -0.95]) + share * np.array([0.35, -0.1, 0.35])
    hand = hand + swing * np.array([0.0, 1.0, 0.0])
    elbow = (1.0 - share) * np.array([0.0, -0.1, -0.43]) + share * np.array([0.3, -0.2, -0.2])
    return unit_arm(np.stack([np.zeros_like(hand), elbow, hand], axis=1), 1.0)


def test_a_wave_is_recognised_and_nothing_is_while_the_hand_rests(shipped: GestureRecogniser) -> None:
    states = played(shipped, waving(120))
    assert not any(state.started for state in states[:30])
    assert states[29].active_s == 0.0
    assert states[-1].started
    assert GESTURES[int(states[-1].evidence.argmax())] == "wave"


@pytest.mark.parametrize("rate_hz", [8.0, 9.2, 30.0, 40.0])
def test_the_rate_of_the_model_beside_it_changes_little(shipped: GestureRecogniser, rate_hz: float) -> None:
    """It samples at its own rate: interpolated in between, never extrapolated."""
    state = played(shipped, waving(round(6 * rate_hz), rate_hz), round(1e9 / rate_hz))[-1]
    assert state.started
    assert GESTURES[int(state.evidence.argmax())] == "wave"


def test_a_tracker_at_half_the_rate_is_interpolated(shipped: GestureRecogniser) -> None:
    """Every second frame of a motion that is straight between them says as much as all frames."""
    seen = waving(121)[::2]
    between = (seen[:-1] + seen[1:]) / 2
    all_frames = np.concatenate([np.stack([seen[:-1], between], axis=1).reshape(-1, *seen.shape[1:]), seen[-1:]])
    half, whole = played(shipped, seen, 2 * PERIOD_NS)[-1], played(shipped, all_frames)[-1]
    np.testing.assert_allclose(half.units, whole.units, atol=1e-9)
    np.testing.assert_allclose(half.evidence, whole.evidence, atol=1e-9)


def test_people_who_walk_start_nothing(shipped: GestureRecogniser) -> None:
    """Of six kinds of background the first swings its arms; others come near to gestures."""
    arms = background_arms(240, seed=7)[::6]
    assert sum(any(state.started for state in played(shipped, frames)) for frames in arms) <= 1


def test_features_do_not_depend_on_where_the_person_walks() -> None:
    """Rest, distance and velocities are the shoulder's: a walk moves the whole arm."""
    frames = waving(80)
    walk = np.linspace(0.0, 3.0, 80)[:, None, None] * np.array([1.0, 0.4, 0.0])
    still, walked = features_of(frames, np.zeros(MEMORY)), features_of(frames + walk, np.zeros(MEMORY))
    assert still.shape == (80, FEATURES)
    np.testing.assert_allclose(walked, still, atol=1e-9)


def test_maxima_begin_again_after_a_second_at_rest() -> None:
    frames = np.concatenate([waving(100), np.repeat(waving(1), 60, axis=0)])
    features = features_of(frames, np.zeros(MEMORY))
    assert features[99, 29] > 0.8  # the largest distance
    assert features[-1, 29] < 0.2


def test_steps_one_by_one_equal_a_whole_track(shipped: GestureRecogniser) -> None:
    frames = waving(90)
    rows, activations = shipped.activate(frames, np.zeros(MEMORY), None)
    state = played(shipped, frames)[-1]
    np.testing.assert_allclose(state.units, activations[-1], atol=1e-9)
    assert state.distance == pytest.approx(rows[-1, 24] * shipped.deviation[24] + shipped.mean[24])


def test_who_walks_starts_nothing(shipped: GestureRecogniser) -> None:
    walk = np.linspace(0.0, 9.0, 120)[:, None, None] * np.array([1.0, 0.0, 0.0])
    assert not any(state.started for state in played(shipped, waving(120) + walk))


def test_an_unfamiliar_motion_is_given_up_after_two_seconds(shipped: GestureRecogniser) -> None:
    strict = replace(shipped, bounds=np.array([shipped.bounds[0], 0.999]))
    states = played(strict, waving(140))
    assert any(state.started for state in states)
    assert not states[-1].started


def test_the_rest_is_remembered_over_a_gap(shipped: GestureRecogniser) -> None:
    """Who holds the hand out when they are seen again does not rest there."""
    frames = waving(120)
    before = played(shipped, frames[:40])[-1]
    state = shipped.after_gap(before)
    for index, arm in enumerate(frames[80:]):
        state = shipped.step(state, arm, 2 * 10**9 + index * PERIOD_NS)
    assert state.active_s > 1.0
    assert state.started
    for index in range(40):
        state = shipped.step(state, frames[0], 5 * 10**9 + index * PERIOD_NS)
    assert state.active_s == 0.0
    assert played(shipped, frames[80:])[-1].distance < 0.5, "without memory the wave is its rest"


def test_a_hand_that_hangs_still_rests_wherever_it_was_first_seen(shipped: GestureRecogniser) -> None:
    """A node that starts while a hand is held out takes its place for the rest until it has been lowered."""
    frames = waving(120)
    track = np.concatenate([frames[80:], np.repeat(frames[:1], 30, axis=0), frames[20:]])
    states = played(shipped, track)
    lowered = states[len(frames[80:]) + 29]
    assert lowered.active_s == 0.0
    assert states[-1].started
    assert GESTURES[int(states[-1].evidence.argmax())] == "wave"


def test_a_given_interaction_is_never_called_into_question() -> None:
    """Nothing that a person does keeps the robot from an interaction that an operator has given."""
    model = load_model(ROOT / "models" / "yumi_buetepage_ahead")
    manifest = model.manifest
    rng, scores = np.random.default_rng(0), {}
    for interaction in ("handshake", "auto"):
        stage = Inference(model, interaction)
        state = stage.init()
        for index in range(200):
            features = rng.normal(size=(manifest.window, manifest.frame_values))
            window = FeatureWindow(10**9 + index * 25_000_000, "", manifest.observed.joint_names, features)
            state, (motion,) = stage.step(state, window, window.stamp_ns)
        scores[interaction] = motion.out_of_distribution, motion.interaction
    assert scores["auto"][0] > 1.0
    assert scores["handshake"][0] <= RetargetingSettings().known_below
    assert scores["handshake"][1] == "handshake"


def test_interactions_without_a_class_are_refused_by_name() -> None:
    assert gesture_classes(("hand_wave", "waving", "rocket")).tolist() == [0, 0, 2]
    with pytest.raises(ValueError, match="highfive"):
        gesture_classes(("wave", "highfive"))


def test_settings_are_those_the_shipped_recogniser_was_learned_with(shipped: GestureRecogniser) -> None:
    settings = GestureSettings()
    assert len(shipped.leak) == settings.units
    assert shipped.bounds[0] == pytest.approx(settings.start_log_odds)


def test_with_caution_a_person_starts_later_and_only_by_name(shipped: GestureRecogniser) -> None:
    first = {}
    for cautious in (False, True):
        state = shipped.init()
        for index, arm in enumerate(waving(120)):
            state = shipped.step(state, arm, 10**9 + index * PERIOD_NS, cautious)
            if state.started:
                first.setdefault(cautious, index)
    assert first[True] >= first[False] + CAUTIOUS_S * RATE_HZ / 2
    model = load_model(ROOT / "models" / "yumi_buetepage_ahead")
    for cautious in (False, True):
        stage = Inference(model, cautious=cautious)
        assert stage._may_start(OFFERED, 0.1, None) is not cautious
        assert stage._may_start(NAMED, 0.1, None)


def test_how_familiar_a_motion_is_does_not_saturate(shipped: GestureRecogniser) -> None:
    """Probabilities of a readout whose logits are half as large say nearly the same of a wave, its logits do not."""
    doubtful = replace(shipped, weight=0.5 * shipped.weight, bias=0.5 * shipped.bias)
    sure, doubted = (played(each, waving(100))[-1] for each in (shipped, doubtful))
    assert sure.familiar > 0.5
    assert doubted.familiar_nats == pytest.approx(0.5 * sure.familiar_nats, rel=1e-6)
    assert doubted.familiar < sure.familiar
    assert played(shipped, np.repeat(waving(1), 40, axis=0))[-1].familiar == 1.0


def held_out(frames: int, rate_hz: float = 20.0) -> FloatArray:
    """A person who raises the hand to where it could wave, and keeps it there."""
    waved = waving(frames, rate_hz)
    risen = round(2.4 * rate_hz)
    return np.concatenate([waved[:risen], np.repeat(waved[risen : risen + 1], frames - risen, axis=0)])


def test_a_hand_that_is_held_out_is_no_wave_and_stays_offered(shipped: GestureRecogniser) -> None:
    noise = 0.02 * np.random.default_rng(0).normal(size=(160, 1, 3)) * np.array([[0.0], [0.0], [1.0]])
    for arm in (held_out(160), held_out(160) + noise):
        states = played(shipped, arm)
        assert not any(state.held for state in states[:48])
        assert all(state.held for state in states[80:])
    assert not any(state.held for state in played(shipped, waving(160)))
    back = np.concatenate([held_out(100), np.repeat(waving(1), 60, axis=0)])
    assert not played(shipped, back)[-1].held


def test_a_held_hand_is_not_named_a_wave() -> None:
    stage = Inference(load_model(ROOT / "models" / "yumi_buetepage_ahead"))
    rest = stage.model.gestures
    assert rest is not None
    waves = replace(played(rest, waving(80))[-1], started=True)
    own = recognise(uniform_belief(4), np.zeros(4), 1.0, 0.0)
    wave = stage.model.manifest.interactions.index("hand_wave")
    assert stage._carried_over(own, 0.9, waves)[0].likeliest == wave
    held = replace(waves, held=True)
    recognition, _ = stage._carried_over(own, 0.9, held)
    assert recognition.probabilities[wave] == 0.0
    late = replace(held, active_s=5.0, started=False)
    before = stage.init()
    doubtful = replace(recognition, probabilities=np.full(4, 0.25))
    assert stage._state_name(doubtful, False, late, before) == OFFERED
    assert stage._carried_over(own, 2.0, late)[1] <= 0.5
    assert stage._state_name(doubtful, False, replace(late, held=False), before) == NONE

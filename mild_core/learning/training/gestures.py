# SPDX-License-Identifier: Apache-2.0
"""Learn the gesture recogniser from every human arm at hand, of either person, whatever the partner was.

Recordings are few and their people fewer, so each arm is augmented: another speed and style, another reach and height
of the meeting point, another yaw and pitch of the body, and a time of standing before, so that no clock is learned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]  # scipy brings no types
from torch.nn import functional

from mild_core.inference.gesture_recogniser import (
    AT_REST,
    FEATURES,
    FOREARM,
    GESTURES,
    MEMORY,
    RATE_HZ,
    SAME,
    UPPER_ARM,
    GestureRecogniser,
    features_of,
    unit_arm,
)
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.recording import Recording
from mild_core.learning.datasets import DATASETS
from mild_core.shapes import FloatArray


@dataclass(frozen=True)
class GestureSettings:
    """How the recogniser is learned; chosen by leaving out one data set at a time.

    Attributes:
        units: R, of the reservoir.
        time_constants_s: Of its units, drawn evenly.
        copies: Augmented copies of each arm; the first stays as it was recorded.
        warp: Range of the factor of time.
        unsteadiness: Deviation of the logarithm of the speed within a motion.
        yaw_rad, pitch_rad: Largest turns of the body.
        reach: Range of the factor of the hand's way from its rest.
        aside: Deviation of the meeting point, across and along [arm lengths].
        height: Largest shift of the meeting point's height [arm lengths].
        style: Deviation of a slow random wander of hand and elbow [arm lengths].
        noise: Largest deviation of the tracker's noise [arm lengths]; drawn for each copy.
        background: Synthetic arms that do none of the gestures.
        start_log_odds: Of a known gesture against rest and background, from which it may start.
        familiar: Least `GestureState.familiar` of a known gesture two seconds after its beginning: a twentieth of the
            known ones of people left out lie below.
        standing_s: Longest time of standing before a motion.
        epochs: Passes over all samples.
        learning_rate: Of AdamW at its start.
        weight_decay: Of AdamW.
        seed: Of all draws.
    """

    units: int = 320
    time_constants_s: tuple[float, ...] = (0.12, 0.3, 0.7, 1.5)
    copies: int = 12
    warp: tuple[float, float] = (0.7, 1.4)
    unsteadiness: float = 0.12
    yaw_rad: float = 0.35
    pitch_rad: float = 0.21
    reach: tuple[float, float] = (0.6, 1.4)
    aside: float = 0.05
    height: float = 0.15
    style: float = 0.07
    noise: float = 0.012
    background: int = 1500
    start_log_odds: float = 0.5
    familiar: float = 0.5
    standing_s: float = 2.0
    epochs: int = 12
    learning_rate: float = 0.004
    weight_decay: float = 0.02
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Arm:
    """One human arm of a recording.

    Attributes:
        source: Name of the data set.
        gesture: What it does; may be none of GESTURES.
        frames: (T, 3, 3) of `unit_arm`, at RATE_HZ.
    """

    source: str
    gesture: str
    frames: FloatArray


RECORDINGS = ("buetepage_hr", "nuisi", "nuisi_v1")
"""Data sets with human arms that do the gestures."""


def arms_at_hand() -> tuple[list[Arm], list[Recording]]:
    """The arms of all recordings that are on this machine, and which those are."""
    arms, found = [], []
    for name in RECORDINGS:
        recording = DATASETS[name]
        path = recording.default_path()
        if path.is_file():
            arms += arms_of(name, recording.read(path).split("train"))
            found.append(recording)
    return arms, found


def arms_of(source: str, demonstrations: Sequence[Demonstration]) -> list[Arm]:
    """All human arms of a recording: the observed one, and the partner's where that is a person."""
    found = []
    for trial in demonstrations:
        gesture = SAME.get(trial.interaction, trial.interaction)
        for arm_m in (trial.observed_m, *((trial.controlled,) if trial.partner else ())):
            found.append(Arm(source, gesture, _at_rate(_in_arm_lengths(arm_m), trial.rate_hz)))
    return found


def _in_arm_lengths(arm_m: FloatArray) -> FloatArray:
    lengths = np.median(np.linalg.norm(np.diff(arm_m, axis=1), axis=2), axis=0)
    return unit_arm(arm_m - arm_m[0, 0], float(lengths.sum()))


def _at_rate(frames: FloatArray, rate_hz: float) -> FloatArray:
    times = np.arange(len(frames)) / rate_hz
    return _interpolated(frames, times, np.arange(0.0, times[-1] + 1e-9, 1.0 / RATE_HZ))


def _interpolated(frames: FloatArray, times: FloatArray, wanted: FloatArray) -> FloatArray:
    columns = frames.reshape(len(frames), -1).T
    return np.stack([np.interp(wanted, times, column) for column in columns], axis=1).reshape(len(wanted), 3, 3)


def augment(frames: FloatArray, settings: GestureSettings, rng: np.random.Generator) -> FloatArray:
    """The same gesture by another person (T', 3, 3)."""
    speed = rng.uniform(*settings.warp) * np.exp(
        np.interp(
            np.arange(len(frames)), np.linspace(0, len(frames) - 1, 4), rng.normal(size=4) * settings.unsteadiness
        )
    )
    times = np.cumsum(speed) - speed[0]
    frames = _interpolated(frames, times, np.arange(max(4, int(times[-1])), dtype=np.float64))
    shoulder, elbow, hand = frames[:, 0], frames[:, 1], frames[:, 2]
    rest = np.median(hand[:5], axis=0)
    away = np.linalg.norm(hand - rest, axis=1)
    raised = np.clip(away / (0.8 * max(float(away.max()), 0.05)), 0.0, 1.0)[:, None]
    turn = _turned(rng.uniform(-1, 1) * settings.yaw_rad, rng.uniform(-1, 1) * settings.pitch_rad)
    turned_rest = turn @ (rest - shoulder[0]) + shoulder[0]
    new_rest = rest + rng.uniform() * (turned_rest - rest)
    sideways, across = rng.normal(size=2) * settings.aside
    moved = raised * np.array([sideways, across, rng.uniform(-1, 1) * settings.height])
    hand = (hand - shoulder) @ turn.T + shoulder
    hand = new_rest + rng.uniform(*settings.reach) * (hand - turned_rest) + moved
    hand = hand + _wander(len(frames), settings.style, rng) * np.clip(0.3 + raised, 0.0, 1.0)
    elbow = (elbow - shoulder) @ turn.T + shoulder + _wander(len(frames), settings.style, rng)
    return bent_to(shoulder, elbow, hand)


def _turned(yaw: float, pitch: float) -> FloatArray:
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    turn: FloatArray = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]]
    )
    return turn


def _wander(frames: int, deviation: float, rng: np.random.Generator, knot_s: float = 0.8) -> FloatArray:
    """(T, 3) a slow random walk without drift."""
    knots = max(2, int(frames / RATE_HZ / knot_s) + 2)
    curve = CubicSpline(np.arange(knots), rng.normal(size=(knots, 3)) * deviation)
    wander: FloatArray = curve(np.linspace(0, knots - 1, frames))
    return wander


def bent_to(shoulder: FloatArray, elbow: FloatArray, hand: FloatArray) -> FloatArray:
    """(T, 3, 3) arms of the right bone lengths: the hand pulled within reach, the elbow nearest to where it was."""
    away = hand - shoulder
    reach = np.linalg.norm(away, axis=1)
    bounded = np.clip(reach, abs(UPPER_ARM - FOREARM) + 0.02, 0.995 * (UPPER_ARM + FOREARM))
    along = away / np.maximum(reach, 1e-9)[:, None]
    foot = (UPPER_ARM**2 - FOREARM**2 + bounded**2) / (2.0 * bounded)
    height = np.sqrt(np.maximum(UPPER_ARM**2 - foot**2, 1e-8))
    out = _across(elbow - shoulder, along)
    down = _across(np.broadcast_to([0.0, 0.0, -1.0], along.shape), along)
    length = np.linalg.norm(out, axis=1, keepdims=True)
    out = np.where(length > 1e-3, out / np.maximum(length, 1e-9), down)
    elbow = shoulder + foot[:, None] * along + height[:, None] * out
    return np.stack([shoulder, elbow, shoulder + bounded[:, None] * along], axis=1)


def _across(vector: FloatArray, along: FloatArray) -> FloatArray:
    """The part of vectors (T, 3) across unit vectors (T, 3)."""
    across: FloatArray = vector - (vector * along).sum(axis=1, keepdims=True) * along
    return across


def has_left_rest(frames: FloatArray) -> FloatArray:
    """(T,) whether the hand is away from where it rested at first."""
    hand = frames[:, 2] - frames[:, 0]
    away: FloatArray = np.linalg.norm(hand - np.median(hand[:5], axis=0), axis=1) > AT_REST
    return away


def train_gestures(
    arms: Sequence[Arm], background: Sequence[FloatArray], settings: GestureSettings
) -> GestureRecogniser:
    """Learn a recogniser.

    Args:
        arms: Of GESTURES; others are left out.
        background: (T, 3, 3) arms that do none of them, see `background_arms`.
        settings: How.

    Raises:
        ValueError: A gesture is never shown.
    """
    rng = np.random.default_rng(settings.seed)
    known = [arm for arm in arms if arm.gesture in GESTURES]
    missing = set(GESTURES) - {arm.gesture for arm in known}
    if missing:
        raise ValueError(f"no arm does {', '.join(sorted(missing))}")
    tracks: list[tuple[FloatArray, FloatArray, tuple[str, str]]] = []
    for arm in known:
        for copy in range(settings.copies):
            frames = augment(arm.frames, settings, rng) if copy else arm.frames
            label = np.where(has_left_rest(frames), GESTURES.index(arm.gesture), len(GESTURES))
            tracks.append((*_standing(frames, label, settings, rng), (arm.source, arm.gesture)))
    for frames in background:
        label = np.where(has_left_rest(frames), len(GESTURES) + 1, len(GESTURES))
        tracks.append((*_standing(frames, label, settings, rng), ("", "background")))
    rows = [features_of_track(frames, settings, rng) for frames, _, _ in tracks]
    shown = np.concatenate([row for row, (_, _, owner) in zip(rows, tracks, strict=True) if owner[0]])
    recogniser = _drawn(shown.mean(axis=0), shown.std(axis=0) + 1e-3, settings)
    groups: dict[tuple[str, str], int] = {}
    for _, _, owner in tracks:
        groups[owner] = groups.get(owner, 0) + 1
    inputs, labels, weights = [], [], []
    for row, (_, label, owner) in zip(rows, tracks, strict=True):
        taken = slice(int(rng.integers(3)), None, 3)
        active = label != len(GESTURES)
        share = (2.0 if owner[1] == "background" else 1.0) / (groups[owner] * max(int(active.sum()), 20))
        inputs.append(_seen(recogniser, row)[taken].astype(np.float32))
        labels.append(label[taken])
        weights.append((np.where(active, 1.0, 0.6) * share)[taken])
    seen, label, weight = np.concatenate(inputs), np.concatenate(labels), np.concatenate(weights)
    gestures = label <= len(GESTURES)
    source = np.concatenate([np.full(len(one), bool(track[2][0])) for one, track in zip(labels, tracks, strict=True)])
    novelty = _readout(seen[gestures & source], label[gestures & source], weight[gestures & source], settings, 0)
    permission = _readout(seen, label, weight, settings, 1) if len(background) else _without_background(novelty)
    return replace(
        recogniser,
        weight=novelty[0],
        bias=novelty[1],
        permission_weight=permission[0],
        permission_bias=permission[1],
    )


def _standing(
    frames: FloatArray, label: FloatArray, settings: GestureSettings, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """A track with a time of standing before it."""
    count = int(rng.uniform(0.0, settings.standing_s) * RATE_HZ)
    return np.concatenate([np.repeat(frames[:1], count, axis=0), frames]), np.concatenate(
        [[len(GESTURES)] * count, label]
    )


def features_of_track(frames: FloatArray, settings: GestureSettings, rng: np.random.Generator) -> FloatArray:
    """(T, FEATURES) of a track as a noisy tracker sees it."""
    noisy = frames.copy()
    noisy[:, 1:] += rng.normal(size=noisy[:, 1:].shape) * rng.uniform(0.0, settings.noise)
    return features_of(noisy, np.zeros(MEMORY))


def _drawn(mean: FloatArray, deviation: FloatArray, settings: GestureSettings) -> GestureRecogniser:
    """A recogniser with a random reservoir and readouts of zeros."""
    rng, units = np.random.default_rng(settings.seed), settings.units
    intake = rng.normal(size=(FEATURES, units)) * (rng.random((FEATURES, units)) < 0.3) * 0.55
    sources = rng.integers(0, units, (8, units))
    strengths = rng.normal(size=(8, units)) * 0.9 / np.sqrt(8)
    constants = np.array(settings.time_constants_s)[rng.integers(0, len(settings.time_constants_s), units)]
    classes, seen = len(GESTURES), units + FEATURES
    return GestureRecogniser(
        mean=mean,
        deviation=deviation,
        intake=np.vstack([intake, rng.normal(size=units) * 0.2]),
        sources=sources.astype(np.float64),
        strengths=strengths,
        leak=1.0 - np.exp(-1.0 / (RATE_HZ * constants)),
        weight=np.zeros((seen, classes + 1)),
        bias=np.zeros(classes + 1),
        permission_weight=np.zeros((seen, classes + 2)),
        permission_bias=np.zeros(classes + 2),
        bounds=np.array([settings.start_log_odds, settings.familiar]),
    )


def _seen(recogniser: GestureRecogniser, features: FloatArray) -> FloatArray:
    """(T, R + F) what the readouts see of a track's features."""
    rows = (features - recogniser.mean) / recogniser.deviation
    return np.hstack([recogniser.activations(rows, None), rows])


def _readout(
    seen: NDArray[np.float32], label: FloatArray, weight: FloatArray, settings: GestureSettings, draw: int
) -> tuple[FloatArray, FloatArray]:
    """Weight and bias of a multinomial readout."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed * 2 + draw)
        classes = len(GESTURES) + 1 + draw
        inputs, wanted = torch.from_numpy(seen), torch.from_numpy(label.astype(np.int64))
        share = torch.from_numpy((weight / weight.mean()).astype(np.float32))
        layer = torch.nn.Linear(inputs.shape[1], classes)
        optimiser = torch.optim.AdamW(layer.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay)
        batches = len(inputs) // 2048 + 1
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, settings.epochs * batches)
        for _ in range(settings.epochs):
            for chosen in torch.split(torch.randperm(len(inputs)), 2048):
                loss = functional.cross_entropy(layer(inputs[chosen]), wanted[chosen], reduction="none") * share[chosen]
                optimiser.zero_grad()
                loss.mean().backward()  # type: ignore[no-untyped-call]
                optimiser.step()
                schedule.step()
        return layer.weight.detach().double().numpy().T.copy(), layer.bias.detach().double().numpy()


def _without_background(novelty: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """The permission readout of a recogniser that was shown no background: it never sees one."""
    weight, bias = novelty
    return np.hstack([weight, np.zeros((len(weight), 1))]), np.append(bias, -20.0)


def background_arms(count: int, seed: int) -> list[FloatArray]:
    """Arms (T, 3, 3) of people who do none of the gestures, made from kinematics alone.

    Walking with a swinging arm, reaching for things wherever an arm reaches, scratching, carrying and fidgeting: what
    people do who are not concerned with the robot.
    """
    rng = np.random.default_rng(seed)
    kinds = (_swinging, _reaching, _handing, _scratching, _handing, _fidgeting)
    return [_jumping(_turning(kinds[index % len(kinds)](rng), rng), rng) for index in range(count)]


def _jumping(frames: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The arm as a tracker shows it that takes another thing for elbow and hand now and then, or trembles."""
    if rng.uniform() < 0.5:
        return frames
    offset = np.zeros((len(frames), 2, 3))
    for _ in range(int(rng.integers(1, 5))):
        begin = int(rng.integers(0, len(frames)))
        offset[begin : begin + int(rng.integers(2, 12))] += rng.normal(size=(2, 3)) * rng.uniform(0.02, 0.25)
    offset += rng.normal(size=offset.shape) * rng.uniform(0.0, 0.03)
    ramp = np.clip(np.arange(len(frames)) / RATE_HZ - 0.3, 0.0, 1.0)[:, None, None]
    moved = frames[:, 1:] + offset * ramp
    return bent_to(frames[:, 0], moved[:, 0], moved[:, 1])


def _turning(frames: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The arm of a person who turns: its frame stays that of the neutral pose."""
    if rng.uniform() < 0.4:
        return frames
    yaw = _wander(len(frames), rng.uniform(0.1, 0.8), rng, knot_s=2.0)[:, 0]
    yaw = (yaw - yaw[0]) * np.clip(np.arange(len(yaw)) / RATE_HZ / 0.5, 0.0, 1.0)
    x, y, z = np.moveaxis(frames - frames[:, :1], 2, 0)
    cosine, sine = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    turned: FloatArray = np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=2) + frames[:, :1]
    return turned


def hanging(rng: np.random.Generator) -> FloatArray:
    """(3,) a hand that hangs beside the body [arm lengths], from the shoulder."""
    return np.array([rng.uniform(-0.05, 0.35), rng.uniform(-0.2, 0.05), -rng.uniform(0.85, 0.97)])


def arm_to(hand: FloatArray, shoulder: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Arms with the hand there; the elbow hangs, a little outwards."""
    outwards = np.array([rng.uniform(-0.3, 0.1), -rng.uniform(0.0, 0.7), -1.0])
    hand = hand + _wander(len(hand), 0.012, rng)
    return bent_to(shoulder, shoulder + 0.5 * (hand - shoulder) + 0.3 * outwards, hand)


def _swinging(rng: np.random.Generator) -> FloatArray:
    """Walking."""
    duration_s, step_hz = rng.uniform(4.0, 9.0), rng.uniform(0.7, 1.1)
    times = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    ramp = np.clip((times - rng.uniform(0.0, 0.8)) / 0.8, 0.0, 1.0)
    angle = ramp * rng.uniform(0.15, 0.6) * np.sin(2 * np.pi * step_hz * times + rng.uniform(0, 6.3))
    angle = angle + ramp * rng.uniform(0.0, 0.2)
    rest = hanging(rng)
    reach = float(np.linalg.norm(rest)) * (1.0 - 0.08 * np.maximum(angle, 0.0))
    tilt = np.arctan2(rest[0], -rest[2]) + angle
    hand = np.stack([reach * np.sin(tilt), np.full_like(tilt, rest[1]), -reach * np.cos(tilt)], axis=1)
    shoulder = np.cumsum(ramp)[:, None] / RATE_HZ * rng.uniform(0.0, 1.8) * np.array([1.0, 0.0, 0.0])
    shoulder = shoulder + (ramp * 0.03 * np.sin(4 * np.pi * step_hz * times))[:, None] * np.array([0.0, 0.0, 1.0])
    return arm_to(hand + shoulder, shoulder, rng)


def _reaching(rng: np.random.Generator) -> FloatArray:
    """To one to three places, with a stay at each, and back."""
    rest = hanging(rng)
    places, stays = [_somewhere(rng) if rng.uniform() < 0.3 else rest], [rng.uniform(0.1, 1.0)]
    for _ in range(int(rng.integers(1, 4))):
        places.append(_somewhere(rng))
        stays.append(rng.uniform(0.1, 2.5))
    if rng.uniform() < 0.7:
        places, stays = [*places, rest], [*stays, rng.uniform(0.3, 1.0)]
    hand = through(places, stays, rng)
    return arm_to(hand, leaning(hand, rng), rng)


def _handing(rng: np.random.Generator) -> FloatArray:
    """Walking up, passing or taking a thing before the body, and walking on."""
    rest = hanging(rng)
    azimuth, elevation, reach = rng.uniform(-1.1, 0.8), rng.uniform(-0.8, 0.25), rng.uniform(0.5, 0.99)
    place = reach * np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    carried = np.array([rng.uniform(0.2, 0.8), rng.uniform(-0.5, 0.35), -rng.uniform(0.1, 0.7)])
    places, stays = [carried if rng.uniform() < 0.4 else rest], [rng.uniform(0.1, 1.2)]
    if rng.uniform() < 0.5:
        places, stays = [*places, carried], [*stays, rng.uniform(0.1, 2.0)]
    places, stays = [*places, place], [*stays, rng.uniform(0.1, 1.8)]
    if rng.uniform() < 0.5:
        places, stays = [*places, carried], [*stays, rng.uniform(0.1, 1.5)]
    if rng.uniform() < 0.7:
        places, stays = [*places, rest], [*stays, rng.uniform(0.2, 2.0)]
    hand = through(places, stays, rng)
    times = np.arange(len(hand)) / RATE_HZ
    handled = np.clip(np.linalg.norm(hand - rest, axis=1) / 0.4, 0.0, 1.0)[:, None]
    hand = hand + handled * _wander(len(hand), rng.uniform(0.0, 0.06), rng, knot_s=rng.uniform(0.15, 0.5))
    arrived_s = times[int(np.linalg.norm(hand - place, axis=1).argmin())] - rng.uniform(0.0, 1.0)
    pace = rng.uniform(0.0, 1.8) * np.clip((arrived_s - times) / 0.8, 0.0, 1.0) * np.clip(times / 0.6, 0.0, 1.0)
    leaving = rng.uniform(-1.5, 0.8) * np.clip((times - arrived_s - rng.uniform(0.5, 2.5)) / 0.8, 0.0, 1.0)
    walked = np.cumsum(pace + leaving)[:, None] / RATE_HZ * np.array([1.0, rng.normal() * 0.2, 0.0])
    shoulder = leaning(hand, rng) + walked
    return arm_to(hand + shoulder, shoulder, rng)


def _scratching(rng: np.random.Generator) -> FloatArray:
    """Head, neck, other arm or chest, rubbed a little; or something carried before the body."""
    rest = hanging(rng)
    place = np.array([rng.uniform(0.05, 0.5), rng.uniform(0.0, 0.6), rng.uniform(-0.45, 0.5)])
    place = place / max(1.0, float(np.linalg.norm(place)) / 0.85)
    hand = through([rest, place, rest], [rng.uniform(0.1, 1.0), rng.uniform(0.8, 4.0), 0.5], rng)
    rubbed = np.clip(1.0 - np.linalg.norm(hand - place, axis=1) / 0.1, 0.0, 1.0)
    times = np.arange(len(hand)) / RATE_HZ
    way = rng.normal(size=3)
    rub = rng.uniform(0.0, 0.05) * np.sin(2 * np.pi * rng.uniform(1.5, 4.0) * times) * rubbed
    return arm_to(hand + rub[:, None] * way / np.linalg.norm(way), leaning(hand, rng), rng)


def _fidgeting(rng: np.random.Generator) -> FloatArray:
    """Small movements around the rest."""
    rest = hanging(rng)
    places = [
        rest,
        *(rest + rng.normal(size=3) * np.array([0.2, 0.12, 0.1]) for _ in range(int(rng.integers(1, 4)))),
        rest,
    ]
    hand = through(places, rng.uniform(0.1, 1.5, size=len(places)).tolist(), rng)
    return arm_to(hand, leaning(hand, rng), rng)


def _somewhere(rng: np.random.Generator) -> FloatArray:
    """(3,) a place that an arm reaches."""
    azimuth, elevation, reach = rng.uniform(-1.2, 1.4), rng.uniform(-1.1, 0.8), rng.uniform(0.4, 0.99)
    return reach * np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )


def through(places: Sequence[FloatArray], stays_s: Sequence[float], rng: np.random.Generator) -> FloatArray:
    """(T, 3) a hand that goes from place to place with the least jerk, and stays at each.

    Source: Flash and Hogan, "The coordination of arm movements", J. Neuroscience 1985.
    """
    parts = [np.repeat(places[0][None], max(1, round(stays_s[0] * RATE_HZ)), axis=0)]
    for before, place, stay_s in zip(places, places[1:], stays_s[1:], strict=False):
        way = float(np.linalg.norm(place - before))
        frames = max(3, round((0.35 + way * rng.uniform(0.4, 1.2)) * RATE_HZ))
        share = np.arange(1, frames + 1) / frames
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        bow = rng.normal(size=3) * 0.1 * way * np.sin(np.pi * share)[:, None]
        parts.append(before + share[:, None] * (place - before) + bow)
        parts.append(np.repeat(place[None], max(1, round(stay_s * RATE_HZ)), axis=0))
    return np.concatenate(parts)


def leaning(hand: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(T, 3) a shoulder that follows a far hand a little."""
    away = np.clip(np.linalg.norm(hand - hand[0], axis=1, keepdims=True), 0.0, 1.0)
    leaning: FloatArray = away * rng.uniform(0.0, 0.15) * np.array([1.0, 0.2, -0.3])
    return leaning

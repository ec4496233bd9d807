# SPDX-License-Identifier: Apache-2.0
"""Recognise an interaction from the arm alone, by features that carry over to people who were never recorded.

Where a hand goes differs between people more than how it moves does. So the features are mostly velocities, their
oscillation, and what the hand has done since it left its rest. A reservoir of leaky units remembers them for about two
seconds, and two linear readouts classify the same activations:

    novelty      the known interactions and rest, learned without a background: how far the largest logit of a known one
                 stands out separates foreign motions from known ones
    permission   the same and a background of other movements (reaching, walking, fidgeting): whether to start at all

Everything is relative to the length of the arm, by the directions of its bones, and runs at 20 Hz whatever the rate of
the model beside it.

Source: ours; `docs/strangers.md` has the measurements. Reservoirs: `reservoir.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mild_core.compiled import compiled
from mild_core.inference.novelty_detector import TakeArray
from mild_core.inference.reservoir import SETTLED_S, run_units
from mild_core.shapes import FloatArray, read_only

GESTURES = ("wave", "handshake", "rocket", "parachute")
"""Known interactions, in the order of the recogniser's classes."""

SAME = {"hand_wave": "wave", "waving": "wave"}
"""What recordings call them otherwise."""

RATE_HZ = 20.0
"""Of the features."""

UPPER_ARM, FOREARM = 0.435, 0.565
"""Bones of the arm that features are made of, in arm lengths."""

AT_REST = 0.12
"""Largest distance of a resting hand from its place of rest [arm lengths]."""

FEATURES = 33
"""Values of a frame, see `features_of`."""

MEMORY = 31
"""Values that features remember between frames."""

HANGING, STILL = -0.75, 0.15
"""Height of a hand that hangs [arm lengths from the shoulder], and speed of one that is still [arm lengths/s]."""

GOES_ON, REST_KNOWN = 1.0, 2.0
"""First value of that memory: features go on, or begin again of a person whose place of rest is known; else they begin
with a hand at rest."""

PERIOD_NS = round(1e9 / RATE_HZ)

HAND, DISTANCE, FROM_REST = slice(3, 6), 24, 30
"""Places among the features of the hand, its distance from its rest, and its place seen from there."""

ONSET_DISTANCE = 0.35
"""A hand this far from its rest [arm lengths] may start an interaction."""

WALKING = 0.6
"""Least shoulder speed of a walking person [arm lengths/s]; an interaction does not start while walking."""

UNDECIDED_S = 2.0
"""Shortest motion that can be called unknown [s]; measured, see `docs/strangers.md`."""

FAMILIAR_S = 3.0
"""Longest time that `familiar` is averaged over."""

FAMILIAR_NATS = 2.5
"""How far the largest logit of a known interaction stands out from the mean of all where a motion is as familiar as
not. A probability of the same readout saturates: a fist bump is as surely a handshake as a handshake is, but its logits
are smaller. A twentieth of the known motions of people left out lie below. Source of the score: Hendrycks et al.,
"Scaling out-of-distribution detection for real-world settings", ICML 2022."""

CAUTIOUS_LOG_ODDS, CAUTIOUS_S = 1.0, 0.5
"""What `permit` must exceed its bound by, and for how long, before a person starts in cautious mode. Picked
from 11 settings by the figures on people left out, the handovers included: 85 % of NuiSI's and 80 % of v1's greetings
are still named within 4 s, which is no independent estimate."""

DOUBT = 2.0
"""How far the log-odds may fall below the bound before an interaction that has started is given up."""

NEVER = -10.0
"""Log-odds of a known interaction before anything was seen."""

HELD, HELD_AFTER_S, WAVES_AGAIN, MOST_STRAYS = 0.08, 0.3, 0.2, 0.25
"""A raised hand that strays less than the first from its mean place [arm lengths, root mean square over a third of a
second, each of the last at most] for so long is held out: no wave, and no motion that would have to be known. It stays
so until it is back at rest or strays more than the third. None of 56 recorded waves is held, with 3 cm of noise or not.
"""

STRAYS_SHARE = 1.0 - float(np.exp(-1.0 / (RATE_HZ * 0.3)))
"""Share that is new at each sample of that mean."""

EVIDENCE_SHARE = 1.0 - float(np.exp(-1.0 / (RATE_HZ * 0.5)))
"""Share that is new at each sample in the running means over half a second."""


@compiled
def _low_pass(before: float, value: float, time_constant_s: float) -> float:
    after: float = before + (1.0 - np.exp(-1.0 / (RATE_HZ * time_constant_s))) * (value - before)
    return after


@compiled
def features_of(arm: FloatArray, memory: FloatArray) -> FloatArray:
    """(T, FEATURES) features of T successive frames.

    All from the shoulder, since people walk. Elbow and hand (6), their velocities (6, low-pass 0.06 s) and slow
    velocities (6, 0.35 s), oscillation of the hand per axis (3: root of a 0.6 s leaky mean of the squared difference
    of the two), hand height, its maximum since the hand left its rest, the fall from it, distance from rest,
    elevation of the forearm, its maximum, forward reach, its maximum, the largest distance (9), hand from rest (3).

    Args:
        arm: (T, 3, 3) shoulder, elbow and hand of `unit_arm` [arm lengths].
        memory: (MEMORY,) what is remembered, changed in place; zeros before the first frame.
    """
    found = np.empty((len(arm), FEATURES))
    for t in range(len(arm)):
        row, elbow, hand = found[t], arm[t, 1] - arm[t, 0], arm[t, 2] - arm[t, 0]
        if memory[0] != GOES_ON:
            rest = memory[22:25].copy() if memory[0] == REST_KNOWN else hand
            memory[:] = 0.0
            memory[0] = GOES_ON
            memory[1:4], memory[4:7], memory[22:25] = elbow, hand, rest
            memory[25:29] = -np.inf
        # A hand that hangs still rests, wherever it was first seen.
        hangs = hand[2] < HANGING and (memory[10:13] ** 2).sum() < STILL**2
        memory[30] = memory[30] + 1.0 if hangs else 0.0
        if memory[30] > 0.5 * RATE_HZ and ((hand - memory[22:25]) ** 2).sum() > AT_REST**2:
            memory[22:25] = hand
        from_rest = hand - memory[22:25]
        distance = np.sqrt((from_rest**2).sum())
        height, forward, elevation = hand[2], hand[0], (hand[2] - elbow[2]) / FOREARM
        # At rest the place of rest follows the hand, and after a second there the maxima begin again.
        memory[29] = memory[29] + 1.0 if distance < AT_REST else 0.0
        if distance < AT_REST:
            for i in range(3):
                memory[22 + i] = _low_pass(memory[22 + i], hand[i], 1.0)
        if memory[29] > RATE_HZ:
            memory[25:29] = -np.inf
        memory[25], memory[26] = max(memory[25], height), max(memory[26], elevation)
        memory[27], memory[28] = max(memory[27], forward), max(memory[28], distance)
        for i in range(6):
            place = elbow[i] if i < 3 else hand[i - 3]
            velocity = _low_pass(memory[7 + i], (place - memory[1 + i]) * RATE_HZ, 0.06)
            slow = _low_pass(memory[13 + i], velocity, 0.35)
            memory[1 + i], memory[7 + i], memory[13 + i] = place, velocity, slow
            row[i], row[6 + i], row[12 + i] = place, velocity, slow
            if i >= 3:
                power = _low_pass(memory[16 + i], (velocity - slow) ** 2, 0.6)
                memory[16 + i] = power
                row[15 + i] = np.sqrt(power)
        row[21], row[22], row[23], row[24] = height, memory[25], memory[25] - height, distance
        row[25], row[26], row[27], row[28] = elevation, memory[26], forward, memory[27]
        row[29] = memory[28]
        row[30:33] = from_rest
    return found


def unit_arm(arm_m: FloatArray, length_m: float) -> FloatArray:
    """The arm with bones of UPPER_ARM and FOREARM, in arm lengths, by the directions of the bones.

    Args:
        arm_m: (T, 3, 3) shoulder, elbow and hand [m]; origin at the shoulder as it was first seen.
        length_m: Of both bones together [m]: the scale of the shoulder's own motion.
    """
    bones = np.diff(arm_m, axis=1)
    bones = bones / np.maximum(np.linalg.norm(bones, axis=2, keepdims=True), 1e-9)
    shoulder = arm_m[:, :1] / length_m
    elbow = shoulder + UPPER_ARM * bones[:, :1]
    arm: FloatArray = np.concatenate([shoulder, elbow, elbow + FOREARM * bones[:, 1:]], axis=1)
    return arm


@dataclass(frozen=True, eq=False)
class GestureState:
    """What a recogniser remembers of one person.

    Attributes:
        stamp_ns: Of the newest frame; None before the first.
        arm: (3, 3) that frame.
        next_ns: Time of the next sample.
        memory: (MEMORY,) of the features.
        units: (R,) activations of the reservoir.
        evidence: (C,) running mean of the log-probabilities of the known interactions.
        permit: Running mean of the log-odds of any known interaction against rest and background.
        familiar: How familiar the motion looks since the hand left its rest, from 0 (like none that is known) to 1,
            which it is at rest.
        familiar_nats: Mean since then of how far the largest logit of a known interaction stands out.
        distance: Of the hand from its rest [arm lengths].
        forward: How much further forward the hand is than at rest [arm lengths].
        active_s: How long ago the hand left its rest; 0 at rest.
        walking: Running mean of the shoulder's speed [arm lengths/s].
        allowed_s: For how long evidence and distance have allowed to start.
        started: Whether the person may be taken to do a known interaction.
        place: (3,) mean of where the hand has been lately [arm lengths from the shoulder].
        strays: Mean square of its distance from there.
        still_s: For how long it has strayed little, away from its rest.
        held: Whether the hand is held out.
    """

    stamp_ns: int | None
    arm: FloatArray
    next_ns: int
    memory: FloatArray
    units: FloatArray
    evidence: FloatArray
    permit: float
    familiar: float
    familiar_nats: float
    distance: float
    forward: float
    active_s: float
    walking: float
    allowed_s: float
    started: bool
    place: FloatArray = field(default_factory=lambda: read_only(np.zeros(3)))
    strays: float = 0.0
    still_s: float = 0.0
    held: bool = False


@dataclass(frozen=True, eq=False)
class GestureRecogniser:
    """Features, reservoir and two readouts.

    Attributes:
        mean, deviation: (F,) of the features.
        intake: (F + 1, R) from standardised features and one to the units.
        sources: (K, R) number of each unit that a unit listens to.
        strengths: (K, R) how much to it.
        leak: (R,) share of a unit's activation that is new at each sample.
        weight: (R + F, C + 1) and bias (C + 1,): logits of the known interactions and rest.
        permission_weight: (R + F, C + 2) and permission_bias (C + 2,): the same, then background.
        bounds: Least `permit` at which a known interaction may start, and least `familiar` of one.

    Raises:
        ValueError: Its parts do not belong together.
    """

    mean: FloatArray
    deviation: FloatArray
    intake: FloatArray
    sources: FloatArray
    strengths: FloatArray
    leak: FloatArray
    weight: FloatArray
    bias: FloatArray
    permission_weight: FloatArray
    permission_bias: FloatArray
    bounds: FloatArray

    def __post_init__(self) -> None:
        if not np.isin(self.sources, np.arange(len(self.leak))).all():
            raise ValueError("array gestures.sources does not number its units")
        if not ((self.leak > 0.0) & (self.leak <= 1.0)).all() or not (self.deviation > 0.0).all():
            raise ValueError("array gestures.leak is no share of one, or .deviation is not positive")

    @property
    def classes(self) -> int:
        """C, the number of known interactions."""
        return len(self.bias) - 1

    @cached_property
    def _units(self) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        return self.sources.astype(np.int64), np.array(self.strengths), np.array(self.leak)

    def init(self) -> GestureState:
        """The state before the first frame."""
        classes = self.classes
        return GestureState(
            stamp_ns=None,
            arm=read_only(np.zeros((3, 3))),
            next_ns=0,
            memory=read_only(np.zeros(MEMORY)),
            units=read_only(np.zeros(len(self.leak))),
            evidence=read_only(np.full(classes, -np.log(float(classes)))),
            permit=NEVER,
            familiar=1.0,
            familiar_nats=0.0,
            distance=0.0,
            forward=0.0,
            active_s=0.0,
            walking=0.0,
            allowed_s=0.0,
            started=False,
        )

    def after_gap(self, state: GestureState) -> GestureState:
        """The state in which nothing is known of the person but where their hand rests."""
        fresh, memory = self.init(), np.zeros(MEMORY)
        if state.memory[0] != 0.0:
            memory[0], memory[22:25] = REST_KNOWN, state.memory[22:25]
        return replace(fresh, memory=read_only(memory))

    def step(self, state: GestureState, arm: FloatArray, stamp_ns: int, cautious: bool = False) -> GestureState:
        """Take one frame; samples between it and the one before are interpolated.

        Args:
            state: Before it.
            arm: (3, 3) a frame of `unit_arm`.
            stamp_ns: Of it, later than the one before.
            cautious: Whether more evidence is required before a person starts, see `CAUTIOUS_LOG_ODDS`.
        """
        if state.stamp_ns is None:
            state = replace(state, stamp_ns=stamp_ns, next_ns=stamp_ns, arm=arm)
        frames, next_ns = [], state.next_ns
        before_ns = stamp_ns if state.stamp_ns is None else state.stamp_ns
        while next_ns <= stamp_ns:
            share = 1.0 if stamp_ns == before_ns else (next_ns - before_ns) / (stamp_ns - before_ns)
            frames.append(state.arm + share * (arm - state.arm))
            next_ns += PERIOD_NS
        before = state.arm
        state = replace(state, stamp_ns=stamp_ns, arm=read_only(arm), next_ns=next_ns)
        if not frames:
            return state
        memory, units = state.memory.copy(), state.units
        rows, activations = self.activate(np.array(frames), memory, units if state.memory[0] == GOES_ON else None)
        for index, (one, row) in enumerate(zip(np.hstack([activations, rows]), rows, strict=True)):
            shoulder_m = frames[index][0] - (frames[index - 1][0] if index else before[0])
            moved = float(np.linalg.norm(shoulder_m))
            state = self._judged(state, one, row * self.deviation + self.mean, moved, cautious)
        return replace(state, memory=read_only(memory), units=read_only(activations[-1]))

    def _judged(
        self, state: GestureState, seen: FloatArray, features: FloatArray, moved: float, cautious: bool
    ) -> GestureState:
        """The state after one more sample: what the readouts say of it, averaged over the last half second."""
        known = log_softmax(seen @ self.weight + self.bias)
        allowed = log_softmax(seen @ self.permission_weight + self.permission_bias)
        odds = float(allowed[:-2].max() - np.logaddexp(allowed[-2], allowed[-1]))
        distance, from_rest = float(features[DISTANCE]), features[FROM_REST:]
        active_s = state.active_s + 1.0 / RATE_HZ if distance > AT_REST else 0.0
        share = max(1.0 / (active_s * RATE_HZ), 1.0 / (FAMILIAR_S * RATE_HZ)) if active_s else 1.0
        outstanding = max(float(known[:-1].max() - known.mean()), 0.0)  # logits but for a constant
        permit = state.permit + EVIDENCE_SHARE * (odds - state.permit)
        walking = state.walking + EVIDENCE_SHARE * (moved * RATE_HZ - state.walking)
        nats = state.familiar_nats + share * (outstanding - state.familiar_nats)
        familiar = nats / (nats + FAMILIAR_NATS) if active_s else 1.0
        start, bound = self.bounds.tolist()
        least, hold_s = (start + CAUTIOUS_LOG_ODDS, CAUTIOUS_S) if cautious else (start, 0.0)
        allowed_s = state.allowed_s + 1.0 / RATE_HZ if distance > ONSET_DISTANCE and permit > least else 0.0
        if state.started:
            started = active_s > 0.0 and permit > start - DOUBT
        else:
            started = allowed_s > hold_s and walking < WALKING
        off = features[HAND] - state.place
        strays = state.strays + STRAYS_SHARE * (min(float(off @ off), MOST_STRAYS**2) - state.strays)
        still_s = state.still_s + 1.0 / RATE_HZ if distance > ONSET_DISTANCE and strays < HELD**2 else 0.0
        held = (state.held and strays < WAVES_AGAIN**2 and active_s > 0.0) or still_s > HELD_AFTER_S
        return replace(
            state,
            place=read_only(state.place + STRAYS_SHARE * off),
            strays=strays,
            still_s=still_s,
            held=held,
            evidence=read_only(state.evidence + EVIDENCE_SHARE * (log_softmax(known[:-1]) - state.evidence)),
            permit=permit,
            familiar=familiar,
            familiar_nats=nats,
            distance=distance,
            forward=float(from_rest[0]),
            active_s=active_s,
            walking=walking,
            allowed_s=allowed_s,
            started=started and not (active_s > UNDECIDED_S and familiar < bound),
        )

    def activate(
        self, frames: FloatArray, memory: FloatArray, units: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Standardised features (T, F) and activations (T, R) of successive frames at RATE_HZ.

        Args:
            frames: (T, 3, 3) of `unit_arm`.
            memory: (MEMORY,) of the features, changed in place.
            units: (R,) activations before; None: the person has stood still before the first frame.
        """
        rows = (features_of(frames, memory) - self.mean) / self.deviation
        return rows, self.activations(rows, units)

    def activations(self, rows: FloatArray, units: FloatArray | None) -> FloatArray:
        """(T, R) activations after each of T standardised features (T, F); `units` as for `activate`."""
        drive = rows @ self.intake[:-1] + self.intake[-1]
        if units is None:
            rest = np.repeat(drive[:1], round(SETTLED_S * RATE_HZ), axis=0)
            units = run_units(rest, *self._units, np.zeros(len(self.leak)))[-1]
        return run_units(drive, *self._units, np.array(units))

    def to_arrays(self) -> dict[str, FloatArray]:
        """What `take_gestures` takes."""
        return {f"gestures.{name}": getattr(self, name) for name in self.__dataclass_fields__}


def log_softmax(logits: FloatArray) -> FloatArray:
    """(..., C) logarithms of the probabilities."""
    shifted = logits - logits.max(axis=-1, keepdims=True)
    found: FloatArray = shifted - np.log(np.exp(shifted).sum(axis=-1, keepdims=True))
    return found


def gesture_classes(interactions: Sequence[str]) -> NDArray[np.int64]:
    """(P,) the class of each interaction.

    Raises:
        ValueError: One is none of them.
    """
    names = [SAME.get(name, name) for name in interactions]
    unknown = [name for name in names if name not in GESTURES]
    if unknown:
        raise ValueError(f"arrays gestures.* know no interaction {', '.join(unknown)}")
    return np.array([GESTURES.index(name) for name in names], dtype=np.int64)


def take_gestures(take: TakeArray) -> GestureRecogniser:
    """Put a recogniser together from a model's arrays.

    Raises:
        ValueError: One is missing, has another shape, or they do not belong together.
    """
    leak = take("gestures.leak", (None,))
    bias = take("gestures.bias", (None,))
    sources = take("gestures.sources", (None, len(leak)))
    seen = len(leak) + FEATURES
    shapes: dict[str, tuple[int | None, ...]] = {
        "mean": (FEATURES,),
        "deviation": (FEATURES,),
        "intake": (FEATURES + 1, len(leak)),
        "strengths": sources.shape,
        "weight": (seen, len(bias)),
        "permission_weight": (seen, len(bias) + 1),
        "permission_bias": (len(bias) + 1,),
        "bounds": (2,),
    }
    taken = {name: read_only(take(f"gestures.{name}", shape)) for name, shape in shapes.items()}
    return GestureRecogniser(leak=read_only(leak), bias=read_only(bias), sources=read_only(sources), **taken)

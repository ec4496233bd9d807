# SPDX-License-Identifier: Apache-2.0
"""Recognise an interaction from the arm alone, by features that carry over to people who were never recorded.

Where a hand goes differs between people more than how it moves does. So the features are mostly velocities, their
oscillation, and what the hand has done since it left its rest. A reservoir of leaky units remembers them for about two
seconds, and two linear readouts classify the same activations:

    novelty      the known interactions and rest, learned without a background: their largest probability tells foreign
                 motions from known ones
    permission   the same and a background of other movements (reaching, walking, fidgeting): whether to start at all

Everything is relative to the length of the arm, by the directions of its bones, and runs at 20 Hz whatever the rate of
the model beside it.

Source: ours; METHOD section 5 has the measurements behind the choice of features. Reservoirs: `reservoir.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mild_core.compiled import compiled
from mild_core.inference.reservoir import run_units
from mild_core.shapes import FloatArray, read_only

TakeArray = Callable[[str, tuple[int | None, ...]], FloatArray]
"""(name, shape) -> a finite array of that shape, or ValueError."""

RATE_HZ = 20.0
"""Of the features."""

UPPER_ARM, FOREARM = 0.435, 0.565
"""Bones of the arm that features are made of, in arm lengths."""

AT_REST = 0.12
"""A hand that is no further from its rest than this [arm lengths] has not begun anything."""

SETTLED_S = 1.5
"""A person who comes into view is assumed to have stood still for this long before."""

FEATURES = 33
"""Values of a frame, see `features_of`."""

MEMORY = 30
"""Values that features remember between frames."""

PERIOD_NS = round(1e9 / RATE_HZ)

DISTANCE = 24
"""Place of the hand's distance from its rest among the features."""

EVIDENCE_SHARE = 1.0 - float(np.exp(-1.0 / (RATE_HZ * 0.5)))
"""Share that is new at each sample in the running means over half a second."""


@compiled
def _low_pass(before: float, value: float, time_constant_s: float) -> float:
    return before + (1.0 - np.exp(-1.0 / (RATE_HZ * time_constant_s))) * (value - before)


@compiled
def features_of(arm: FloatArray, memory: FloatArray) -> FloatArray:
    """(T, FEATURES) features of T successive frames.

    All from the shoulder, since people walk. Elbow and hand (6), their velocities (6, low-pass 0.06 s) and slow velocities (6, 0.35 s),
    oscillation of the hand per axis (3: root of a 0.6 s leaky mean of the squared difference of the two), hand height,
    its maximum since the hand left its rest, the fall from it, distance from rest, elevation of the forearm, its
    maximum, forward reach, its maximum, the largest distance (9), hand from rest (3).

    Args:
        arm: (T, 3, 3) shoulder, elbow and hand of `unit_arm` [arm lengths].
        memory: (MEMORY,) what is remembered, changed in place; its first value is 0 before the first frame.
    """
    found = np.empty((len(arm), FEATURES))
    for t in range(len(arm)):
        row, elbow, hand = found[t], arm[t, 1] - arm[t, 0], arm[t, 2] - arm[t, 0]
        if memory[0] == 0.0:
            memory[:] = 0.0
            memory[0] = 1.0
            memory[1:4], memory[4:7], memory[22:25] = elbow, hand, hand
            memory[25:29] = -np.inf
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
        evidence: (C + 1,) running mean of the log-probabilities of known interactions and rest.
        permission: (C + 2,) the same of the readout that also knows the background.
        familiar: Running mean of the largest probability among known interactions.
        distance: Of the hand from its rest [arm lengths].
    """

    stamp_ns: int | None
    arm: FloatArray
    next_ns: int
    memory: FloatArray
    units: FloatArray
    evidence: FloatArray
    permission: FloatArray
    familiar: float
    distance: float


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
            evidence=read_only(np.full(classes + 1, -np.log(classes + 1.0))),
            permission=read_only(np.full(classes + 2, -np.log(classes + 2.0))),
            familiar=1.0,
            distance=0.0,
        )

    def step(self, state: GestureState, arm: FloatArray, stamp_ns: int) -> GestureState:
        """Take one frame; samples between it and the one before are interpolated.

        Args:
            state: Before it.
            arm: (3, 3) a frame of `unit_arm`.
            stamp_ns: Of it, later than the one before.
        """
        if state.stamp_ns is None:
            state = replace(state, stamp_ns=stamp_ns, next_ns=stamp_ns, arm=arm)
        frames, next_ns = [], state.next_ns
        before_ns = stamp_ns if state.stamp_ns is None else state.stamp_ns
        while next_ns <= stamp_ns:
            share = 1.0 if stamp_ns == before_ns else (next_ns - before_ns) / (stamp_ns - before_ns)
            frames.append(state.arm + share * (arm - state.arm))
            next_ns += PERIOD_NS
        state = replace(state, stamp_ns=stamp_ns, arm=read_only(arm), next_ns=next_ns)
        if not frames:
            return state
        memory, units = state.memory.copy(), state.units
        rows, activations = self.activate(np.array(frames), memory, None if state.memory[0] == 0.0 else units)
        evidence, permission, familiar = state.evidence, state.permission, state.familiar
        for one in np.hstack([activations, rows]):
            known = log_softmax(one @ self.weight + self.bias)
            allowed = log_softmax(one @ self.permission_weight + self.permission_bias)
            evidence = evidence + EVIDENCE_SHARE * (known - evidence)
            permission = permission + EVIDENCE_SHARE * (allowed - permission)
            largest = float(np.exp(log_softmax(known[:-1])).max())
            familiar += EVIDENCE_SHARE * (largest - familiar)
        return replace(
            state,
            memory=read_only(memory),
            units=read_only(activations[-1]),
            evidence=read_only(evidence),
            permission=read_only(permission),
            familiar=familiar,
            distance=float(rows[-1][DISTANCE] * self.deviation[DISTANCE] + self.mean[DISTANCE]),
        )

    def activate(self, frames: FloatArray, memory: FloatArray, units: FloatArray | None) -> tuple[FloatArray, FloatArray]:
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
    }
    taken = {name: read_only(take(f"gestures.{name}", shape)) for name, shape in shapes.items()}
    return GestureRecogniser(leak=read_only(leak), bias=read_only(bias), sources=read_only(sources), **taken)

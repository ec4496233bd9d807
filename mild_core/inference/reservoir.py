# SPDX-License-Identifier: Apache-2.0
"""A reservoir beside the members: fixed random recurrent units remember, linear readouts predict.

Each unit leaks at its own pace, from a twentieth of a second to seconds, so that all of them together hold the last
seconds of the arm's motion. Only the readouts are learned, in closed form: what they err in is not what the members
err in, and the mean of both errs less than either. They also classify the interaction by what has been since the motion
began, where a network sees a window.

Source: Jaeger, Lukosevicius, Popovici, Siewert, "Optimization and applications of echo state networks with leaky-
integrator neurons", Neural Networks 20 (2007).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mild_core.compiled import compiled
from mild_core.inference.novelty_detector import TakeArray
from mild_core.shapes import FloatArray, read_only

SETTLED_S = 1.5
"""A new person is assumed to have stood like that for this long [s]."""


@compiled
def run_units(
    drive: FloatArray, sources: NDArray[np.int64], strengths: FloatArray, leak: FloatArray, state: FloatArray
) -> FloatArray:
    """States (T, R) of the units after each of T frames.

    Args:
        drive: (T, R) what the frames give each unit.
        sources: (K, R) the units that each unit listens to.
        strengths: (K, R) how much to each.
        leak: (R,) share of a state that is new at each frame.
        state: (R,) before.
    """
    frames, units = drive.shape
    states = np.empty((frames, units))
    before = state
    for t in range(frames):
        after = states[t]
        for r in range(units):
            heard = drive[t, r]
            for k in range(sources.shape[0]):
                heard += strengths[k, r] * before[sources[k, r]]
            after[r] = (1.0 - leak[r]) * before[r] + leak[r] * np.tanh(heard)
        before = after
    return states


@dataclass(frozen=True, eq=False)
class Reservoir:
    """Units and readouts of all interactions.

    Attributes:
        intake: (6 J + 1, R) from a frame's positions [m], velocities [m/s] and one to the units.
        sources: (K, R) number of each unit that a unit listens to.
        strengths: (K, R) how much to it.
        leak: (R,) share of a unit's state that is new at each frame.
        readout: (P, R + 9 J, A) from states and three frames of the window to coordinates of the answer.
        bias: (P, A).
        back: (A, W N) from coordinates to the controlled agent's window.
        mean: (W N,) of those windows.
        share: (1,) that its answer has beside the members'.
        label_weight: (R + 9 J, P) from the same to the logarithms of the interactions' probabilities.
        label_bias: (P,).

    Raises:
        ValueError: Its parts do not belong together.
    """

    intake: FloatArray
    sources: FloatArray
    strengths: FloatArray
    leak: FloatArray
    readout: FloatArray
    bias: FloatArray
    back: FloatArray
    mean: FloatArray
    share: FloatArray
    label_weight: FloatArray
    label_bias: FloatArray

    def __post_init__(self) -> None:
        if not np.isin(self.sources, np.arange(len(self.leak))).all():
            raise ValueError("array reservoir.sources does not number its units")
        if not (((self.leak > 0.0) & (self.leak <= 1.0)).all() and 0.0 < self.share[0] <= 1.0):
            raise ValueError("array reservoir.leak or .share is no share of one")

    @cached_property
    def _units(self) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Sources as numbers, strengths and leak, as the compiled step takes them."""
        return self.sources.astype(np.int64), np.array(self.strengths), np.array(self.leak)

    def listen(self, positions: FloatArray, rate_hz: float, before: FloatArray | None, passed: int) -> FloatArray:
        """(T, R) states after the newest frames of a track.

        Args:
            positions: (W, 3 J) its last frames [m].
            rate_hz: Of the frames.
            before: (R,) state before the newest `passed` frames; None: no person was seen before the first of these W.
            passed: How many frames are new; with no state before, all are.
        """
        drive = self.drive(positions, rate_hz)
        if before is None:
            rest = np.repeat(drive[:1], round(SETTLED_S * rate_hz), axis=0)
            before = run_units(rest, *self._units, np.zeros(len(self.leak)))[-1]
        else:
            drive = drive[-passed:]
        return read_only(run_units(drive, *self._units, np.array(before)))

    def drive(self, positions: FloatArray, rate_hz: float) -> FloatArray:
        """(T, R) what the frames of a track (T, 3 J) [m] give each unit; its first frame comes after a rest."""
        velocities = np.diff(positions, axis=0, prepend=positions[:1]) * rate_hz
        drive: FloatArray = np.hstack([positions, velocities, np.ones((len(positions), 1))]) @ self.intake
        return drive

    def answer(self, state: FloatArray, positions: FloatArray, label: FloatArray) -> FloatArray:
        """(W N,) expected window of the controlled agent [rad or m].

        Args:
            state: (R,) after the newest frame.
            positions: (W, 3 J) the window [m].
            label: (P,) probability of each interaction.
        """
        answer: FloatArray = (label @ (_seen(state, positions) @ self.readout + self.bias)) @ self.back + self.mean
        return answer

    def classify(self, state: FloatArray, positions: FloatArray) -> FloatArray:
        """(P,) logarithms of the interactions' probabilities, but for a constant; arguments as for `answer`."""
        logarithms: FloatArray = _seen(state, positions) @ self.label_weight + self.label_bias
        return logarithms

    def blend(self, motion: FloatArray, covariance: FloatArray, answer: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The members' window (W, N) and `answer`, each with its share, and the covariance (N, N) of both.

        That also holds how far they disagree.
        """
        share, apart = self.share[0], answer.reshape(motion.shape) - motion
        return motion + share * apart, covariance + share * (1.0 - share) * apart.T @ apart / len(apart)

    def to_arrays(self) -> dict[str, FloatArray]:
        """What `take_reservoir` takes."""
        return {f"reservoir.{name}": getattr(self, name) for name in self.__dataclass_fields__}


def _seen(state: FloatArray, positions: FloatArray) -> FloatArray:
    """(R + 9 J,) what readouts see: the state, the newest frame, the oldest, the one between."""
    return np.concatenate([state, *positions[[-1, 0, (len(positions) - 1) // 2]]])


def take_reservoir(take: TakeArray, position_values: int, answer_values: int, interactions: int) -> Reservoir:
    """Put a reservoir together from a model's arrays.

    Raises:
        ValueError: One is missing, has another shape, or they do not belong together.
    """
    leak = take("reservoir.leak", (None,))
    sources = take("reservoir.sources", (None, len(leak)))
    back = take("reservoir.back", (None, answer_values))
    shapes: dict[str, tuple[int | None, ...]] = {
        "intake": (2 * position_values + 1, len(leak)),
        "strengths": sources.shape,
        "readout": (interactions, len(leak) + 3 * position_values, len(back)),
        "bias": (interactions, len(back)),
        "mean": (answer_values,),
        "share": (1,),
        "label_weight": (len(leak) + 3 * position_values, interactions),
        "label_bias": (interactions,),
    }
    taken = {name: read_only(take(f"reservoir.{name}", shape)) for name, shape in shapes.items()}
    return Reservoir(leak=read_only(leak), sources=read_only(sources), back=read_only(back), **taken)

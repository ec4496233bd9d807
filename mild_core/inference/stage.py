# SPDX-License-Identifier: Apache-2.0
"""Inference: a person's feature window in, the controlled agent's next motion window out.

    encode -> update the belief -> recognise -> condition -> mix -> decode

Every window ends in exactly one outcome: `accepted`, or what is wrong with it: `wrong_joints`, `wrong_shape`,
`not_finite`, `duplicate`. Beside them, events are counted that may come with any accepted window: `time_reset` (its
stamp lies before the last one), `gap_reset` (more than a window was missed), `missed` (windows that never came),
`unknown` (it is far from all that the model knows).

Source: Algorithm 2 of MILD.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mild_core.errors import DataError, unknown_name
from mild_core.inference.member import Generated, MemberState, Percept
from mild_core.inference.motion_model import MildModel
from mild_core.inference.recognition import Recognition, given, recognise, undecided
from mild_core.signals import FeatureWindow, MotionWindow

AUTO = "auto"
"""Recognise the interaction instead of being told."""

DECIDED = 0.5
"""Probability from which a recognised interaction is named."""


@dataclass(frozen=True, eq=False)
class CopyState:
    """One of the S copies of what remembers; they take turns.

    Attributes:
        index: Number of the window that it saw last; -1 before the first.
        members: One per member of the model.
    """

    index: int
    members: tuple[MemberState, ...]


@dataclass(frozen=True, eq=False)
class InferenceState:
    """All that inference remembers.

    Attributes:
        counts: Windows by outcome, and events, since the start.
        outcome: Of the newest window; "" before the first.
        detail: Why that window was not used, for people; "" when it was.
        stamp_ns: Of the newest accepted window; None before the first.
        index: Its number since the start or the last reset.
        copies: S of them.
        recognition: Which interaction it is.
    """

    recognition: Recognition
    copies: tuple[CopyState, ...]
    counts: Mapping[str, int] = field(default_factory=dict)
    outcome: str = ""
    detail: str = ""
    stamp_ns: int | None = None
    index: int = -1


@dataclass(frozen=True, eq=False)
class Inference:
    """A model at work.

    Attributes:
        model: A trained model.
        interaction: One of its interactions, or "auto" to recognise it.

    Raises:
        SetupError: The model knows no such interaction; those that it knows are listed.
    """

    model: MildModel
    interaction: str = AUTO

    def __post_init__(self) -> None:
        names = self.model.manifest.interactions
        if self.interaction not in (AUTO, *names):
            raise unknown_name(f"interaction of model {self.model.manifest.name}", self.interaction, (AUTO, *names))

    @cached_property
    def _considered(self) -> tuple[int, ...]:
        """Numbers of the interactions that can be the one."""
        names = self.model.manifest.interactions
        return tuple(range(len(names))) if self.interaction == AUTO else (names.index(self.interaction),)

    @cached_property
    def _period_ns(self) -> int:
        return round(1e9 / self.model.manifest.rate_hz)

    def init(self) -> InferenceState:
        """The state before the first window."""
        names = self.model.manifest.interactions
        recognition = undecided(len(names)) if self.interaction == AUTO else given(self._considered[0], len(names))
        copy = CopyState(-1, tuple(member.init(self._considered) for member in self.model.members))
        return InferenceState(recognition, (copy,) * self.model.manifest.stride)

    def step(
        self, state: InferenceState, window: FeatureWindow, now_ns: int
    ) -> tuple[InferenceState, tuple[MotionWindow, ...]]:
        """Take one window.

        Args:
            state: Before it.
            window: At the model's rate.
            now_ns: When it came; not used: inference lives in the time of the stamps.

        Returns:
            The state after it, and the one motion window that answers it; none when it cannot be used.
        """
        events: Counter[str] = Counter()
        try:
            self._check(state, window)
        except DataError as error:
            return self._ended(state, events, error.reason, error.detail), ()
        before, index = self._in_time(state, window.stamp_ns, events)
        place = index % len(before.copies)
        percepts = self._observe(before, place, index, window)
        recognition = self._recognise(before.recognition, percepts)
        label = recognition.probabilities.astype(np.float32)
        members = self.model.members
        generated = tuple(
            member.generate(percept, label, self._considered) for member, percept in zip(members, percepts, strict=True)
        )
        motion = self._motion(window, recognition, percepts, generated)
        events["unknown"] += motion.out_of_distribution > 1.0
        copy = CopyState(index, tuple(percept.state for percept in percepts))
        copies = (*before.copies[:place], copy, *before.copies[place + 1 :])
        after = InferenceState(recognition, copies, before.counts, "", "", window.stamp_ns, index)
        return self._ended(after, events, "accepted"), (motion,)

    def _check(self, state: InferenceState, window: FeatureWindow) -> None:
        """Raise DataError unless the window can be used."""
        manifest = self.model.manifest
        if window.joint_names != manifest.observed.joint_names:
            problem = f"{', '.join(window.joint_names)} instead of {', '.join(manifest.observed.joint_names)}"
            raise DataError("wrong_joints", problem)
        if window.features.shape != (manifest.window, manifest.frame_values):
            problem = f"{window.features.shape} instead of {(manifest.window, manifest.frame_values)}"
            raise DataError("wrong_shape", problem)
        if not np.isfinite(window.features).all():
            raise DataError("not_finite", "a feature is NaN or infinite")
        if window.stamp_ns == state.stamp_ns:
            raise DataError("duplicate", f"stamp {window.stamp_ns} came twice")

    def _in_time(self, state: InferenceState, stamp_ns: int, events: Counter[str]) -> tuple[InferenceState, int]:
        """The state to go on from, and the number of the new window."""
        if state.stamp_ns is None:
            return state, 0
        passed = max(1, round((stamp_ns - state.stamp_ns) / self._period_ns))
        if stamp_ns < state.stamp_ns or passed > self.model.manifest.window:
            events["time_reset" if stamp_ns < state.stamp_ns else "gap_reset"] += 1
            fresh = self.init()
            return InferenceState(fresh.recognition, fresh.copies, state.counts), 0
        events["missed"] += passed - 1
        return state, state.index + passed

    def _observe(self, state: InferenceState, place: int, index: int, window: FeatureWindow) -> tuple[Percept, ...]:
        copy, stride = state.copies[place], len(state.copies)
        frames = np.array(window.features, dtype=np.float32)
        all_rows = frames[(len(frames) - 1) % stride :: stride]
        missed = (index - copy.index) // stride - 1 if copy.index >= 0 else 0
        rows = all_rows if copy.index < 0 else all_rows[-(missed + 1) :]
        label, flat = state.recognition.probabilities.astype(np.float32), frames.reshape(-1)
        return tuple(
            member.observe(memory, rows, flat, label, self._considered, missed)
            for member, memory in zip(self.model.members, copy.members, strict=True)
        )

    def _recognise(self, before: Recognition, percepts: tuple[Percept, ...]) -> Recognition:
        """A frame that no interaction can explain says nothing about which one it is."""
        beliefs = [percept.state.beliefs for percept in percepts]
        if self.interaction != AUTO or not any(belief.known for member in beliefs for belief in member):
            return before
        log_likelihoods = np.array([[belief.log_likelihood for belief in member] for member in beliefs])
        return recognise(before, log_likelihoods.sum(axis=0), self.model.temper, self.model.forgetting)

    def _motion(
        self, window: FeatureWindow, recognition: Recognition, percepts: tuple[Percept, ...],
        generated: tuple[Generated, ...],
    ) -> MotionWindow:  # fmt: skip
        manifest, members = self.model.manifest, self.model.members
        likeliest = int(recognition.probabilities.argmax())
        probability = float(recognition.probabilities[likeliest])
        mean, controlled = _combined(generated), manifest.controlled
        strangeness = sum(percept.out_of_distribution for percept in percepts) / len(members)
        phases = [
            part.weights @ member.priors[likeliest].phases for part, member in zip(generated, members, strict=True)
        ]
        named = self.interaction != AUTO or (probability >= DECIDED and strangeness <= 1.0)
        rows = mean.motion if controlled.unit == "rad" else mean.motion.reshape(manifest.window, -1, 3)
        return MotionWindow(
            stamp_ns=window.stamp_ns,
            lead_ns=manifest.lead_frames * self._period_ns,
            period_ns=self._period_ns,
            joint_names=controlled.joint_names,
            positions=rows,
            covariance=mean.covariance + self.model.residual_covariance,
            interaction=manifest.interactions[likeliest] if named else "",
            probability=probability,
            belief=mean.weights,
            phase=float(sum(phases)) / len(phases),
            out_of_distribution=strangeness,
        )

    @staticmethod
    def _ended(state: InferenceState, events: Counter[str], outcome: str, detail: str = "") -> InferenceState:
        """The state with what happened counted."""
        counts = dict(state.counts)
        counts[outcome] = counts.get(outcome, 0) + 1
        for name, number in events.items():
            if number:
                counts[name] = counts.get(name, 0) + number
        return InferenceState(state.recognition, state.copies, counts, outcome, detail, state.stamp_ns, state.index)


def _combined(generated: tuple[Generated, ...]) -> Generated:
    """Means of the members' parts; the covariance also holds how far their windows disagree."""
    if len(generated) == 1:
        return generated[0]
    motions = np.stack([part.motion for part in generated])
    motion = motions.mean(axis=0)
    apart = (motions - motion).reshape(-1, motion.shape[1])
    covariance = np.mean([part.covariance for part in generated], axis=0) + apart.T @ apart / len(apart)
    return Generated(motion, covariance, np.mean([part.weights for part in generated], axis=0))

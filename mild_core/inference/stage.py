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

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mild_core.errors import DataError, unknown_name
from mild_core.inference.member import Generated, MemberState, ReadyMember, make_ready
from mild_core.inference.motion_model import MildModel
from mild_core.inference.past import fade, kept_per_frame
from mild_core.inference.priors.filtering import UNDERFLOW
from mild_core.inference.recognition import Recognition, given, recognise, undecided
from mild_core.inference.stepping import Observed
from mild_core.shapes import FloatArray, read_only
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
        strayed: See `Territory.follow`; (0,) in a model without one.
        past: (T, 3 J) see `past.fade`; None before the first window.
    """

    recognition: Recognition
    copies: tuple[CopyState, ...]
    strayed: FloatArray
    past: FloatArray | None = None
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
    def _members(self) -> tuple[ReadyMember, ...]:
        names = self.model.manifest.interactions
        considered = range(len(names)) if self.interaction == AUTO else [names.index(self.interaction)]
        return tuple(make_ready(m, considered, self.model.residual_covariance) for m in self.model.members)

    @cached_property
    def _period_ns(self) -> int:
        return round(1e9 / self.model.manifest.rate_hz)

    @cached_property
    def _kept(self) -> FloatArray:
        return kept_per_frame(self.model.manifest.past_s, self.model.manifest.rate_hz)

    def init(self) -> InferenceState:
        """The state before the first window."""
        names = self.model.manifest.interactions
        told = self.interaction != AUTO
        recognition = given(names.index(self.interaction), len(names)) if told else undecided(len(names))
        copy = CopyState(-1, tuple(member.init() for member in self._members))
        territory = self.model.territory
        strayed = read_only(np.zeros(0)) if territory is None else territory.init()
        return InferenceState(recognition, (copy,) * self.model.manifest.stride, strayed)

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
        try:
            self._check(state, window)
            before, index, events = self._in_time(state, window.stamp_ns)
            place = index % len(before.copies)
            past = self._past(before, index, window)
            found = self._observe(before, place, index, window, past)
        except DataError as error:
            return replace(
                state, counts=_counted(state, {error.reason: 1}), outcome=error.reason, detail=error.detail
            ), ()
        recognition = self._recognise(before.recognition, found)
        generated = [m.generate(seen, recognition.probabilities) for m, seen in zip(self._members, found, strict=True)]
        strayed, strangeness = self._stray(before.strayed, window, found)
        answer = self._beside(_combined(generated), window, past, recognition)
        motion = self._motion(window, recognition, strangeness, answer)
        events["accepted"] = 1
        if strangeness > 1.0:
            events["unknown"] = 1
        copy = CopyState(index, tuple([MemberState(seen.context, seen.memory) for seen in found]))
        copies = (*before.copies[:place], copy, *before.copies[place + 1 :])
        counts = _counted(state, events)
        state = InferenceState(recognition, copies, strayed, past, counts, "accepted", "", window.stamp_ns, index)
        return state, (motion,)

    def by_component(self, state: InferenceState, window: FeatureWindow) -> tuple[MotionWindow, ...]:
        """What each component of the likeliest interaction alone expects, for people to look at.

        Args:
            state: Before the window that `step` takes; nothing is remembered.
            window: At the model's rate.

        Raises:
            DataError: The window cannot be used.
        """
        self._check(state, window)
        before, index, _ = self._in_time(state, window.stamp_ns)
        past = self._past(before, index, window)
        found = self._observe(before, index % len(before.copies), index, window, past)
        recognition = self._recognise(before.recognition, found)
        motions = []
        for alone in np.eye(found[0].weights.shape[1]):
            sure = [seen._replace(weights=np.tile(alone, (len(seen.weights), 1))) for seen in found]
            label = recognition.probabilities
            generated = [m.generate(seen, label) for m, seen in zip(self._members, sure, strict=True)]
            motions.append(self._motion(window, recognition, 0.0, _combined(generated)))
        return tuple(motions)

    def _check(self, state: InferenceState, window: FeatureWindow) -> None:
        """Raise DataError unless the window can be used."""
        manifest = self.model.manifest
        if window.joint_names != manifest.observed.joint_names:
            problem = f"{', '.join(window.joint_names)} instead of {', '.join(manifest.observed.joint_names)}"
            raise DataError("wrong_joints", problem)
        if window.features.shape != (manifest.window, manifest.frame_values):
            problem = f"{window.features.shape} instead of {(manifest.window, manifest.frame_values)}"
            raise DataError("wrong_shape", problem)
        if window.stamp_ns == state.stamp_ns:
            raise DataError("duplicate", f"stamp {window.stamp_ns} came twice")

    def _in_time(self, state: InferenceState, stamp_ns: int) -> tuple[InferenceState, int, dict[str, int]]:
        """The state to go on from, the number of the new window, and what happened."""
        if state.stamp_ns is None:
            return state, 0, {}
        passed = max(1, round((stamp_ns - state.stamp_ns) / self._period_ns))
        if stamp_ns < state.stamp_ns or passed > self.model.manifest.window:
            return self.init(), 0, {"time_reset" if stamp_ns < state.stamp_ns else "gap_reset": 1}
        return state, state.index + passed, {"missed": passed - 1} if passed > 1 else {}

    def _past(self, state: InferenceState, index: int, window: FeatureWindow) -> FloatArray:
        """(T, 3 J) where the arm has been, this window included."""
        positions = window.features[-1, : 3 * len(window.joint_names)]
        return fade(state.past, positions, self._kept, index - state.index)

    def _beside(
        self, members: Generated, window: FeatureWindow, past: FloatArray, recognition: Recognition
    ) -> Generated:
        """What the members expect, blended with what the radial basis expects where the model has one."""
        basis = self.model.radial_basis
        if basis is None:
            return members
        answer = basis.answer(window.features, past, recognition.probabilities)
        motion, covariance = basis.blend(members.motion, members.covariance, answer)
        return replace(members, motion=motion, covariance=covariance)

    def _observe(
        self, state: InferenceState, place: int, index: int, window: FeatureWindow, past: FloatArray
    ) -> tuple[Observed, ...]:
        """What each member finds. Raises DataError when a feature is not finite."""
        copy, stride = state.copies[place], len(state.copies)
        missed = (index - copy.index) // stride - 1 if copy.index >= 0 else -1
        whole = 1 + (len(window.features) - 1) // stride
        steps = min(missed + 1, whole) if copy.index >= 0 else whole
        label, features = state.recognition.probabilities, window.features
        if not (features.flags.c_contiguous and features.flags.aligned):
            features = read_only(np.array(features, order="C"))  # Any other layout would be compiled for anew.
        found = tuple(
            [
                member.observe(memory, features, past, label, steps, stride, missed)
                for member, memory in zip(self._members, copy.members, strict=True)
            ]
        )
        if math.isnan(found[0].score):
            raise DataError("not_finite", "a feature is NaN or infinite")
        return found

    def _recognise(self, before: Recognition, found: tuple[Observed, ...]) -> Recognition:
        """A frame that no interaction can explain says nothing about which one it is."""
        if self.interaction != AUTO:
            return before
        log_likelihoods = np.array([seen.log_likelihoods for seen in found])
        if log_likelihoods.max() <= UNDERFLOW:
            return before
        return recognise(before, log_likelihoods.sum(axis=0), self.model.temper, self.model.forgetting)

    def _stray(
        self, strayed: FloatArray, window: FeatureWindow, found: tuple[Observed, ...]
    ) -> tuple[FloatArray, float]:
        """How far the person has strayed from each interaction, and the out-of-distribution score."""
        strangeness = sum([seen.score for seen in found]) / len(found)
        if self.model.territory is None:
            return strayed, strangeness
        strayed = self.model.territory.follow(strayed, window.features)
        return strayed, max(strangeness, self.model.territory.score(strayed))

    def _motion(
        self, window: FeatureWindow, recognition: Recognition, strangeness: float, generated: Generated
    ) -> MotionWindow:
        manifest = self.model.manifest
        controlled = manifest.controlled
        named = self.interaction != AUTO or (recognition.probability >= DECIDED and strangeness <= 1.0)
        rows = generated.motion if controlled.unit == "rad" else generated.motion.reshape(manifest.window, -1, 3)
        return MotionWindow(
            stamp_ns=window.stamp_ns,
            lead_ns=manifest.lead_frames * self._period_ns,
            period_ns=self._period_ns,
            joint_names=controlled.joint_names,
            positions=rows,
            covariance=generated.covariance * (recognition.probabilities @ self.model.covariance_scale),
            interaction=manifest.interactions[recognition.likeliest] if named else "",
            probability=recognition.probability,
            belief=generated.weights,
            phase=generated.phase,
            out_of_distribution=strangeness,
        )


def _counted(state: InferenceState, events: Mapping[str, int]) -> dict[str, int]:
    """The counts with what happened added."""
    counts = dict(state.counts)
    for name, number in events.items():
        counts[name] = counts.get(name, 0) + number
    return counts


def _combined(generated: Sequence[Generated]) -> Generated:
    """Means of the members' parts; the covariance also holds how far their windows disagree."""
    if len(generated) == 1:
        return generated[0]
    motions = np.stack([part.motion for part in generated])
    motion = motions.mean(axis=0)
    apart = (motions - motion).reshape(-1, motion.shape[1])
    covariance = np.mean([part.covariance for part in generated], axis=0) + apart.T @ apart / len(apart)
    weights = np.mean([part.weights for part in generated], axis=0)
    return Generated(motion, covariance, weights, sum(part.phase for part in generated) / len(generated))

# SPDX-License-Identifier: Apache-2.0
"""Inference: a person's feature window in, the controlled agent's next motion window out.

    encode -> update the belief -> recognise -> condition -> mix -> decode -> mix by interaction

Every step except recognition runs once per candidate interaction: networks never learned from a label between
two, and before it can be known which answer is the right one, their mean errs less than any.

Every window ends in exactly one outcome: `accepted`, or what is wrong with it: `wrong_joints`, `wrong_shape`,
`not_finite`, `duplicate`. Beside them, events are counted that may come with any accepted window: `time_reset` (its
stamp lies before the last one), `gap_reset` (more than a window was missed), `reset_at_rest` (the arm has come back to
rest), `missed` (windows that never came), `unknown` (it is far from all that the model knows). The robot's own word of
where it is ends as in `joint_measurements`.

Source: Algorithm 2 of MILD.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mild_core.errors import DataError
from mild_core.inference.gesture_recogniser import GESTURES, UNDECIDED_S, GestureState, unit_arm
from mild_core.inference.manifest import AUTO
from mild_core.inference.member import (
    ConditionedEnsemble,
    Generated,
    MemberState,
    Observed,
    combined,
    condition_ensemble,
)
from mild_core.inference.motion_model import MildModel
from mild_core.inference.priors.filtering import UNDERFLOW
from mild_core.inference.recognition import Recognition, one_hot_belief, recognise, uniform_belief
from mild_core.inference.rest_detection import STILL_S, first_seen, is_back, is_waiting, rests, watch
from mild_core.inference.state import CopyState, InferenceState
from mild_core.joint_measurements import JointMerger
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import NAMED, NONE, OFFERED, RESTING, FeatureWindow, JointMeasurement, MotionWindow

DECIDED = 0.5
"""Probability from which a recognised interaction is named."""

CERTAIN = 0.8
"""The same where people are recognised who were never recorded: in the first second all interactions begin alike."""

NEAR, FAR = 0.4, 1.2
"""Distance from what the model learned from up to which its own evidence counts in full, and from which not at all.
Chosen, like the two below, on people of one data set with models of another."""

KNOWN = 0.5
"""Largest out-of-distribution score of a motion that is taken for a known one; that of any other is above 1."""

MOST_WIDENED = 3.0
"""So many times wider than usual, and once, is the covariance of a given interaction that is not the one performed."""

OWN_NATS = 4.0
"""Most by which the model's own evidence can speak against an interaction."""

OWN_CERTAIN = 0.9
"""Probability of its own from which a model starts an interaction of a person who moves like those it learned from."""

NEGLIGIBLE = 1e-3
"""Probability of an interaction below which what it would answer is not asked for."""

FAST_JOINT_RAD_S = 10.0
"""Speed of the joints of an arm whose limits are unknown."""

_Found = tuple[tuple[Observed, ...], ...]
"""What each member finds, per given interaction."""


@dataclass(frozen=True, eq=False)
class Inference:
    """A model at work.

    Attributes:
        model: A trained model.
        interaction: One of its interactions, or "auto" to recognise it.
        cautious: Whether an interaction starts by its name alone, on more evidence: fewer false starts, later ones.
        joint_velocity_rad_s: (J,) largest speeds of the robot's joints, by which its messages are doubted; empty when
            they are unknown.

    Raises:
        SetupError: The model knows no such interaction; those that it knows are listed.
    """

    model: MildModel
    interaction: str = AUTO
    joint_velocity_rad_s: tuple[float, ...] = ()
    cautious: bool = False

    def __post_init__(self) -> None:
        self.model.manifest.check_interaction(self.interaction)

    @cached_property
    def _ensembles(self) -> tuple[ConditionedEnsemble, ...]:
        """One conditioned ensemble per candidate interaction."""
        return tuple(
            condition_ensemble(self.model.members, i, self.model.residual_covariance) for i in self._considered
        )

    @cached_property
    def _considered(self) -> tuple[int, ...]:
        """Numbers of the interactions that may be the one."""
        names = self.model.manifest.interactions
        return tuple(range(len(names))) if self.interaction == AUTO else (names.index(self.interaction),)

    @cached_property
    def _waves(self) -> NDArray[np.bool_]:
        """(P,) which interactions are waves: hands that are held out do not wave."""
        waves: NDArray[np.bool_] = np.asarray(self.model.gesture_classes) == GESTURES.index("wave")
        return waves

    @cached_property
    def _merger(self) -> JointMerger:
        names = self.model.manifest.controlled.joint_names
        return JointMerger(names, self.joint_velocity_rad_s or (FAST_JOINT_RAD_S,) * len(names))

    @cached_property
    def _period_ns(self) -> int:
        return round(1e9 / self.model.manifest.rate_hz)

    @cached_property
    def _rest_frames(self) -> int:
        return round(self.model.manifest.rest_s * self.model.manifest.rate_hz)

    @cached_property
    def _still_frames(self) -> int:
        return round(STILL_S * self.model.manifest.rate_hz)

    def init(self) -> InferenceState:
        """The state before the first window."""
        names = self.model.manifest.interactions
        is_given = self.interaction != AUTO
        recognition = (
            one_hot_belief(names.index(self.interaction), len(names)) if is_given else uniform_belief(len(names))
        )
        copy = CopyState(-1, tuple(ensemble.init() for ensemble in self._ensembles))
        territory = self.model.territory
        novelty = read_only(np.zeros(0)) if territory is None else territory.init()
        gestures = None if self.model.gestures is None else self.model.gestures.init()
        return InferenceState(recognition, (copy,) * self.model.manifest.stride, novelty, gestures=gestures)

    def reset(self, state: InferenceState) -> InferenceState:
        """The state with nothing remembered of the person."""
        return replace(self.init(), joints=state.joints, start=state.start, counts=state.counts)

    def step(
        self, state: InferenceState, given: FeatureWindow | JointMeasurement, now_ns: int
    ) -> tuple[InferenceState, tuple[MotionWindow, ...]]:
        """Take one window, or the robot's word of where it is.

        Args:
            state: Before it.
            given: A window at the model's rate; or a measurement, which counts while no person is there.
            now_ns: When it came; of windows not used: inference lives in the time of the stamps.

        Returns:
            The state after it, and the one motion window that answers a window; none when it cannot be used.
        """
        if isinstance(given, JointMeasurement):
            return self._measured(state, given, now_ns), ()
        try:
            self._check(state, given)
            before, index, events = self._in_time(state, given)
            seen = self._seen(before, index, given)
            place = index % len(before.copies)
            found = self._observe(before, place, index, given)
        except DataError as error:
            return state.refused(error), ()
        own = self._recognise(before.recognition, found, given, seen)
        novelty, ood_score = self._stray(before.novelty, given, found)
        familiar = self._familiar(own, ood_score) if seen.gestures is not None else ood_score <= 1.0
        own_score = ood_score
        recognition, ood_score = self._carried_over(own, ood_score, seen.gestures)
        generated = self._generate(found, recognition)
        answer = self._beside(generated, given, seen, recognition)
        state_name = self._state_name(recognition, familiar, seen.gestures, before)
        may_start = self._may_start(state_name, own_score, seen.gestures)
        if self.interaction != AUTO and not may_start:
            wider = 1.0 + MOST_WIDENED * min(self._novelty(own_score, seen.gestures) - 1.0, 1.0)
            answer = replace(answer, covariance=wider * answer.covariance)
        motion = self._motion(given, recognition, ood_score, answer, state_name, may_start)
        events = {**events, "accepted": 1, **({"unknown": 1} if ood_score > 1.0 else {})}
        if seen.rest is not None and is_waiting(seen.rest, self._rest_frames):
            seen = replace(before, rest=seen.rest, gestures=seen.gestures)
        else:
            memories = [tuple([MemberState(one.context_memory, one.memory) for one in members]) for members in found]
            copy = CopyState(index, tuple(memories))
            copies = (*before.copies[:place], copy, *before.copies[place + 1 :])
            seen = replace(seen, recognition=own, copies=copies, index=index)
        counts = state.counted(events)
        after = replace(
            seen,
            published=recognition,
            named=state_name == NAMED,
            novelty=novelty,
            counts=counts,
            stamp_ns=given.stamp_ns,
        )
        return replace(after, outcome="accepted", detail=""), (motion,)

    def by_component(self, state: InferenceState, window: FeatureWindow) -> tuple[MotionWindow, ...]:
        """What each component of the likeliest interaction alone expects, for people to look at.

        Args:
            state: Before the window that `step` takes; nothing is remembered.
            window: At the model's rate.

        Raises:
            DataError: The window cannot be used.
        """
        self._check(state, window)
        before, index, _ = self._in_time(state, window)
        found = self._observe(before, index % len(before.copies), index, window)
        recognition = self._recognise(before.recognition, found, window, self._seen(before, index, window))
        motions, place = [], self._considered.index(recognition.likeliest)
        for alone in np.eye(len(found[place][0].weights)):
            sure = tuple([one._replace(weights=alone) for one in found[place]])
            motions.append(self._motion(window, recognition, 0.0, self._ensembles[place].generate(sure), NAMED))
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

    def _in_time(self, state: InferenceState, window: FeatureWindow) -> tuple[InferenceState, int, dict[str, int]]:
        """The state to go on from, the number of the new window, and what happened."""
        if state.stamp_ns is None:
            return state, 0, {}
        passed = max(1, round((window.stamp_ns - state.stamp_ns) / self._period_ns))
        if window.stamp_ns < state.stamp_ns or passed > self.model.manifest.window:
            fresh = self.reset(state)
            if self.model.gestures is not None and state.gestures is not None:
                # The hand may be anywhere by now, and it is the same person as a rule.
                fresh = replace(fresh, gestures=self.model.gestures.after_gap(state.gestures))
            return fresh, 0, {"time_reset" if window.stamp_ns < state.stamp_ns else "gap_reset": 1}
        if state.rest is not None and is_back(state.rest, self._still_frames):
            return self.reset(state), 0, {"reset_at_rest": 1}
        return state, state.index + passed, {"missed": passed - 1} if passed > 1 else {}

    def _seen(self, state: InferenceState, index: int, window: FeatureWindow) -> InferenceState:
        """The state with this window in all that remembers the arm's own motion: reservoir and rest."""
        reservoir, rate_hz, units, rest = self.model.reservoir, self.model.manifest.rate_hz, None, None
        passed, positions = index - state.index, _positions(window)
        if reservoir is not None and np.isfinite(positions).all():
            units = reservoir.listen(positions, rate_hz, state.units, passed)[-1]
        if self._rest_frames > 0:
            hand_m = read_only(positions[:, -3:])
            rest = first_seen(hand_m) if state.rest is None else watch(state.rest, hand_m[-1], passed)
        gestures = state.gestures
        if self.model.gestures is not None and gestures is not None and np.isfinite(positions).all():
            # Of the first window all rows are new: the hand may have left its rest since the oldest.
            rows = positions[-1:] if gestures.stamp_ns is not None else positions
            arms = unit_arm(rows.reshape(-1, 3, 3), sum(self.model.manifest.observed.bone_lengths_m))
            for age, arm in zip(range(len(arms) - 1, -1, -1), arms, strict=True):
                stamp_ns = window.stamp_ns - age * self._period_ns
                gestures = self.model.gestures.step(gestures, arm, stamp_ns, self.cautious)
        return replace(state, units=units, rest=rest, gestures=gestures)

    def _carried_over(
        self, own: Recognition, ood_score: float, gestures: GestureState | None
    ) -> tuple[Recognition, float]:
        """Recognition and novelty with what carries over to strangers.

        The model's own evidence counts where the person moves like those it learned from; the recogniser of gestures
        counts for everybody. A given interaction is never called into question.
        """
        if gestures is None:
            return own, ood_score
        if self.interaction != AUTO:
            return own, min(ood_score, KNOWN)
        trust = min(max((FAR - ood_score) / (FAR - NEAR), 0.0), 1.0)
        own_nats = np.maximum(np.log(own.probabilities + 1e-12), -OWN_NATS)
        log_odds = trust * own_nats + gestures.evidence[self.model.gesture_classes]
        if gestures.held and not self._waves.all():
            log_odds = np.where(self._waves, -np.inf, log_odds)
        weights = np.exp(log_odds - log_odds.max())
        known = gestures.active_s <= UNDECIDED_S or gestures.started or gestures.held or self._familiar(own, ood_score)
        novelty = self._novelty(ood_score, gestures)
        score = min(ood_score, KNOWN * min(novelty, 1.0)) if known else 1.0 + 0.5 * min(novelty, 2.0)
        return Recognition(own.evidence, weights / weights.sum()), score

    def _novelty(self, ood_score: float, gestures: GestureState | None) -> float:
        """Novelty of the motion relative to all people in known interactions: 0 as most, above 1 unknown."""
        if gestures is None or self.model.gestures is None:
            return ood_score
        return (1.0 - gestures.familiar) / (1.0 - float(self.model.gestures.bounds[1]))

    def _may_start(self, name: str, ood_score: float, gestures: GestureState | None) -> bool:
        """Whether the person may be taken to do a known interaction, for a motion in state `name`."""
        if self.interaction != AUTO:
            settled = gestures is None or gestures.active_s > UNDECIDED_S
            return not settled or self._novelty(ood_score, gestures) <= 1.0
        return name == NAMED or not self.cautious

    @staticmethod
    def _familiar(own: Recognition, ood_score: float) -> bool:
        """Whether the person moves like those the model learned from, and it is sure what they do."""
        return ood_score < NEAR and own.probability > OWN_CERTAIN

    def _state_name(
        self, recognition: Recognition, familiar: bool, gestures: GestureState | None, before: InferenceState
    ) -> str:
        """One of `RECOGNITION_STATES`. To name asks for more than to go on: what is named does not flicker."""
        if self.interaction != AUTO:
            return NAMED
        if gestures is None:
            return NAMED if recognition.probability >= DECIDED and familiar else NONE
        if gestures.active_s == 0.0:
            return RESTING
        started = gestures.started or (familiar and not self.cautious)
        published = before.published
        same = published is not None and before.named and published.likeliest == recognition.likeliest
        if started and recognition.probability >= (DECIDED if same else CERTAIN):
            return NAMED
        return OFFERED if gestures.active_s <= UNDECIDED_S or started or gestures.held else NONE

    def _measured(self, state: InferenceState, given: JointMeasurement, now_ns: int) -> InferenceState:
        """The state after the robot said where it is: its start, unless a person is there whom it may be answering."""
        if self.model.start_pose is None:
            return replace(state, outcome="measured", detail="")
        joints = self._merger.take(state.joints, given, now_ns)
        if joints.outcome == "other_joints":
            return replace(state, joints=joints, outcome="other_joints", detail="")
        if joints.outcome != "measured":
            return replace(state, joints=joints).refused(DataError(joints.outcome, joints.detail))
        after = replace(state, joints=joints, outcome="measured", detail="")
        longest_ns = self.model.manifest.window * self._period_ns
        answering = state.stamp_ns is not None and given.stamp_ns - state.stamp_ns <= longest_ns
        return after if answering else replace(after, start=joints.positions_rad)

    def _beside(
        self, members: Generated, window: FeatureWindow, seen: InferenceState, recognition: Recognition
    ) -> Generated:
        """What the members expect, blended with what the reservoir expects and displaced by the robot's start."""
        label, model, motion, covariance = recognition.probabilities, self.model, members.motion, members.covariance
        if model.reservoir is not None and seen.units is not None:
            answer = model.reservoir.answer(seen.units, _positions(window), label)
            motion, covariance = model.reservoir.blend(motion, covariance, answer)
        if model.start_pose is not None and seen.start is not None:
            resting = rests(seen.rest, _positions(window)[-1, -3:])
            motion = model.start_pose.displaced(motion, seen.start, label, resting)
        return replace(members, motion=motion, covariance=covariance)

    def _observe(self, state: InferenceState, place: int, index: int, window: FeatureWindow) -> _Found:
        """What each member finds, given each interaction. Raises DataError when a feature is not finite."""
        copy, stride = state.copies[place], len(state.copies)
        missed = (index - copy.index) // stride - 1 if copy.index >= 0 else -1
        features = window.features
        if not (features.flags.c_contiguous and features.flags.aligned):
            features = read_only(np.array(features, order="C"))  # Any other layout would be compiled again.
        both = zip(self._ensembles, copy.members, strict=True)
        found = tuple([ensemble.observe(own, features, missed) for ensemble, own in both])
        if math.isnan(found[0][0].score):
            raise DataError("not_finite", "a feature is NaN or infinite")
        return found

    def _generate(self, found: _Found, recognition: Recognition) -> Generated:
        """Predictions averaged with the interaction posterior; belief and phase of the likeliest interaction."""
        shares = recognition.probabilities[list(self._considered)]
        asked = np.flatnonzero(shares > NEGLIGIBLE)
        answers = [self._ensembles[place].generate(found[place]) for place in asked]
        likeliest = answers[int(shares[asked].argmax())]
        mixed = combined(answers, shares[asked] / shares[asked].sum())
        return replace(mixed, weights=likeliest.weights, phase=likeliest.phase)

    def _recognise(
        self, before: Recognition, found: _Found, window: FeatureWindow, seen: InferenceState
    ) -> Recognition:
        """A frame that no interaction can explain says nothing about which one it is."""
        if self.interaction != AUTO:
            return before
        log_likelihoods = np.array([[one.log_likelihood for one in members] for members in found])
        if log_likelihoods.max() <= UNDERFLOW:
            return before
        evidence = self._ensembles[0].recognise(found[0]) if self.model.recognises else log_likelihoods.mean(axis=1)
        if self.model.reservoir is not None and seen.units is not None:
            by_motion = self.model.reservoir.classify(seen.units, _positions(window))
            evidence = 0.5 * (evidence + by_motion) if self.model.recognises else by_motion
        return recognise(before, evidence, self.model.temper, self.model.forgetting)

    def _stray(self, novelty: FloatArray, window: FeatureWindow, found: _Found) -> tuple[FloatArray, float]:
        """The novelty of the motion for each interaction, and the out-of-distribution score."""
        ood_score = min([sum([seen.score for seen in members]) / len(members) for members in found])
        if self.model.territory is None:
            return novelty, ood_score
        novelty = self.model.territory.follow(novelty, window.features)
        return novelty, max(ood_score, self.model.territory.score(novelty))

    def _motion(
        self,
        window: FeatureWindow,
        recognition: Recognition,
        ood_score: float,
        generated: Generated,
        state_name: str,
        may_start: bool = True,
    ) -> MotionWindow:
        manifest = self.model.manifest
        regions = recognition.probabilities @ self.model.radii
        controlled = manifest.controlled
        rows = generated.motion if controlled.unit == "rad" else generated.motion.reshape(manifest.window, -1, 3)
        return MotionWindow(
            stamp_ns=window.stamp_ns,
            lead_ns=manifest.lead_frames * self._period_ns,
            period_ns=self._period_ns,
            joint_names=controlled.joint_names,
            positions=rows,
            covariance=generated.covariance * (recognition.probabilities @ self.model.covariance_scale),
            interaction=manifest.interactions[recognition.likeliest] if state_name == NAMED else "",
            probability=recognition.probability,
            belief=generated.weights,
            phase=generated.phase,
            out_of_distribution=ood_score,
            state=state_name,
            radii=(float(regions[0]), float(regions[1])),
            may_start=may_start,
        )


def _positions(window: FeatureWindow) -> FloatArray:
    """(W, 3 J) a window without its velocities [m]."""
    return window.features[:, : 3 * len(window.joint_names)]

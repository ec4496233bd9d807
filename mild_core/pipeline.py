# SPDX-License-Identifier: Apache-2.0
"""The whole system on one screen: three pure stages, one after the other.

Live nodes, offline replay and evaluation all run these same stages. Nothing here knows of ROS: time comes in as
an argument, so replay is a fold over (input, now_ns) and a bug report is one saved state.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from mild_core.inference.stage import Inference
from mild_core.inference.state import InferenceState
from mild_core.perception.stage import Perception, PerceptionState
from mild_core.retargeting.stage import Request, Retargeting, RetargetingInput, RetargetingState
from mild_core.signals import FeatureWindow, JointCommand, JointMeasurement, MotionWindow, PersonPose, SkeletonFrame

People = tuple[SkeletonFrame, ...]
"""Everyone in one tracker message; empty when it sees no person."""

PipelineInput = People | JointMeasurement | Request | None
"""A tracker message, the robot's own state, a request of the operator, or None: one tick of the control clock."""


@dataclass(frozen=True)
class PipelineState:
    """All that changes while the system runs, as a value."""

    perception: PerceptionState
    inference: InferenceState
    retargeting: RetargetingState


@dataclass(frozen=True)
class PipelineOutput:
    """Everything that one input led to, in order; any part may be empty."""

    windows: tuple[FeatureWindow, ...] = ()
    motions: tuple[MotionWindow, ...] = ()
    commands: tuple[JointCommand, ...] = ()
    person: PersonPose | None = None


@dataclass(frozen=True)
class Pipeline:
    """A person's arm in, a robot's arm out."""

    perception: Perception
    inference: Inference
    retargeting: Retargeting

    def init(self) -> PipelineState:
        """The state before the first input."""
        return PipelineState(self.perception.init(), self.inference.init(), self.retargeting.init())

    def step(self, state: PipelineState, given: PipelineInput, now_ns: int) -> tuple[PipelineState, PipelineOutput]:
        """Take one input at time `now_ns` and return the next state and what came of it.

        A request to reset goes to all three stages; they forget the person and keep their counts.
        """
        perception, inference, seen = self.observe(state.perception, state.inference, given, now_ns)
        retargeting = state.retargeting
        commands: tuple[JointCommand, ...] = ()
        for part in inputs_of_retargeting(given, seen):
            retargeting, new_commands = self.retargeting.step(retargeting, part, now_ns)
            commands += new_commands
        return PipelineState(perception, inference, retargeting), replace(seen, commands=commands)

    def observe(
        self, perception: PerceptionState, inference: InferenceState, given: PipelineInput, now_ns: int
    ) -> tuple[PerceptionState, InferenceState, PipelineOutput]:
        """The part of `step` before retargeting, for a node whose control runs beside its reception."""
        if isinstance(given, tuple):
            perception, windows = self.perception.step(perception, given, now_ns)
            motions: tuple[MotionWindow, ...] = ()
            for window in windows:
                inference, new_motions = self.inference.step(inference, window, now_ns)
                motions += new_motions
            return perception, inference, PipelineOutput(windows, motions, person=perception.person)
        if isinstance(given, JointMeasurement):
            inference, _ = self.inference.step(inference, given, now_ns)
        if given == Request("reset"):
            perception, inference = self.perception.reset(perception), self.inference.reset(inference)
        return perception, inference, PipelineOutput()


def inputs_of_retargeting(given: PipelineInput, seen: PipelineOutput) -> tuple[RetargetingInput, ...]:
    """What retargeting takes, in order, of an input of which perception and inference made `seen`."""
    if not isinstance(given, tuple):
        return (given,)
    return (*(() if seen.person is None else (seen.person,)), *seen.motions)

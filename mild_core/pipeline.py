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
from mild_core.retargeting.stage import Request, Retargeting, RetargetingState
from mild_core.signals import FeatureWindow, JointCommand, JointMeasurement, MotionWindow, PersonPose, SkeletonFrame

People = tuple[SkeletonFrame, ...]
"""Everyone in one tracker message; empty when it sees nobody."""

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
        """Take one input at time `now_ns` and return the next state and what came of it."""
        if not isinstance(given, tuple):
            inference = state.inference
            if isinstance(given, JointMeasurement):
                inference, _ = self.inference.step(inference, given, now_ns)
            retargeting, commands = self.retargeting.step(state.retargeting, given, now_ns)
            return replace(state, inference=inference, retargeting=retargeting), PipelineOutput(commands=commands)
        perception, windows = self.perception.step(state.perception, given, now_ns)
        inference = state.inference
        motions: tuple[MotionWindow, ...] = ()
        for window in windows:
            inference, new_motions = self.inference.step(inference, window, now_ns)
            motions += new_motions
        retargeting, commands = state.retargeting, ()
        if perception.person is not None:
            retargeting, _ = self.retargeting.step(retargeting, perception.person, now_ns)
        for motion in motions:
            retargeting, new_commands = self.retargeting.step(retargeting, motion, now_ns)
            commands += new_commands
        output = PipelineOutput(windows, motions, commands, perception.person)
        return PipelineState(perception, inference, retargeting), output

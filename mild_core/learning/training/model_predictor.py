# SPDX-License-Identifier: Apache-2.0
"""A model folder as one of the compared methods: answers come from the very stage that moves the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mild_core.errors import ModelError
from mild_core.inference.model import Manifest, MildModel
from mild_core.inference.stage import Inference
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol, cut, feature_windows
from mild_core.shapes import FloatArray
from mild_core.signals import JointMeasurement, MotionWindow

AUTO = "auto"
"""The interaction is recognised, not given."""


@dataclass(frozen=True, eq=False)
class Answers:
    """What inference said of a trial.

    Attributes:
        predicted: (N, W, J) joint angles [rad], or (N, W, J, 3) the partner's arm [m].
        covariances: (N, n, n) of a frame's values, averaged over the window.
        interactions: N, the interaction it acted upon; "" when it knew none.
        out_of_distribution: (N,) see `MotionWindow`.
    """

    predicted: FloatArray
    covariances: FloatArray
    interactions: tuple[str, ...]
    out_of_distribution: FloatArray


@dataclass(frozen=True, eq=False)
class ModelPredictor:
    """Runs `Inference` over the windows of a trial, from its start, one after the other."""

    model: MildModel
    protocol: Protocol

    def predict(self, demonstration: Demonstration) -> FloatArray:
        """With the interaction given (see `Predictor`)."""
        return self.answers(demonstration, demonstration.interaction).predicted

    def answers(
        self, demonstration: Demonstration, interaction: str, *, started: bool = False, standing_s: float = 0.0
    ) -> Answers:
        """All that inference says of a trial.

        Args:
            demonstration: The trial.
            interaction: Its name, or "auto".
            started: Whether the robot says where it stands at the start.
            standing_s: How long both agents stand still before it; windows of that time are not in the result.

        Raises:
            ModelError: Inference left a window of a recorded trial without an answer, or `started` is asked of a model
                that does not move a robot.
        """
        manifest = self.model.manifest
        if started and manifest.controlled.kind == "human_arm":
            problem = "moves a partner's arm: there is no robot that could say where it starts"
            raise ModelError(f"model '{manifest.name}'", problem, "use labels given, recognised or live")
        windows = len(cut(demonstration, self.protocol).controlled)
        demonstration = stand_before(demonstration, standing_s)
        stage = Inference(self.model, interaction)
        state = stage.init()
        if started:
            pose = JointMeasurement(0, demonstration.controlled_names, demonstration.controlled[0])
            state, _ = stage.step(state, pose, 0)
        motions: list[MotionWindow] = []
        for window in feature_windows(demonstration, self.protocol):
            state, answer = stage.step(state, window, window.stamp_ns)
            motions += answer
        true = cut(demonstration, self.protocol).controlled
        if len(motions) != len(true):
            problem = f"answered {len(motions)} of the {len(true)} windows of trial {demonstration.trial}"
            raise ModelError(f"model '{self.model.manifest.name}'", problem, "retrain it")
        predicted = np.array([motion.positions for motion in motions]).reshape(true.shape)[len(true) - windows :]
        motions = motions[len(true) - windows :]
        scores = np.array([motion.out_of_distribution for motion in motions])
        covariances = np.array([motion.covariance for motion in motions])
        return Answers(predicted, covariances, tuple(motion.interaction for motion in motions), scores)


def stand_before(demonstration: Demonstration, standing_s: float) -> Demonstration:
    """The trial after both agents have stood still for a while, where they are at its start."""
    frames = round(standing_s * demonstration.rate_hz)
    if not frames:
        return demonstration
    observed, controlled = demonstration.observed_m, demonstration.controlled
    return replace(
        demonstration,
        observed_m=np.concatenate([np.repeat(observed[:1], frames, axis=0), observed]),
        controlled=np.concatenate([np.repeat(controlled[:1], frames, axis=0), controlled]),
        active=np.concatenate([np.zeros(frames), demonstration.active]),
    )


def require_fit(manifest: Manifest, protocol: Protocol, demonstrations: Sequence[Demonstration]) -> None:
    """Refuse to compare what cannot be compared.

    Args:
        manifest: Of the model.
        protocol: By which it shall be measured.
        demonstrations: On which it shall be measured.

    Raises:
        ModelError: The model was trained for another protocol, other joints, another rate or other interactions.
    """
    thing = f"model '{manifest.name}'"
    if manifest.protocol != protocol.name:
        problem = f"was trained for protocol '{manifest.protocol}', so its error by '{protocol.name}' means nothing"
        raise ModelError(thing, problem, f"use --protocol {manifest.protocol}, or a model of '{protocol.name}'")
    for trial in demonstrations:
        rate_hz = trial.rate_hz / protocol.keep_every
        problems = {
            f"moves {_listed(manifest.controlled.joint_names)}, the recording {_listed(trial.controlled_names)}": (
                manifest.controlled.joint_names != trial.controlled_names
            ),
            f"observes {_listed(manifest.observed.joint_names)}, the recording {_listed(trial.observed_names)}": (
                manifest.observed.joint_names != trial.observed_names
            ),
            f"runs at {manifest.rate_hz:g} Hz, the recording at {rate_hz:g} Hz": manifest.rate_hz != rate_hz,
            f"has windows of {manifest.window} frames, the recording's of {protocol.window}": (
                manifest.window != protocol.window
            ),
            f"does not know '{trial.interaction}', only {_listed(manifest.interactions)}": (
                trial.interaction not in manifest.interactions
            ),
        }
        for problem, found in problems.items():
            if found:
                raise ModelError(thing, problem, "take the recording it belongs to")


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names)

# SPDX-License-Identifier: Apache-2.0
"""How far from a stranger's hand a model sends the robot's, without a camera that measures where they stand.

A stranger holds the hand out elsewhere than the people of the model's recording did. Theirs are put where those
stood, with arms of the model's bones, and asked is where the robot's tool would be while their hand is held out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mild_core.inference.gesture_recogniser import SAME
from mild_core.inference.model import MildModel
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.recording import Recording
from mild_core.learning.data.windows import Protocol
from mild_core.learning.training.model_predictor import ModelPredictor
from mild_core.learning.training.place_fit import FittedPlace, fit_contact, touching, turned_about_z
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray

THEIR_OWN = {"pepper_nuisi": "nuisi"}
"""Recordings of the same people under another name."""


def as_observed(arm_m: FloatArray, bones_m: tuple[float, float]) -> FloatArray:
    """(T, 3, 3) an arm as perception hands it to a model: its bones, the stranger's directions, from the shoulder."""
    bones = np.diff(arm_m, axis=1)
    lengths = np.linalg.norm(bones, axis=2, keepdims=True)
    bones = bones / np.maximum(lengths, 1e-9) * np.array(bones_m)[:, None]
    scale = sum(bones_m) / float(np.median(lengths.sum(axis=1)))
    shoulder = (arm_m[:, :1] - arm_m[:1, :1]) * scale
    seen: FloatArray = np.concatenate(
        [shoulder, shoulder + bones[:, :1], shoulder + bones.sum(axis=1)[:, None]], axis=1
    )
    return seen


def strangers_for(model: MildModel, rate_hz: float, trials: Sequence[Demonstration]) -> list[Demonstration]:
    """Both people of other recordings as trials of a model; what its robot did is unknown, and zeros stand there.

    Args:
        model: Which.
        rate_hz: Of the recording that it learned from.
        trials: Of people; those of interactions that it does not know are left out.
    """
    observed, controlled = model.manifest.observed, model.manifest.controlled
    names = {SAME.get(name, name): name for name in model.manifest.interactions}
    found = []
    for trial in trials:
        name = names.get(SAME.get(trial.interaction, trial.interaction))
        for arm_m in (trial.observed_m, *((trial.controlled,) if trial.partner else ())) if name else ():
            arm = as_observed(arm_m, observed.bone_lengths_m)
            times = np.arange(0.0, (len(arm) - 1) / trial.rate_hz + 1e-9, 1.0 / rate_hz)
            columns = arm.reshape(len(arm), -1).T
            arm = np.stack([np.interp(times, np.arange(len(arm)) / trial.rate_hz, c) for c in columns], axis=1)
            still = np.zeros((len(times), len(controlled.joint_names)))
            arm = arm.reshape(len(times), 3, 3)
            joints = controlled.joint_names
            found.append(
                Demonstration(
                    trial.trial, str(name), rate_hz, observed.joint_names, arm, joints, still, np.ones(len(times))
                )
            )
    return found


def tool_to_hand_m(
    trial: Demonstration, predicted: FloatArray, protocol: Protocol, robot: RobotModel, place: FloatArray, yaw: float
) -> FloatArray:
    """(M,) distances [m] while the hand is held out, of the row of each window that comes next after its question.

    Args:
        trial: The person.
        predicted: (N, W, J) joints of each window [rad].
        protocol: By which it was cut.
        robot: Whose.
        place: (3,) of the person's shoulder in the robot's base frame [m].
        yaw: Which way they look [rad].
    """
    hand = trial.observed_m[:, -1]
    near, hand = touching(hand)[:: protocol.keep_every], hand[:: protocol.keep_every] @ turned_about_z(yaw).T + place
    row = 0 if protocol.lead_frames > 0 else protocol.window - 1
    tool = forward_kinematics(robot, predicted[:, row], robot.tool_link)[:, :3, 3]
    frames = np.arange(len(tool)) + protocol.window - 1 + protocol.lead_frames + row
    distance: FloatArray = np.linalg.norm(tool - hand[frames], axis=1)[near[frames]]
    return distance


def measure_motion(
    model: MildModel, own: Recording, robot: RobotModel, others: Sequence[Recording]
) -> dict[str, dict[str, Mapping[str, float]]]:
    """By other recording and interaction in which hands meet: `mean_m`, `median_m` and `arms`, the interaction given.

    Args:
        model: Of a robot.
        own: What it learned from.
        robot: Which it moves.
        others: Whose people it shall meet.
    """
    protocol, trained = own.protocols[model.manifest.protocol], own.read(own.default_path()).train
    contact = fit_contact(trained, robot, own.touching, arm_lengths_m=model.manifest.observed.bone_lengths_m)
    predictor, found = ModelPredictor(model, protocol), dict[str, dict[str, Mapping[str, float]]]()
    for other in others:
        people = strangers_for(model, own.rate_hz, other.read(other.default_path()).train)
        found[other.name] = _by_interaction(predictor, people, robot, contact)
    return found


def _by_interaction(
    predictor: ModelPredictor, people: Sequence[Demonstration], robot: RobotModel, contact: FittedPlace
) -> dict[str, Mapping[str, float]]:
    found: dict[str, Mapping[str, float]] = {}
    for name, place in contact.by_interaction.items():
        distances = []
        for trial in people:
            if trial.interaction == name:
                predicted = predictor.predict(trial)
                distances.append(tool_to_hand_m(trial, predicted, predictor.protocol, robot, place, contact.yaw_rad))
        distances = [one for one in distances if len(one)]
        if distances:
            found[name] = _summary(distances)
    return found


def _summary(distances: Sequence[FloatArray]) -> dict[str, Any]:
    means = [float(one.mean()) for one in distances]
    return {"mean_m": float(np.mean(means)), "median_m": float(np.median(means)), "arms": len(means)}


def strangers_to(own: Recording, recordings: Sequence[Recording]) -> list[Recording]:
    """Those of whose people a model of `own` has seen none."""
    same = {own.name, THEIR_OWN.get(own.name, own.name)}
    return [one for one in recordings if one.name not in same]

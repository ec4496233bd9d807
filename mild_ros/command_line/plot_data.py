# SPDX-License-Identifier: Apache-2.0
"""What the figures show, as plain arrays: a model run over trials, looked at from different sides."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mild_core.errors import SetupError
from mild_core.shapes import FloatArray
from mild_core.signals import MotionWindow
from mild_ros.viewing.figures.joints import Motion
from mild_ros.viewing.figures.latent import LatentSpace
from mild_ros.viewing.figures.skeletons import Moment

if TYPE_CHECKING:
    from mild_core.inference.motion_model import MildModel
    from mild_core.learning.data.demonstration import Demonstration
    from mild_core.learning.data.recording import Recording
    from mild_core.learning.data.windows import Protocol

PARTNER_AT_M = (0.9, 0.37, 0.0)
"""Where a partner's right shoulder is drawn, seen from the person's: recordings of two people do not contain it. Face
to face one's right is the other's left, and shoulders are 0.37 m apart."""


@dataclass(frozen=True, eq=False)
class ModelTrials:
    """A model and the trials that it watches."""

    model: MildModel
    recording: Recording
    protocol: Protocol
    trials: tuple[Demonstration, ...]


def watched(name: str, data: Path | None, split: str, trial: int | None = None) -> ModelTrials:
    """Load a model and its recording; only one trial of it where `trial` is given.

    Raises:
        SetupError: There is no such model, recording, split or trial.
    """
    from mild_core.inference.model import load_model
    from mild_core.learning.datasets import recording_named
    from mild_core.learning.training.model_predictor import require_fit
    from mild_core.resources import model_folder

    model = load_model(model_folder(name))
    recording = recording_named(str(model.manifest.training.get("dataset", "buetepage_hr")), data)
    protocol, path = recording.protocols[model.manifest.protocol], data or recording.default_path()
    trials = recording.read(path).split(split)
    if not trials:
        raise SetupError(str(path), f"its {split} split is empty", "give a file with such trials, or the other split")
    if trial is not None:
        if trial >= len(trials):
            raise SetupError(
                f"trial {trial}", f"there are {len(trials)} {split} trials", f"give at most {len(trials) - 1}"
            )
        trials = (trials[trial],)
    require_fit(model.manifest, protocol, trials)
    return ModelTrials(model, recording, protocol, trials)


def latent_spaces(seen: ModelTrials) -> dict[str, dict[str, LatentSpace]]:
    """Tracks and components of both agents by interaction, of the model's first member."""
    from mild_core.learning.evaluation.latent_view import latent_track

    manifest, other = seen.model.manifest, "partner" if seen.recording.robot == "" else "robot"
    size = manifest.latent_size
    found: dict[str, dict[str, LatentSpace]] = {"person": {}, other: {}}
    for prior, name in zip(seen.model.members[0].priors, manifest.interactions, strict=True):
        trials = [trial for trial in seen.trials if trial.interaction == name]
        tracks = [latent_track(seen.model, trial, seen.protocol) for trial in trials]
        if not tracks:
            continue
        mean, covariance = prior.components.mean, prior.components.covariance
        person = LatentSpace([t.observed for t in tracks], mean[:, :size], covariance[:, :size, :size])
        moved = LatentSpace([t.controlled for t in tracks], mean[:, size:], covariance[:, size:, size:])
        found["person"][name], found[other][name] = person, moved
    return found


def errors_over_window(seen: ModelTrials) -> tuple[dict[str, FloatArray], FloatArray]:
    """(trials, W) mean squared error by interaction, and (W,) the time of each frame after the newest one seen."""
    from mild_core.learning.data.windows import cut
    from mild_core.learning.training.model_predictor import ModelPredictor

    predictor, found = ModelPredictor(seen.model, seen.protocol), dict[str, list[FloatArray]]()
    for trial in seen.trials:
        squared = (predictor.predict(trial) - cut(trial, seen.protocol).controlled) ** 2
        squared = squared.sum(axis=3) if trial.partner else squared
        found.setdefault(trial.interaction, []).append(squared.mean(axis=(0, 2)))
    frames = seen.protocol.lead_frames + np.arange(seen.protocol.window)
    return {name: np.array(rows) for name, rows in found.items()}, frames / seen.model.manifest.rate_hz


def motion_of(seen: ModelTrials) -> Motion:
    """The last frame of each window predicted for the one trial, beside what was recorded."""
    from mild_core.inference.stage import Inference
    from mild_core.learning.data.windows import feature_windows, thin

    (trial,), manifest, unit = seen.trials, seen.model.manifest, seen.recording.unit
    stage = Inference(seen.model, trial.interaction)
    motions: list[MotionWindow] = []
    state = stage.init()
    for window in feature_windows(trial, seen.protocol):
        state, answers = stage.step(state, window, window.stamp_ns)
        motions += answers
    predicted = np.array([motion.positions[-1].ravel() for motion in motions])
    deviation = np.array([np.sqrt(np.diagonal(motion.covariance)) for motion in motions])
    last = seen.protocol.window - 1 + seen.protocol.lead_frames + seen.protocol.window - 1
    recorded = thin(trial, seen.protocol).controlled.reshape(-1, predicted.shape[1])
    names = tuple(f"{joint} {axis}" for joint in manifest.controlled.joint_names for axis in "xyz")
    return Motion(
        names=names if trial.partner else tuple(manifest.controlled.joint_names),
        true_s=np.arange(len(recorded)) / manifest.rate_hz,
        true=recorded * unit.scale,
        predicted_s=(last + np.arange(len(predicted))) / manifest.rate_hz,
        predicted=predicted * unit.scale,
        deviation=deviation * unit.scale,
        unit=unit.shown.strip(),
    )


def moments_of(seen: ModelTrials, count: int) -> list[Moment]:
    """Moments spread over the one trial, both arms in the frame of the person's shoulder."""
    from mild_core.learning.data.windows import thin

    (trial,), motion = seen.trials, motion_of(seen)
    person = thin(trial, seen.protocol).observed_m
    first = round(float(motion.predicted_s[0]) * seen.model.manifest.rate_hz)
    away = np.linalg.norm(person[first:, -1] - person[0, -1], axis=1)[: len(motion.predicted)]
    busy = np.flatnonzero(away > 0.15 * away.max())
    chosen = np.linspace(busy[0], busy[-1], count).round().astype(int)
    shape = (-1, *trial.controlled.shape[1:])
    recorded, predicted = (values / seen.recording.unit.scale for values in (motion.true, motion.predicted))
    arms = [_other_arm(seen, values.reshape(shape)) for values in (recorded, predicted)]
    times = motion.predicted_s
    person_m = _lengthened(person, seen.model.manifest.robot_from_human.arm_lengths_m)
    return [Moment(float(times[i]), person_m[first + i], arms[0][first + i], arms[1][i]) for i in chosen]


def _lengthened(arm: FloatArray, lengths_m: tuple[float, float] | None) -> FloatArray:
    """The arm (T, 3, 3) with the bones of the person for whom the robot's place holds."""
    if lengths_m is None:
        return arm
    bones = np.diff(arm, axis=1)
    bones = bones / np.linalg.norm(bones, axis=2, keepdims=True) * np.array(lengths_m)[:, None]
    longer: FloatArray = np.concatenate([arm[:, :1], arm[:, :1] + np.cumsum(bones, axis=1)], axis=1)
    return longer


def _other_arm(seen: ModelTrials, controlled: FloatArray) -> FloatArray:
    """(T, M, 3) the other's arm in the person's arm frame [m], whose x axis points at the other."""
    if seen.recording.unit.squared == "m^2":
        facing: FloatArray = np.array(PARTNER_AT_M) + controlled * np.array([-1.0, -1.0, 1.0])
        return facing
    from mild_core.retargeting.robot_model.kinematics import read_tree
    from mild_core.retargeting.robots import ROBOTS

    robot, placement = ROBOTS[seen.recording.robot], seen.model.manifest.robot_from_human
    tree = read_tree(robot.urdf_path)
    names = seen.model.manifest.controlled.joint_names
    positions: dict[str, Any] = {**dict(robot.rest), **{name: controlled[:, i] for i, name in enumerate(names)}}
    links = [joint.child for joint in tree.chain(robot.tool_link) if joint.name in names] + [robot.tool_link]
    points = np.stack([tree.pose(link, positions)[:, :3, 3] for link in links], axis=1)
    interaction = seen.trials[0].interaction
    shoulder = np.array(placement.by_interaction.get(interaction, placement.translation_m))
    cosine, sine = np.cos(placement.yaw_rad), np.sin(placement.yaw_rad)
    turned: FloatArray = (points - shoulder) @ np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    return turned

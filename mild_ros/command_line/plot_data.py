# SPDX-License-Identifier: Apache-2.0
"""What the figures show, as plain arrays: a model run over trials, looked at from different sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mild_core.errors import SetupError
from mild_core.shapes import FloatArray
from mild_core.signals import MotionWindow
from mild_ros.command_line.console import Console
from mild_ros.command_line.held_out import learn_without
from mild_ros.viewing.figures.joints import Motion
from mild_ros.viewing.figures.latent import LatentSpace
from mild_ros.viewing.figures.skeletons import Moment

if TYPE_CHECKING:
    from mild_core.inference.motion_model import MildModel
    from mild_core.learning.data.baseline import Predictor
    from mild_core.learning.data.demonstration import Demonstration
    from mild_core.learning.data.recording import Recording
    from mild_core.learning.data.windows import Protocol

PARTNER_AT_M = (0.9, 0.37, 0.0)
"""Where a partner's right shoulder is drawn, seen from the person's: recordings of two people do not contain it. Face
to face one's right is the other's left, and shoulders are 0.37 m apart."""


@dataclass(frozen=True, eq=False)
class ModelTrials:
    """A model and the trials that it watches.

    Attributes:
        model: The model.
        recording: Where the trials are from.
        protocol: Of the model.
        trials: What it watches.
        which: What these trials are to the model, for titles.
        learned: Trials that other methods may learn from to be shown beside it; empty where it saw these trials.
        controlled_latents: See `HeldOutModel`; empty of a model folder, which holds no network for them.
        seed: Of the model's draws.
    """

    model: MildModel
    recording: Recording
    protocol: Protocol
    trials: tuple[Demonstration, ...]
    which: str
    learned: tuple[Demonstration, ...] = ()
    controlled_latents: tuple[FloatArray, ...] = ()
    seed: int = 0

    def only(self, place: int) -> ModelTrials:
        """The same with one of its trials.

        Raises:
            SetupError: There is none.
        """
        if place >= len(self.trials):
            problem = f"there are {len(self.trials)} {self.which}"
            raise SetupError(f"trial {place}", problem, f"give at most {len(self.trials) - 1}")
        return replace(self, trials=(self.trials[place],), controlled_latents=())


def watched(name: str, data: Path | None, split: str = "", fold: int | None = None) -> ModelTrials:
    """A model and trials that it did not learn from, unless they are asked for.

    Args:
        name: Of a model or its folder; with `fold` also of a configuration.
        data: The recording; None: where its data set lies.
        split: "test", "train" (which the model learned from), or "": those of `fold`, or the test trials where the
            recording has some.
        fold: Held out from a model that is learned for it.

    Raises:
        SetupError: There is no such model, recording, split or fold, or no trial that the model did not learn from.
    """
    from mild_core.learning.datasets import recording_named
    from mild_core.learning.training.model_predictor import require_fit
    from mild_core.resources import load_model

    if fold is not None:
        if split:
            raise SetupError("--split and --fold", "are both given", "give one")
        without = learn_without(name, data, fold)
        parts = (without.recording, without.protocol, without.held_out, f"trials of fold {fold}, held out")
        return ModelTrials(without.model, *parts, without.learned, without.controlled_latents, without.seed)
    model = load_model(name)
    recording = recording_named(str(model.manifest.training.get("dataset", "buetepage_hr")), data)
    protocol, path = recording.protocols[model.manifest.protocol], data or recording.default_path()
    read = recording.read(path)
    trials = read.split(split or "test")
    if not trials and not split:
        problem = "has no trial that the model did not learn from"
        remedy = "give --fold 0 (the model is learned without that fold) or --split train"
        raise SetupError(str(path), problem, remedy)
    if not trials:
        raise SetupError(str(path), f"its {split} split is empty", "give --fold 0, or the other split")
    require_fit(model.manifest, protocol, trials)
    if split == "train":
        return ModelTrials(model, recording, protocol, trials, "training trials, which it learned from")
    return ModelTrials(model, recording, protocol, trials, "test trials", read.train)


def latent_spaces(seen: ModelTrials) -> dict[str, dict[str, LatentSpace]]:
    """Tracks and components of both agents by interaction, of the model's first member: their own posteriors."""
    from mild_core.learning.evaluation.latent_view import latent_track

    manifest, other = seen.model.manifest, "partner" if seen.recording.robot == "" else "robot"
    size = manifest.latent_size
    found: dict[str, dict[str, LatentSpace]] = {"person": {}, other: {}}
    for prior, name in zip(seen.model.members[0].priors, manifest.interactions, strict=True):
        both = zip(seen.trials, seen.controlled_latents, strict=True)
        here = [(trial, latents) for trial, latents in both if trial.interaction == name]
        if not here:
            continue
        tracks = [latent_track(seen.model, trial, seen.protocol).observed for trial, _ in here]
        mean, covariance = prior.components.mean, prior.components.covariance
        found["person"][name] = LatentSpace(tracks, mean[:, :size], covariance[:, :size, :size])
        found[other][name] = LatentSpace([latents for _, latents in here], mean[:, size:], covariance[:, size:, size:])
    return found


BESIDE = "buetepage"
"""What Fig. 4 of the paper shows beside MILD."""


def errors_over_window(seen: Sequence[ModelTrials]) -> tuple[dict[str, dict[str, FloatArray]], FloatArray]:
    """Ours, and Bütepage et al.'s where it can learn without the trials: (trials, W) mean squared error by interaction.

    Args:
        seen: One model's, of one or several folds.

    Returns:
        That by method, and (W,) the time of each frame after the newest one seen.
    """
    from mild_core.learning.evaluation.methods import METHODS
    from mild_core.learning.training.model_predictor import ModelPredictor

    errors: dict[str, dict[str, list[FloatArray]]] = {}
    for one in seen:
        methods: dict[str, Predictor] = {METHODS["mild"].title: ModelPredictor(one.model, one.protocol)}
        if one.learned:
            with Console(stderr=True).status(f"learning {METHODS[BESIDE].title} for {one.which}"):
                methods[METHODS[BESIDE].title] = METHODS[BESIDE].fit(one.learned, one.protocol, one.seed)
        for title, predictor in methods.items():
            for trial in one.trials:
                rows = errors.setdefault(title, {}).setdefault(trial.interaction, [])
                rows.append(_over_window(predictor, trial, one.protocol))
    first = seen[0]
    frames = first.protocol.lead_frames + np.arange(first.protocol.window)
    arrays = {title: {name: np.array(rows) for name, rows in found.items()} for title, found in errors.items()}
    return arrays, frames / first.model.manifest.rate_hz


def _over_window(predictor: Predictor, trial: Demonstration, protocol: Protocol) -> FloatArray:
    """(W,) mean squared error of a trial's windows."""
    from mild_core.learning.data.windows import cut

    squared = (predictor.predict(trial) - cut(trial, protocol).controlled) ** 2
    squared = squared.sum(axis=3) if trial.partner else squared
    mean: FloatArray = squared.mean(axis=(0, 2))
    return mean


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
    last, _ = _first_and_count(seen)
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
    begin, end = _busy_s(seen)
    return _moments(seen, np.linspace(begin, end, count))


def moments_of_each(seen: ModelTrials, count: int) -> dict[str, list[Moment]]:
    """The same of the first trial of each interaction, all at equal times."""
    places = {trial.interaction: place for place, trial in reversed(list(enumerate(seen.trials)))}
    ones = {name: seen.only(places[name]) for name in seen.model.manifest.interactions if name in places}
    spans = [_busy_s(one) for one in ones.values()]
    times_s = np.linspace(min(begin for begin, _ in spans), max(end for _, end in spans), count)
    return {name.replace("_", " "): _moments(one, times_s) for name, one in ones.items()}


def _busy_s(seen: ModelTrials) -> tuple[float, float]:
    """When the person's hand leaves its rest and is back, of the times that predictions are for [s]."""
    from mild_core.learning.data.windows import thin

    (trial,), rate_hz = seen.trials, seen.model.manifest.rate_hz
    person = thin(trial, seen.protocol).observed_m
    first, count = _first_and_count(seen)
    away = np.linalg.norm(person[first:, -1] - person[0, -1], axis=1)[:count]
    busy = np.flatnonzero(away > 0.15 * away.max())
    return float((first + busy[0]) / rate_hz), float((first + busy[-1]) / rate_hz)


def _first_and_count(seen: ModelTrials) -> tuple[int, int]:
    """The frame that the last of the first predicted window is for, and how many windows there are."""
    from mild_core.learning.data.windows import cut

    protocol = seen.protocol
    return 2 * protocol.window - 2 + protocol.lead_frames, len(cut(seen.trials[0], protocol).controlled)


def _moments(seen: ModelTrials, times_s: FloatArray) -> list[Moment]:
    """The one trial at these times, or at its ends where it is shorter."""
    from mild_core.learning.data.windows import thin

    (trial,), motion, rate_hz = seen.trials, motion_of(seen), seen.model.manifest.rate_hz
    first, count = _first_and_count(seen)
    chosen = np.clip(np.round(times_s * rate_hz).astype(int) - first, 0, count - 1)
    shape = (-1, *trial.controlled.shape[1:])
    recorded, predicted = (values / seen.recording.unit.scale for values in (motion.true, motion.predicted))
    arms = [_other_arm(seen, values.reshape(shape)) for values in (recorded, predicted)]
    lengths_m = seen.model.manifest.robot_from_human.arm_lengths_m
    person_m = _lengthened(thin(trial, seen.protocol).observed_m, lengths_m)
    times = [(float(time_s), place) for time_s, place in zip(times_s, chosen, strict=True)]
    return [Moment(time_s, person_m[first + i], arms[0][first + i], arms[1][i]) for time_s, i in times]


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

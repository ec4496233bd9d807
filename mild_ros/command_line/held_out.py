# SPDX-License-Identifier: Apache-2.0
"""A model learned without some trials, for figures of those trials: learned once, then found again in a folder."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mild_core.budgets import parse_toml
from mild_core.errors import SetupError
from mild_core.resources import model_folder, model_names
from mild_core.shapes import FloatArray
from mild_ros.command_line.console import Console
from mild_ros.command_line.train import with_progress

if TYPE_CHECKING:
    from mild_core.inference.motion_model import MildModel
    from mild_core.learning.data.demonstration import Demonstration
    from mild_core.learning.data.recording import Recording
    from mild_core.learning.data.windows import Protocol
    from mild_core.learning.training.configuration import Configuration
    from mild_core.learning.training.trained import TrainedModel

FOLDER = Path("out", "folds")
LATENTS = "controlled_latents.npz"


@dataclass(frozen=True, eq=False)
class HeldOutModel:
    """A model and the trials that it was learned without.

    Attributes:
        model: Without a fold of the trials.
        recording: Where the trials are from.
        protocol: Of the model.
        learned: The trials that it learned from.
        held_out: The others.
        controlled_latents: (N, Q) of each held-out trial: means of the controlled agent's own posterior.
        seed: Of all draws.
    """

    model: MildModel
    recording: Recording
    protocol: Protocol
    learned: tuple[Demonstration, ...]
    held_out: tuple[Demonstration, ...]
    controlled_latents: tuple[FloatArray, ...]
    seed: int


def configuration_of(name: str) -> Configuration:
    """How a model was learned, or would be.

    Args:
        name: Of a shipped model or configuration, the path of a configuration, or the folder of a model.

    Raises:
        SetupError: There is none, or its manifest does not say how it was learned.
    """
    from mild_core.inference.model import load_model
    from mild_core.learning.training.configuration import configuration_from, configuration_names, read_configuration

    if name in configuration_names() or name.endswith(".toml"):
        return read_configuration(name)
    manifest = load_model(model_folder(name)).manifest
    text = str(manifest.training.get("configuration", ""))
    if not text:
        problem = "does not say how it was learned, so it cannot be learned without some trials"
        raise SetupError(f"model {name}", problem, f"give one of {', '.join(configuration_names())}, or --split")
    found = configuration_from(manifest.name, parse_toml(text), text)
    settings = replace(found.settings, epochs=int(manifest.training.get("epochs", found.settings.epochs)))
    settings = replace(settings, members=len(manifest.members), doublings=0)
    return replace(found, settings=settings, seed=int(manifest.training.get("seeds", [found.seed])[0]))


def learn_without(name: str, data: Path | None, fold: int) -> HeldOutModel:
    """Learn a model without one fold of its trials, or find the one that was learned so.

    Args:
        name: See `configuration_of`.
        data: The recording; None: where its data set lies.
        fold: Which, see `folds_of`.

    Raises:
        SetupError: There is no such model or fold.
        DatasetError: The recording cannot be read or divided.
    """
    from mild_core.inference.model import load_model
    from mild_core.learning.data.folds import FOLDS, folds_of
    from mild_core.learning.datasets import recording_named
    from mild_core.learning.training.checkpoint import identity
    from mild_core.learning.training.transfer import start_of

    if not 0 <= fold < FOLDS:
        raise SetupError(f"fold {fold}", f"there are {FOLDS}", f"give 0 to {FOLDS - 1}")
    asked = configuration_of(name)
    if asked.start_from:
        asked = replace(asked, start_from=str(model_folder(asked.start_from)))
    recording = recording_named(asked.dataset, data)
    protocol = recording.protocols[asked.protocol]
    trials = recording.read(data or recording.default_path()).train
    part = folds_of(trials)[fold]
    if not part.held_out:
        raise SetupError(f"fold {fold}", f"holds none of the {len(trials)} trials", "give a smaller one, or --split")
    folder = FOLDER / f"{asked.name}_without_{fold}"
    wanted = identity(part.learned, protocol, asked.settings, asked.seed, start_of(asked))
    if _identity_in(folder) != wanted:
        words = f"learning {asked.name} without fold {fold}: {len(part.learned)} of {len(trials)} trials"
        Console(stderr=True).print(words, highlight=False, soft_wrap=True)
        _learn(name, asked, recording, (part.learned, part.held_out), folder, wanted)
    with np.load(folder / LATENTS, allow_pickle=False) as arrays:
        latents = tuple(arrays[f"trial_{place}"] for place in range(len(part.held_out)))
    return HeldOutModel(load_model(folder), recording, protocol, part.learned, part.held_out, latents, asked.seed)


def _identity_in(folder: Path) -> str:
    """Of the training that a folder came from; "" of none."""
    try:
        described = json.loads((folder / "manifest.json").read_text())
        there = (folder / LATENTS).exists()
        return str(described["training"]["identity"]) if there else ""
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def _learn(
    name: str,
    asked: Configuration,
    recording: Recording,
    trials: tuple[tuple[Demonstration, ...], tuple[Demonstration, ...]],
    folder: Path,
    wanted: str,
) -> None:
    """Write the model of `learned` trials, and the controlled agent's latents in the held-out ones."""
    from mild_core.inference.model import save_model
    from mild_core.learning.training.algorithm import train
    from mild_core.learning.training.export import ModelFacts, export
    from mild_core.learning.training.transfer import start_of

    learned, held_out = trials
    protocol = recording.protocols[asked.protocol]
    trained = with_progress(train(learned, protocol, asked.settings, asked.seed, (), start_of(asked)))
    training = {"dataset": recording.known_as, "identity": wanted, "configuration": asked.text}
    residual, regions, placement = _measured(name, trained, learned)
    facts = ModelFacts(folder.name, recording.robot, recording.observed_side, training=training, **placement)
    manifest, arrays = export(trained, learned, residual, facts, **regions)
    save_model(folder, manifest, arrays, f"# {folder.name}\n\nFor figures of the trials that it did not learn from.\n")
    member = trained.members[0]
    latents: dict[str, Any] = {
        f"trial_{place}": member.controlled_latents(trial, protocol, trained.interactions)
        for place, trial in enumerate(held_out)
    }
    np.savez(folder / LATENTS, **latents)


def _measured(
    name: str, trained: TrainedModel, learned: tuple[Demonstration, ...]
) -> tuple[FloatArray, dict[str, Any], dict[str, Any]]:
    """Covariance and regions as the model of that name has them, by cross-validation, and where its person stood.

    Of a model that there is not, the covariance of the errors in the trials that were learned from, which is too small.
    """
    from mild_core.inference.model import load_model
    from mild_core.learning.evaluation.errors import errors_of_trial

    if name in model_names() or Path(name).is_dir():
        model = load_model(model_folder(name))
        if set(trained.interactions) <= set(model.manifest.interactions):
            scales = dict(zip(model.manifest.interactions, map(float, model.covariance_scale), strict=True))
            radii = dict(zip(model.manifest.interactions, model.radii, strict=True))
            regions = {"covariance_scale": scales, "radii": radii}
            return model.residual_covariance, regions, {"placement": model.manifest.robot_from_human}
    errors = [errors_of_trial(trial, trained.protocol, trained.predict(trial)) for trial in learned]
    return np.mean([one.covariance for one in errors], axis=0), {}, {}

# SPDX-License-Identifier: Apache-2.0
"""`mild evaluate --strangers` and `--people`: people whom nothing was learned from."""

from __future__ import annotations

import json as json_text
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from mild_core.errors import SetupError
from mild_ros.command_line.console import Console

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mild_core.learning.data.recording import Recording
    from mild_core.learning.evaluation.strangers import Watched
    from mild_core.pipeline import Pipeline
    from mild_core.shapes import FloatArray

GIVEN = ("auto", "given")


def evaluate_people(file: Path, model_name: str, interaction: str, json: bool, cautious: bool = False) -> None:
    """Print how a model does with the people of a file.

    Raises:
        SetupError: The file is none, or the model or the interaction is unknown.
    """
    from rich.progress import track

    from mild_core.inference.gesture_recogniser import SAME
    from mild_core.learning.data.people import read_people
    from mild_core.learning.evaluation.strangers import apart, contact_of, meeting, summarise, watch
    from mild_ros.assembly.inference import load
    from mild_ros.assembly.pipeline import make_pipeline
    from mild_ros.assembly.settings import PipelineParameters

    if interaction not in GIVEN:
        raise SetupError("--interaction", f"is '{interaction}'", f"give one of {', '.join(GIVEN)}")
    recordings = read_people(file)
    model = load(model_name)
    of_ours = {SAME.get(name, name): name for name in model.manifest.interactions}

    @cache  # one for each interaction: compiled once
    def pipeline_for(given: str, joint_names: tuple[str, ...]) -> Pipeline:
        parameters = PipelineParameters(
            model=model_name,
            interaction=given,
            cautious=cautious,
            source="pose_array",
            joint_names=joint_names,
            source_axes="rep103",
        )
        return make_pipeline(parameters, model)

    watched: list[Watched] = []
    distances: dict[str, list[FloatArray]] = {label: [] for label in GIVEN}
    for recording in track(recordings, "watching", console=Console(stderr=True), transient=True):
        name = of_ours.get(SAME.get(recording.label, recording.label), "")
        known = recording if name else replace(recording, label="")
        labels = {"auto": "auto", "given": name or "auto"}
        pipelines = {key: pipeline_for(value, recording.joint_names) for key, value in labels.items()}
        for person in range(recording.people):
            watched.append(watch(pipelines[interaction], known, person))
            if name and meeting(recording).any():
                for key, own in distances.items():
                    own.append(apart(pipelines[key], known, person))
    found: dict[str, Any] = {"model": model.manifest.name, "file": file.name, "interaction": interaction}
    found |= summarise(watched)
    if any(recording.people == 2 for recording in recordings):
        found["contact"] = {label: contact_of(distances[label]) for label in ("given", "auto")}
    if json:
        typer.echo(json_text.dumps(found))
        return
    for key, value in found.items():
        typer.echo(f"{key}: {_shown(value)}")


def evaluate_strangers(seeds: int, json: bool) -> None:
    """Print how gestures are recognised in each data set when it is left out, and how near hands come.

    Raises:
        SetupError: There are fewer than two data sets here.
    """
    from mild_core.inference.stage import CERTAIN
    from mild_core.learning.evaluation.leave_set_out import leave_sets_out
    from mild_core.learning.training.gestures import GestureSettings, arms_at_hand

    arms, recordings = arms_at_hand()
    if len(recordings) < 2:
        names = ", ".join(one.name for one in recordings) or "none"
        raise SetupError(
            "--strangers", f"needs two data sets or more, here: {names}", "`mild data` says how to get them"
        )
    found = leave_sets_out(arms, GestureSettings(), seeds, CERTAIN)
    motion = _motion(recordings)
    if json:
        typer.echo(json_text.dumps({**found, "motion": motion}))
        return
    for name, figures in found.items():
        typer.echo(f"{name}, left out")
        for key, value in figures.items():
            typer.echo(f"  {key}: {_shown(value)}")
    for name, by_set in motion.items():
        for other, by_interaction in by_set.items():
            typer.echo(f"{name}, tool to the hands of {other}: {_shown(by_interaction)}")


def _motion(recordings: Sequence[Recording]) -> dict[str, Any]:
    """By shipped model of a robot: how far from strangers' hands it sends the robot's."""
    from mild_core.inference.manifest_reading import read_manifest
    from mild_core.learning.datasets import DATASETS
    from mild_core.learning.evaluation.stranger_motion import measure_motion, strangers_to
    from mild_core.resources import share_folder
    from mild_core.retargeting.robots import ROBOTS
    from mild_ros.assembly.inference import load

    found = {}
    for path in sorted(share_folder("models").glob("*/manifest.json")):
        controlled, training = read_manifest(path.parent).controlled, read_manifest(path.parent).training
        own = DATASETS.get(str(training.get("dataset")))
        if controlled.kind != "robot_joints" or own is None or not own.default_path().is_file():
            continue
        others = strangers_to(own, recordings)
        found[path.parent.name] = measure_motion(load(path.parent.name), own, ROBOTS[controlled.robot], others)
    return found


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_shown(one)}" for name, one in value.items())
    if isinstance(value, list):
        return " to ".join(_shown(one) for one in value)
    return f"{value:.3f}" if isinstance(value, float) else str(value)

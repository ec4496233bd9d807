# SPDX-License-Identifier: Apache-2.0
"""`mild evaluate --people`: a model on people whom it never met."""

from __future__ import annotations

import json as json_text
from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from mild_core.errors import SetupError
from mild_ros.command_line.console import Console

GIVEN = ("auto", "given")


def evaluate_people(file: Path, model_name: str, interaction: str, json: bool) -> None:
    """Print how a model does with the people of a file.

    Raises:
        SetupError: The file is none, or the model or the interaction is unknown.
    """
    from rich.progress import track

    from mild_core.inference.gesture_recogniser import SAME
    from mild_core.learning.people import read_people
    from mild_core.learning.strangers import summarise, watch
    from mild_ros.assembly.inference import load
    from mild_ros.assembly.pipeline import make_pipeline
    from mild_ros.settings import PipelineParameters

    if interaction not in GIVEN:
        raise SetupError("--interaction", f"is '{interaction}'", f"give one of {', '.join(GIVEN)}")
    recordings = read_people(file)
    model = load(model_name)
    of_ours = {SAME.get(name, name): name for name in model.manifest.interactions}
    pipelines = {}
    watched = []
    for recording in track(recordings, "watching", console=Console(stderr=True), transient=True):
        name = of_ours.get(SAME.get(recording.label, recording.label), "")
        known = recording if name else replace(recording, label="")
        given = name if interaction == "given" and name else "auto"
        if given not in pipelines:  # one for each interaction: compiled once
            parameters = PipelineParameters(
                model=model_name,
                interaction=given,
                source="pose_array",
                joint_names=recording.joint_names,
                source_axes="rep103",
            )
            pipelines[given] = make_pipeline(parameters, model)
        watched += [watch(pipelines[given], known, person) for person in range(recording.people)]
    found: dict[str, Any] = {"model": model.manifest.name, "file": file.name, "interaction": interaction}
    found |= summarise(watched)
    if json:
        typer.echo(json_text.dumps(found))
        return
    for key, value in found.items():
        typer.echo(f"{key}: {_shown(value)}")


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_shown(one)}" for name, one in value.items())
    return f"{value:.3f}" if isinstance(value, float) else str(value)

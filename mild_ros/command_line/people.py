# SPDX-License-Identifier: Apache-2.0
"""`mild evaluate --strangers` and `--people`: people whom nothing was learned from."""

from __future__ import annotations

import json as json_text
from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from mild_core.errors import SetupError
from mild_ros.command_line.console import Console

GIVEN = ("auto", "given")


def evaluate_people(file: Path, model_name: str, interaction: str, json: bool, cautious: bool = False) -> None:
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
                cautious=cautious,
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


def evaluate_strangers(seeds: int, json: bool) -> None:
    """Print how gestures are recognised in each data set when it is left out.

    Raises:
        SetupError: There are fewer than two data sets here.
    """
    from mild_core.inference.stage import CERTAIN
    from mild_core.learning.gestures import GestureSettings, arms_at_hand
    from mild_core.learning.leave_set_out import leave_sets_out

    arms, recordings = arms_at_hand()
    if len(recordings) < 2:
        names = ", ".join(one.name for one in recordings) or "none"
        raise SetupError(
            "--strangers", f"needs two data sets or more, here: {names}", "`mild data` says how to get them"
        )
    found = leave_sets_out(arms, GestureSettings(), seeds, CERTAIN)
    if json:
        typer.echo(json_text.dumps(found))
        return
    for name, figures in found.items():
        typer.echo(f"{name}, left out")
        for key, value in figures.items():
            typer.echo(f"  {key}: {_shown(value)}")


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_shown(one)}" for name, one in value.items())
    if isinstance(value, list):
        return " to ".join(_shown(one) for one in value)
    return f"{value:.3f}" if isinstance(value, float) else str(value)

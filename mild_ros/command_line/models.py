# SPDX-License-Identifier: Apache-2.0
"""`mild models`: what can be run here."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markdown import Markdown
from rich.table import Table

from mild_core.inference.model import REPORT, Manifest, read_manifest
from mild_core.resources import model_folder, model_names, share_folder
from mild_ros.command_line.console import Console

UNMEASURED = "not measured"

MOVED = {"human_arm": "partner's arm"}
"""What a model moves, where that is no robot."""


def models(
    name: Annotated[str, typer.Argument(help="A model's name or folder: its card is shown.")] = "",
    licence: Annotated[
        bool, typer.Option("--licence", help="What each learned from, and under which licences.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Everything in the manifests, as one JSON object.")] = False,
) -> None:
    """The models here: what they learned from, how good they are.

    All of them in a table, the errors by cross-validation on trials that the method had not seen:

        mild models

    One of them, with its data, licence, errors and limits (its model card):

        mild models yumi_buetepage_ahead

    What each learned from, the people of its recogniser included, and under which licences that stands (SPDX; a
    source that states none is `NOASSERTION`):

        mild models --licence
    """
    names = [name] if name else model_names()
    manifests = {one: read_manifest(model_folder(one)) for one in names}
    if as_json:
        print(json.dumps({one: _summary(manifest) for one, manifest in manifests.items()}, indent=1))
    elif licence:
        _print_licences(manifests)
    elif name:
        report = model_folder(name) / REPORT
        text = report.read_text(encoding="utf-8") if report.is_file() else f"{report} is missing: no card to show."
        Console().print(Markdown(text))
    else:
        _print(manifests, share_folder("models"))


def _summary(manifest: Manifest) -> dict[str, Any]:
    """All of a manifest, with the licence of its sources."""
    from mild_core.learning.training.licences import licence_of, sources_of

    values: dict[str, Any] = json.loads(manifest.to_json())
    return {**values, "licence": licence_of(manifest), "sources": sources_of(manifest)}


def _print_licences(manifests: dict[str, Manifest]) -> None:
    from mild_core.learning.training.licences import licence_of, sources_of

    table = Table(title="what models learned from", title_justify="left")
    for column in ("model", "licence of its sources", "sources"):
        table.add_column(column, no_wrap=column == "model")
    for name, manifest in manifests.items():
        sources = "; ".join(f"{one} ({spdx})" for one, spdx in sources_of(manifest).items())
        table.add_row(name, licence_of(manifest), sources)
    Console().print(table)


def _print(manifests: dict[str, Manifest], folder: Path) -> None:
    console = Console()
    table = Table(title=f"models in {folder}", title_justify="left")
    for column in ("model", "predicts", "moves", "error", "recognised"):
        table.add_column(column, no_wrap=column == "model")
    for name, manifest in manifests.items():
        ahead = (manifest.lead_frames + manifest.window - 1) / manifest.rate_hz
        table.add_row(
            name,
            f"{manifest.protocol}: to {ahead:.1f} s ahead" if ahead > 0 else f"{manifest.protocol}: the present",
            f"{MOVED.get(manifest.controlled.kind, manifest.controlled.robot)}, "
            f"{len(manifest.controlled.joint_names)} joints",
            measured(manifest, "given"),
            measured(manifest, "recognised"),
        )
    console.print(table)
    interactions = sorted({one for manifest in manifests.values() for one in manifest.interactions})
    console.print(f"interactions: {', '.join(interactions)}", highlight=False)
    console.print("errors by cross-validation, interaction given / recognised; `mild models NAME` for more")


def measured(manifest: Manifest, labels: str) -> str:
    """The macro error by cross-validation, for people."""
    from mild_core.learning.data.units import UNITS

    table: dict[str, Any] = manifest.errors.get("cross_validation", {})
    for row in table.get("rows", []):
        if row["labels"] == labels:
            spread = "" if row["macro_std"] is None else f" ± {row['macro_std']:.4f}"
            return f"{row['macro_mean']:.4f}{spread} {UNITS[table['unit']].squared_shown}"
    return UNMEASURED

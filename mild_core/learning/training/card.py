# SPDX-License-Identifier: Apache-2.0
"""The model card: what a model learned from, how good it is, and what it is not for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from mild_core.inference.manifest import Manifest
from mild_core.learning.data.recording import Recording
from mild_core.learning.data.units import UNITS

LIMITS = """\
- Learned from few trials of few people: a person of other habits is a person it has not met.
- It knows the interactions above and no other. What the person does besides them is scored as unknown
  (`out_of_distribution` above 1), but a movement that looks like a known one is taken for it.
- It copies timing and reach from demonstrations. It does not plan contact: nothing makes hands meet, and nothing here
  keeps the robot from touching a person. Position, velocity, acceleration and jerk limits are kept by retargeting.{own}
- Not for a robot near people without the protections that its operator is bound to by law and by the robot's maker.
"""
BESIDE = """ \
Beside that answers a reservoir, whose units remember the last seconds."""
BRANCH = """
- Angles are scored and given in one branch: the fifth joint of hand waving is unwrapped by a turn (same pose)."""
"""Of the one recording in which that is so."""


def model_card(manifest: Manifest, recording: Recording, retrain: str) -> str:
    """The text of `REPORT.md`.

    Args:
        manifest: Of the finished model; its `errors` may hold a cross-validation as `cross_validation_entry` makes it.
        recording: That it learned from.
        retrain: The command that makes it again.
    """
    protocol = recording.protocols[manifest.protocol]
    training = manifest.training
    whose = "the publishers'" if recording.known_as == recording.name else "the"
    beside = BESIDE if training.get("reservoir_units") else ""
    parts = [
        f"# Model card: {manifest.name}\n",
        f"{_sentence(protocol.meaning)} Windows of {manifest.window} frames at {manifest.rate_hz:g} Hz; protocol "
        f"`{manifest.protocol}`. Variational autoencoders of person and robot ({manifest.latent_size} dimensions each) "
        f"with a {manifest.prior.kind.upper()} of {manifest.prior.components} components per interaction between them; "
        f"{_members(len(manifest.members))}.{beside}\n",
        "## Intended use\n",
        f"{_moves(manifest)} in answer to a person's {manifest.observed.side} arm "
        f"({', '.join(manifest.observed.joint_names)}), in research and teaching, through this package's retargeting. "
        f"Interactions: {', '.join(manifest.interactions)}.\n",
        "## Data\n",
        f"{recording.title}: {recording.source}.\n",
        f"Licence: {recording.licence}. The recordings are not part of this package, and this folder stores none of "
        "their windows: networks, Gaussians, means of clusters and a synthetic sample only.\n",
        f"{_started(training)}Trials: {training.get('trials', 'unknown')}, "
        f"{whose} {training.get('split', 'training')} split only. "
        f"Seeds: {_listed(training.get('seeds', ()))}. {_epochs(training)}"
        f"Source revision: {training.get('git_revision', 'unknown')}.\n",
        "## Errors\n",
        errors_text(manifest.errors),
        "## Limits\n",
        LIMITS.format(own=BRANCH if recording.name == "buetepage_hr" else ""),
        "## To train it again\n",
        f"```\n{retrain}\n```\n",
        *_configured(training),
        "Equal seeds, machines and libraries give equal weights; other kernels differ in the last digits.\n",
    ]
    return "\n".join(parts)


def _moves(manifest: Manifest) -> str:
    """What the model is for."""
    if manifest.controlled.kind == "human_arm":
        return "Telling where the right arm of a second person would be, to be mapped onto a robot's,"
    return f"Moving the {len(manifest.controlled.joint_names)} joints of one arm of `{manifest.controlled.robot}`"


def _epochs(training: Mapping[str, Any]) -> str:
    """For how long each network learned, and why no longer."""
    return f"Epochs: {training['epochs']} ({training.get('stopped')}). " if "epochs" in training else ""


def _started(training: Mapping[str, Any]) -> str:
    """Which hidden layers came from another model."""
    return f"Hidden layers from {training['start_from']}. " if training.get("start_from") else ""


def _configured(training: Mapping[str, Any]) -> list[str]:
    """The configuration it was trained with, word by word."""
    text = training.get("configuration")
    return [f"Its configuration:\n\n```toml\n{str(text).strip()}\n```\n"] if text else []


def cross_validation_entry(table: Mapping[str, Any], method: str) -> dict[str, Any]:
    """`errors` of a manifest from a table that `mild evaluate --cv` wrote.

    Args:
        table: The content of `cross_validation_<protocol>.json`.
        method: Name of the method that the model is.

    Raises:
        ValueError: The table has no such method.
    """
    keys = ("title", "labels", "macro_mean", "macro_std", rmse_key(table), "windows", "relative", "interactions")
    rows = [{key: row[key] for key in keys} for row in table["methods"] if row["method"] == method]
    if not rows:
        raise ValueError(f"the table has no method '{method}'")
    others = [
        {key: row[key] for key in ("method", "title", "labels", "macro_mean", "macro_std")}
        for row in table["methods"]
        if row["method"] != method
    ]
    about = {key: table[key] for key in ("protocol", "dataset", "folds", "seeds", "date", "unit")}
    return {"cross_validation": {**about, "rows": rows, "others": others}}


def rmse_key(table: Mapping[str, Any]) -> str:
    """Under which key a table of errors holds the plain one."""
    return f"rmse_{UNITS[table['unit']].key}"


def errors_text(errors: Mapping[str, Any]) -> str:
    """The section on errors."""
    found = errors.get("cross_validation")
    if not found:
        return "Not measured. `mild evaluate --cv` measures the method on trials that it has not seen.\n"
    unit, key = UNITS[found["unit"]], rmse_key(found)
    lines = [
        f"Measured on {found['date']} by {found['folds']}-fold cross-validation over the training trials (a fold is "
        f"the index within the interaction modulo {found['folds']}), seeds: {found['seeds']}, protocol "
        f"`{found['protocol']}`; mean ± standard deviation over seeds. The model in this folder learned from all "
        "training trials, so its own error on them says nothing.\n",
        f"| method | labels | macro [{unit.squared_shown}] |",
        "| --- | --- | ---: |",
    ]
    ranked = sorted([*found["rows"], *found["others"]], key=lambda row: float(row["macro_mean"]))
    lines += [f"| {row['title']} | {row['labels']} | {_spread(row)} |" for row in ranked]
    for row in found["rows"]:
        lines += ["", f"{row['title']}, labels {row['labels']}, mean ± standard deviation over windows:", ""]
        lines += [f"| interaction | error [{unit.squared_shown}] | windows |", "| --- | ---: | ---: |"]
        for name, one in row["interactions"].items():
            lines.append(f"| {name} | {one['mse']:.4f} ± {one['mse_std']:.4f} | {one['windows']} |")
        lines += ["", f"Pooled RMSE {row[key]:.1f}{unit.shown} over {row['windows']} windows."]
        lines += [f"{_against(name, relative)}" for name, relative in row["relative"].items()]
    return "\n".join(lines) + "\n"


def _against(name: str, relative: Mapping[str, Any]) -> str:
    low, high = relative["interval"]
    return f"Against {name}: {relative['change']:+.0%} (95 % of draws of trials: {low:+.0%} to {high:+.0%})."


def _spread(row: Mapping[str, Any]) -> str:
    std = row["macro_std"]
    return f"{row['macro_mean']:.4f}" + ("" if std is None or math.isnan(std) else f" ± {std:.4f}")


def _listed(values: object) -> str:
    return ", ".join(str(value) for value in values) if isinstance(values, Sequence) else str(values)


def _members(number: int) -> str:
    """How many networks answer."""
    return "one network of each" if number == 1 else f"{number} networks of each, whose answers are averaged"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."
